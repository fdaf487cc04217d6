"""What children are to run: examinations that do not end well, and readings that may not end."""

import json
import os
import signal
import threading
from contextlib import suppress

from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError


def read_quietly(document_json: str) -> None:
    with suppress(InvalidProblemError):
        read_problem(json.loads(document_json))


def never_answer(document_json: str) -> str:
    threading.Event().wait()
    return document_json


def die(document_json: str) -> str:
    os.kill(os.getpid(), signal.SIGSEGV)
    return document_json
