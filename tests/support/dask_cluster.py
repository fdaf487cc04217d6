"""A Dask cluster of real processes on this machine, which tests kill, stop and start again."""

import os
import signal
import subprocess
import sys
from pathlib import Path

from tests.workers.processes import ROOT, wait_until


class Cluster:
    """A scheduler at a port of its own, and workers; the folder has their logs."""

    def __init__(self, folder: Path, *, workers: int = 1, threads: int = 1, nannies: bool = False) -> None:
        self._folder, self._threads, self._nannies = folder, threads, nannies
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

    def start_worker(self, **environment: str) -> "subprocess.Popen[bytes]":
        """Start one more worker."""
        nanny = "--nanny" if self._nannies else "--no-nanny"
        options = ["--host", "127.0.0.1", "--nthreads", str(self._threads), nanny]
        options += ["--local-directory", str(self._folder), "--death-timeout", "60"]
        worker = self._start("worker", [self.address, *options], **environment)
        self.workers.append(worker)
        return worker

    def _start(self, role: str, options: list[str], **environment: str) -> "subprocess.Popen[bytes]":
        log = (self._folder / f"{role}.log").open("ab")
        chosen = {**os.environ, "PYTHONPATH": str(ROOT), **environment}
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
