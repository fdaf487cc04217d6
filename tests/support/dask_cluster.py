"""A Dask cluster of real processes on this machine, which tests kill, stop and start again."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

from tests.support.waiting import wait_until
from tests.workers.processes import ROOT


class Cluster:
    """A scheduler at a port of its own, and workers; the folder has their logs."""

    def __init__(
        self, folder: Path, *, workers: int = 1, threads: int = 1, nannies: bool = False, **environment: str
    ) -> None:
        self._folder, self._threads, self._nannies = folder, threads, nannies
        self._environment = environment
        self.file = folder / "scheduler.json"
        self._port = "0"
        self.workers: list[subprocess.Popen[bytes]] = []
        self.start_scheduler()
        for _ in range(workers):
            self.start_worker()

    def start_scheduler(self) -> None:
        """Start a scheduler; a second one at the address of the first, as a restarted service would be."""
        self.file.unlink(missing_ok=True)
        command = ["--host", "127.0.0.1", "--port", self._port, "--scheduler-file", str(self.file)]
        self.scheduler = self._start("scheduler", command)
        wait_until(lambda: self.file.exists() and self.file.read_text().endswith("}"))
        self._port = self.file.read_text().partition("tcp://127.0.0.1:")[2].partition('"')[0]
        self.address = f"tcp://127.0.0.1:{self._port}"

    def start_worker(self) -> None:
        """Start one more worker."""
        nanny = "--nanny" if self._nannies else "--no-nanny"
        options = ["--host", "127.0.0.1", "--nthreads", str(self._threads), nanny]
        options += ["--local-directory", str(self._folder), "--death-timeout", "60"]
        self.workers.append(self._start("worker", [self.address, *options]))

    def start_the_dead(self) -> None:
        """Start again what has ended, as whoever runs a cluster does."""
        if self.scheduler.poll() is not None:
            self.start_scheduler()
        for worker in [each for each in self.workers if each.poll() is not None]:
            self.workers.remove(worker)
            self.start_worker()

    def _start(self, role: str, options: list[str]) -> "subprocess.Popen[bytes]":
        log = (self._folder / f"{role}.log").open("ab")
        chosen = {**os.environ, "PYTHONPATH": str(ROOT), **self._environment}
        command = [sys.executable, "-m", f"distributed.cli.dask_{role}", *options, "--no-dashboard"]
        process = subprocess.Popen(
            command, cwd=self._folder, env=chosen, stdout=log, stderr=log, start_new_session=True
        )
        log.close()
        return process

    def log(self, role: str) -> str:
        """Return what the scheduler or the workers have written."""
        return (self._folder / f"{role}.log").read_text()

    def close(self) -> None:
        """Kill all of them; the children end with their workers."""
        for process in (*self.workers, self.scheduler):
            kill_group(process)


def kill_group(process: "subprocess.Popen[bytes]") -> None:
    """Kill a process and what it has started in its session, such as the worker of a nanny."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


class Network:
    """A way to a scheduler that can stall: then connections stay, and nothing comes through."""

    def __init__(self, address: str) -> None:
        host, _, port = address.removeprefix("tcp://").partition(":")
        self._behind = host, int(port)
        self._flows = threading.Event()
        self._flows.set()
        self.stall, self.resume = self._flows.clear, self._flows.set
        listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{listener.getsockname()[1]}"
        self._sockets = [listener]
        threading.Thread(target=self._accept, args=(listener,), daemon=True).start()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                near, _ = listener.accept()
                self._sockets.append(near)
                self._flows.wait()
                try:
                    far = socket.create_connection(self._behind)
                except OSError:  # the scheduler is away
                    near.close()
                    continue
                self._sockets.append(far)
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=pair, daemon=True).start()

    def _carry(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                self._flows.wait()
                target.sendall(data)
        for end in (source, target):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End all connections, and let no other one in."""
        self._flows.set()
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
