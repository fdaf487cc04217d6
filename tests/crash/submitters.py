"""Services that are killed right after the commit of a submission, before anybody is answered.

``python -m tests.crash.submitters`` reads a line for each: the URL, the key, the kind
of request and the fault. It forks, so that a service lives for some hundred milliseconds,
and answers with how it ended.
"""

import json
import os
import subprocess
import sys

from fastapi import FastAPI

from service.app import create_app
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database.database import VARIABLE
from tests.support.api import STATE, TestClient
from tests.support.sweeps import SWEEP
from tests.workers.processes import ROOT

REQUESTS = {
    "job": ("/v1/jobs", STATE),
    "list": ("/v1/jobs", [STATE, STATE, {}]),
    "sweep": ("/v1/sweeps", SWEEP),
}


def app_on(url: str) -> FastAPI:
    """Return the application; nothing that is sent here needs a verdict, so no child is started."""
    return create_app(Settings(database_url=url), sandbox=Sandbox(1, memory_mb=512))


def send(client: TestClient, key: str, kind: str):
    """Submit something with a key."""
    path, document = REQUESTS[kind]
    return client.post(path, json=document, headers={"Idempotency-Key": key})


class Submitters:
    """Starts services, one at a time."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", __name__]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        self._process = subprocess.Popen(command, **pipes, text=True, cwd=ROOT)

    def __call__(self, url: str, key: str, kind: str, fault: str) -> int:
        """Return how the service ended: 0, or minus the signal that killed it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([url, key, kind, fault]) + "\n")
        self._process.stdin.flush()
        return int(self._process.stdout.readline())

    def close(self) -> None:
        self._process.communicate()


def main() -> None:
    for line in sys.stdin:
        url, key, kind, fault = json.loads(line)
        pid = os.fork()
        if pid == 0:
            code = 1
            try:
                os.environ[VARIABLE] = fault
                with TestClient(app_on(url)) as client:
                    code = 0 if send(client, key, kind).status_code == 202 else 2
            finally:
                os._exit(code)
        _, status = os.waitpid(pid, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
