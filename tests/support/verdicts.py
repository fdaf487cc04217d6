"""Examinations that do not end well, for children to run."""

import os
import signal
import threading


def never_answer(document_json: str) -> str:
    threading.Event().wait()
    return document_json


def die(document_json: str) -> str:
    os.kill(os.getpid(), signal.SIGSEGV)
    return document_json
