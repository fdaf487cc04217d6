"""A real service in its own processes, for tests and measurements."""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pytest

from tests.support.waiting import PATIENCE


@dataclass(frozen=True)
class Answer:
    status: int
    headers: Mapping[str, str]
    document: dict


@dataclass(frozen=True)
class Service:
    address: str
    process: "subprocess.Popen[bytes]"
    seconds_to_ready: float

    def call(self, method: str, path: str, document: object = None, **headers: str) -> Answer:
        body = None if document is None else json.dumps(document).encode()
        sent = {"Content-Type": "application/json", **{k.replace("_", "-"): v for k, v in headers.items()}}
        request = urllib.request.Request(self.address + path, data=body, headers=sent, method=method)
        try:
            with urllib.request.urlopen(request, timeout=120) as answer:
                content = answer.read()
                return Answer(answer.status, dict(answer.headers), json.loads(content) if content else {})
        except urllib.error.HTTPError as error:
            with error:
                return Answer(error.code, dict(error.headers), json.load(error))

    def solve(self, problem: object) -> tuple[dict, dict]:
        """Submit, wait, and return the solution and its trajectory."""
        job = self.call("POST", "/v1/jobs", problem, Prefer="wait=60")
        assert job.status == 200, job
        assert job.document["state"] == "succeeded", job
        path = f"/v1/solutions/{job.document['solution']}"
        return self.call("GET", path).document, self.call("GET", path + "/trajectory").document


def free_port() -> int:
    """Return a port for a process that will be started; below those that connections get from the system.

    One of these may be taken by any client of another test until the process listens.
    """
    while True:
        port = random.randrange(15_000, 32_000)
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


@contextmanager
def serving(
    folder: Path,
    *,
    workers: int = 1,
    port: int | None = None,
    stderr: IO[bytes] | None = None,
    **environment: str,
) -> Iterator[Service]:
    """Run ``polhode serve`` on the database in ``folder``; stop it with SIGTERM."""
    if port is None:
        port = free_port()
    command = [
        Path(sys.executable).with_name("polhode"),
        "serve",
        "--port",
        str(port),
        "--workers",
        str(workers),
    ]
    began = time.monotonic()
    process = subprocess.Popen(
        command, cwd=folder, env={**os.environ, **environment}, stderr=stderr, start_new_session=True
    )
    address = f"http://127.0.0.1:{port}"
    try:
        _wait_until_ready(address, process)
        yield Service(address, process, time.monotonic() - began)
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(timeout=PATIENCE)
        finally:
            # Whatever a failed test left behind in the session goes with it.
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


@pytest.fixture(scope="session")
def running_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One service with a worker, for the tests of all folders that only ask it: a start takes six seconds.

    It lives in tests/conftest.py: in the ``conftest.py`` of a folder each folder had another one.
    """
    with serving(tmp_path_factory.mktemp("service")) as running:
        yield running


def _wait_until_ready(address: str, process: "subprocess.Popen[bytes]") -> None:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        assert process.poll() is None, f"the service stopped with code {process.returncode}"
        try:
            with urllib.request.urlopen(address + "/readyz", timeout=5):
                return
        except OSError:
            time.sleep(0.02)
    raise AssertionError("not ready within 60 s")
