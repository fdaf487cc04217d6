"""Processes of pytest-xdist that are forked from one which has loaded everything.

By itself pytest-xdist starts an interpreter for each, and each imports the
libraries, the service and all test modules before its first test. Here a
server collects the tests once and forks when asked to: a fork has all modules
from its first moment. It is asked by the program that ``execnet`` starts in
place of an interpreter, ``pipes_of_worker.py``, which hands over its three
pipes and ends when the fork has ended.

Only on Linux: other systems have libraries that do not survive a fork.
"""

import ast
import contextlib
import gc
import os
import selectors
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from service.startup import collect_seldom

IS_POSSIBLE = sys.platform == "linux"
_PIPES = Path(__file__).with_name("pipes_of_worker.py")
_SERVER = "import sys; from tests.support import forked_workers; forked_workers.serve(sys.argv[1:])"


class ForkedWorkers:
    """A plugin of the process that distributes the tests."""

    def __init__(self) -> None:
        self._server: subprocess.Popen[bytes] | None = None
        self._folder: str | None = None

    @pytest.hookimpl
    def pytest_xdist_setupnodes(self, config: pytest.Config, specs: list) -> None:
        """Start the server, and have each worker made by it."""
        # A short path: a socket's may have 107 characters.
        self._folder = tempfile.mkdtemp(prefix="fork")
        address = str(Path(self._folder, "socket"))
        listener = socket.socket(socket.AF_UNIX)
        listener.bind(address)
        listener.listen()
        self._server = subprocess.Popen(
            [sys.executable, "-c", _SERVER, str(listener.fileno()), *config.args],
            cwd=config.rootpath,
            # The server ends when this end of the pipe is closed, however we end.
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=[listener.fileno()],
        )
        listener.close()
        for spec in specs:
            spec.python = shlex.join([sys.executable, "-I", "-S", str(_PIPES), address])

    def pytest_unconfigure(self) -> None:
        if self._server is not None:
            assert self._server.stdin is not None
            self._server.stdin.close()
            self._server.wait()
        if self._folder is not None:
            shutil.rmtree(self._folder)


def serve(arguments: list[str]) -> None:
    """Load what the tests load, then fork whenever asked to; return in a fork when its work is done."""
    listener, places = socket.socket(fileno=int(arguments[0])), arguments[1:]
    # Ctrl-C reaches the whole group of processes: workers stop by it, then we by our pipe.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    collect_seldom()
    collect(places)
    # What is loaded stays: nobody looks for garbage in it, and forks share its memory.
    gc.collect()
    gc.freeze()
    if (pipes := _Server(listener).fork_until_closed()) is not None:
        _be_worker(pipes)


def collect(places: list[str]) -> None:
    """Load the tests at these places; what cannot be loaded is told by the workers, who try again.

    A module that failed stays among the loaded ones, without its tests: then all test modules are forgotten.
    """
    if pytest.main(["--collect-only", "-qq", "-p", "no:cacheprovider", "-n0", *places]) != pytest.ExitCode.OK:
        for name in [name for name in sys.modules if name.rpartition(".")[2].startswith("test_")]:
            del sys.modules[name]


class _Server:
    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._selector = selectors.DefaultSelector()
        self._selector.register(listener, selectors.EVENT_READ)
        self._selector.register(0, selectors.EVENT_READ)

    def fork_until_closed(self) -> list[int] | None:
        """Fork for whoever connects; return the pipes in a fork, None when nobody will ask any more."""
        while True:
            for key, _ in self._selector.select():
                if key.fileobj == 0:
                    return None
                if key.fileobj is self._listener:
                    if (pipes := self._fork(self._listener.accept()[0])) is not None:
                        return pipes
                elif isinstance(key.fileobj, socket.socket):
                    # Whoever held the pipes was killed; the fork goes with it.
                    with contextlib.suppress(ProcessLookupError):
                        os.kill(key.data, signal.SIGKILL)
                    self._selector.unregister(key.fileobj)
                else:
                    self._tell_end(key)

    def _fork(self, asking: socket.socket) -> list[int] | None:
        _, pipes, _, _ = socket.recv_fds(asking, 1, 3)
        pid = os.fork()
        if pid == 0:
            for key in list(self._selector.get_map().values()):
                # A socket itself, not its number: the object would later close what has the number then.
                if isinstance(key.fileobj, socket.socket):
                    key.fileobj.close()
                elif key.fd != 0:
                    os.close(key.fd)
            self._selector.close()
            asking.close()
            return pipes
        for pipe in pipes:
            os.close(pipe)
        self._selector.register(asking, selectors.EVENT_READ, pid)
        self._selector.register(os.pidfd_open(pid), selectors.EVENT_READ, (pid, asking))
        return None

    def _tell_end(self, key: selectors.SelectorKey) -> None:
        pid, asking = key.data
        code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        self._selector.unregister(key.fileobj)
        os.close(key.fd)
        with contextlib.suppress(KeyError):  # not if whoever asked was gone first
            self._selector.unregister(asking)
        with contextlib.suppress(OSError):
            asking.send(bytes([code % 256]))
        asking.close()


def _be_worker(pipes: list[int]) -> None:
    """Do what ``execnet`` has an interpreter do: run the line of code that comes first."""
    for standard, pipe in enumerate(pipes):
        os.dup2(pipe, standard)
        os.close(pipe)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = ["-c"]
    sys.stdin = open(0, closefd=False)  # noqa: SIM115
    sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    source = ast.literal_eval(sys.stdin.readline())
    exec(source, sys.modules["__main__"].__dict__)
