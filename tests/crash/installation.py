"""``polhode serve`` and another worker on one database, with every process that belongs to them.

With the engine ``postgres`` the other worker is of another host: it has a folder and, if allowed, a
network of its own. With a cluster both are bridges to it.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from tests.support.dask_cluster import Cluster, Network
from tests.support.serving import free_port
from tests.workers.processes import network_apart

POLHODE = Path(sys.executable).with_name("polhode")
MARK = "POLHODE_STORM"
"""In the environment of every process of a storm, however far down: none is missed, no other is hit."""
SETTINGS = {
    "POLHODE_LEASE_SECONDS": "1",
    "POLHODE_RETRY_SECONDS": "0.1",
    "POLHODE_POLL_SECONDS": "0.1",
    # Jobs are not to blame for what is done to their workers here.
    "POLHODE_MAX_ATTEMPTS": "1000",
}


STALL_SECONDS = 8.0
"""Seconds for which the network stalls: longer than a lease of those who use a cluster."""
CLUSTER_SETTINGS = {
    # Its workers say each second that they live, on a machine that is busy with starting others.
    "POLHODE_LEASE_SECONDS": "5",
    "POLHODE_POOL": "dask",
}


class Installation:
    """``polhode serve`` with its worker and another worker; started anew whenever they are dead.

    A cluster of their own, if they have one, has two workers under nannies, and is reached by a network that
    stalls.
    """

    def __init__(self, url: str, folder: Path, engine: str = "local", *, has_cluster: bool = False) -> None:
        self._mark = f"{os.getpid()}-{time.monotonic_ns()}"
        self._folder = folder
        own = {MARK: self._mark, "POLHODE_DATABASE_URL": url, "POLHODE_ENGINE": engine}
        self.cluster, self.network = None, None
        if has_cluster:
            (folder / "cluster").mkdir()
            self.cluster = Cluster(folder / "cluster", workers=2, nannies=True, **own)
            self.network = Network(self.cluster.address)
            own |= {**CLUSTER_SETTINGS, "POLHODE_DASK_SCHEDULER": self.network.address}
        self.environment = {**os.environ, **SETTINGS, **own}
        self._port = free_port()
        serve = _Launch(["serve", "--port", str(self._port), "--workers", "1"], folder)
        other = _Launch(["worker", "--slots", "1"], folder)
        if engine == "postgres":
            other = replace(other, folder=folder / "other", host="other", begins_with=network_apart())
            other.folder.mkdir()
        self._launches = (serve, other)
        self._log = (folder / "log").open("ab")
        self._running = [self._start(launch) for launch in self._launches]

    def start_the_dead(self) -> None:
        for index, process in enumerate(self._running):
            if process.poll() is not None:
                self._running[index] = self._start(self._launches[index])
        if self.cluster is not None:
            self.cluster.start_the_dead()

    def call(self, method: str, path: str, document: object = None) -> dict:
        """Return the answer to a request; raises OSError or HTTPException if there is none, or a 503."""
        body = None if document is None else json.dumps(document).encode()
        address = f"http://127.0.0.1:{self._port}{path}"
        request = urllib.request.Request(
            address, data=body, method=method, headers={"Content-Type": "application/json"}
        )
        try:
            with urllib.request.urlopen(request, timeout=10) as answer:
                return json.load(answer)
        except urllib.error.HTTPError as error:
            with error:
                if error.code != 503:
                    raise AssertionError(f"{path}: {error.code} {error.read()!r}") from None
                raise ConnectionError("503") from None

    def processes(self) -> list[tuple[int, str]]:
        """Return the id and the kind of every living process of this installation."""
        mark, found = f"{MARK}={self._mark}".encode(), dict[int, _Process]()
        for folder in Path("/proc").iterdir():
            if folder.name.isdigit():
                with contextlib.suppress(OSError):
                    state, parent = (folder / "stat").read_text().rpartition(")")[2].split()[:2]
                    if state != "Z" and mark in (folder / "environ").read_bytes().split(b"\0"):
                        arguments = (folder / "cmdline").read_bytes().split(b"\0")
                        found[int(folder.name)] = _Process(int(parent), arguments)
        return [(pid, _kind(found, pid)) for pid in found]

    def run(self, *command: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [POLHODE, *command], env=self.environment, cwd=self._folder, capture_output=True, text=True
        )

    def stop(self) -> None:
        for process in self._running:
            process.send_signal(signal.SIGTERM)
        for process in self._running:
            process.wait(timeout=120)
        self._close_cluster()
        self._log.close()

    def clean_up(self) -> None:
        for pid, _ in self.processes():
            kill(pid)
        for process in self._running:
            process.wait()
        self._close_cluster()

    def _close_cluster(self) -> None:
        if self.cluster is not None and self.network is not None:
            self.cluster.close()
            self.network.close()

    def _start(self, launch: "_Launch") -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            [*launch.begins_with, POLHODE, *launch.command],
            env={**self.environment, **({"POLHODE_HOST_NAME": launch.host} if launch.host else {})},
            cwd=launch.folder,
            stderr=self._log,
            start_new_session=True,
        )


def kill(pid: int) -> bool:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
        return True
    return False


@dataclass(frozen=True)
class _Launch:
    """How one of the installation's processes is started."""

    command: list[str]
    folder: Path
    host: str | None = None
    """Its name, if it is not this machine's."""
    begins_with: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Process:
    parent: int
    arguments: list[bytes]


def _kind(processes: Mapping[int, _Process], pid: int) -> str:
    """Say what a process is: children are forked by a helper, and look like it but for their parents."""
    if pid not in processes:
        return "gone"
    process = processes[pid]
    if b"serve" in process.arguments:
        return "api"
    if b"distributed.cli.dask_scheduler" in process.arguments:
        return "scheduler"
    if b"distributed.cli.dask_worker" in process.arguments:
        return "nanny"
    if b"--multiprocessing-fork" in process.arguments and _kind(processes, process.parent) == "nanny":
        return "Dask worker"
    if b"children" in process.arguments:
        return "children's"
    # The other worker is still called by its own name until it has become one.
    if b"run" in process.arguments or b"worker" in process.arguments:
        return "worker"
    if _kind(processes, process.parent) != "helper":
        return "helper"
    of = _kind(processes, processes[process.parent].parent)
    return "child" if of in ("worker", "children's") else "judge"
