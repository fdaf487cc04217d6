"""A worker that was forked from a process which has loaded what workers need; handled as one of ``Popen``."""

import atexit
import functools
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.support import processor_time

ROOT = Path(__file__).parents[2]


class ForkedProcess:
    """What the tests use of ``subprocess.Popen``."""

    def __init__(
        self,
        arguments: Sequence[str],
        *,
        folder: Path,
        environment: Mapping[str, str],
        descriptors: Sequence[int],
        has_own_network: bool,
    ) -> None:
        request = {
            "arguments": arguments,
            "folder": str(folder),
            "environment": environment,
            "has_own_network": has_own_network,
        }
        self._told, theirs = socket.socketpair()
        with theirs:
            socket.send_fds(_parent(), [json.dumps(request).encode()], [theirs.fileno(), *descriptors])
        self._lines = self._told.makefile("r")
        self.pid = int(self._lines.readline())
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit code, None while there is none."""
        return self._look(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code when there is one."""
        code = self._look(timeout)
        if code is None:
            raise subprocess.TimeoutExpired(f"worker {self.pid}", timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        # Once it has ended, its id may be that of another process.
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def _look(self, timeout: float | None) -> int | None:
        if self.returncode is None and select.select([self._told], [], [], timeout)[0]:
            code, seconds = self._lines.readline().split()
            self.returncode = int(code)
            processor_time.add(float(seconds))
            self._lines.close()
            self._told.close()
        return self.returncode


@functools.cache
def _parent() -> socket.socket:
    """Return the line to the process that forks."""
    ours, theirs = socket.socketpair(type=socket.SOCK_SEQPACKET)
    with theirs:
        line = theirs.fileno()
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.workers.worker_process", "fork", str(line)],
            cwd=ROOT,
            pass_fds=[line],
        )

    def end() -> None:
        ours.close()
        process.wait()

    atexit.register(end)
    return ours
