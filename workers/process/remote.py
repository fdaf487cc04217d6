"""Children of a pool elsewhere: a process that serves them, and the side of the process that uses it.

A Dask worker may be daemonic, may be killed together with its group, and runs threads of its own; hence it
has no children, but starts one process, in a session of its own, that has them. Both talk through pipes: when
the user of that process ends, however it does, it reads the end of its stdin, and kills its children.
"""

import importlib
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, field
from typing import BinaryIO

from service.local.workers import worker_command
from service.sandbox import BREAKAGES, Sandbox, SandboxBrokenError
from service.startup import use_one_thread
from workers.process.messages import calls_in, pack, pack_fault, pack_outcomes, read, unpack, write
from workers.process.pool import ChildBatch, ChildrenPool, ReturnedError
from workers.process.start import Warming
from workers.process.tasks import WorkerTasks

logger = logging.getLogger(__name__)

ALIVE_SECONDS = 1.0
"""How often the process tells that it lives ..."""
_PROGRESS_SECONDS = 0.2
"""... and how often at most how far its batches are, which few of them live to see."""
_PAUSE_SECONDS = 1.0
"""Between the end of such a process and the start of the next."""


def tasks_named(name: str) -> WorkerTasks:
    """Return what ``module:attribute`` names."""
    module, _, attribute = name.partition(":")
    tasks: WorkerTasks = getattr(importlib.import_module(module), attribute)
    return tasks


def serve_children(*, tasks: str, slots: int, memory_mb: int) -> int:
    """Compute the batches that stdin orders until it ends; runs as ``python -m workers children``."""
    use_one_thread()
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what anything prints goes to the log
    chosen = tasks_named(tasks)
    sandbox = Sandbox(slots, memory_mb=memory_mb, preload=chosen.modules())
    try:
        server = _Server(sandbox, chosen, slots, out)
        while (data := read(sys.stdin.buffer)) is not None:
            server.obey(data)
    finally:
        sandbox.close()
    return 0


@dataclass(slots=True)
class _Served:
    batch: ChildBatch
    is_stopping: bool = False

    def begun(self) -> int:
        return self.batch.begun if self.batch.is_taken else 0


class _Server:
    """Does what is ordered, and reports from a thread of its own, the only one that writes."""

    def __init__(self, sandbox: Sandbox, tasks: WorkerTasks, slots: int, out: BinaryIO) -> None:
        self._out = out
        self._news = threading.Event()
        self._warming = Warming(sandbox, tasks.warm_up, slots=slots, wake=self._news.set)
        self._pool = ChildrenPool(sandbox, tasks.computations, slots=slots, wake=self._news.set)
        self._batches: dict[str, _Served] = {}
        self._refused: list[tuple[str, BaseException]] = []
        self._warming.start()
        self._warming.go_on()
        threading.Thread(target=self._report, name="reports", daemon=True).start()

    def obey(self, data: bytes) -> None:
        document, blobs = unpack(data)
        key = str(document["key"])
        match document["order"]:
            case "start":
                request = unpack(blobs[0])
                kind, calls = calls_in(request)
                seconds, turn_seconds = (float(str(request[0][name])) for name in ("seconds", "turn_seconds"))
                try:
                    batch = self._pool.start(kind, calls, seconds=seconds, turn_seconds=turn_seconds)
                    self._batches[key] = _Served(batch)
                except (SandboxBrokenError, *BREAKAGES) as fault:
                    self._refused.append((key, fault))
            case "stop" if key in self._batches:
                self._batches[key].batch.stop()
                self._batches[key].is_stopping = True
            case "kill" if key in self._batches:
                self._batches[key].batch.kill()
        self._news.set()

    def _report(self) -> None:
        told: Mapping[str, object] = {}
        due_at = 0.0
        with suppress(OSError):  # whoever reads it has ended
            while True:
                self._news.wait(_PROGRESS_SECONDS)
                self._news.clear()
                self._end_batches()
                state = self._state()
                if time.monotonic() >= due_at or state != told:
                    write(self._out, pack({"state": state}))
                    told, due_at = state, time.monotonic() + ALIVE_SECONDS

    def _state(self) -> Mapping[str, object]:
        batches = list(self._batches.items())
        kernels = self._warming.kernels()
        # What was begun a moment ago will have ended before anybody could use that it has.
        ripe = time.monotonic() - _PROGRESS_SECONDS
        return {
            "is_ready": self._warming.is_over(),
            "fault": None if kernels is None or kernels.fault is None else str(kernels),
            "begun": {key: each.begun() for key, each in batches if each.batch.began_at < ripe},
            "stopped": {key: each.batch.stop() for key, each in batches if each.is_stopping},
            "shares": {key: each.batch.share for key, each in batches if each.batch.share},
        }

    def _end_batches(self) -> None:
        while self._refused:
            key, fault = self._refused.pop()
            write(self._out, pack({"ended": key}, [pack_fault({"begun": 0, "seconds": 0.0}, fault)]))
        for key, served in list(self._batches.items()):
            if served.batch.is_stuck:
                served.batch.kill()
            if served.batch.has_ended:
                del self._batches[key]
                write(self._out, pack({"ended": key}, [_reply(served.batch)]))


def _reply(batch: ChildBatch) -> bytes:
    """Return the outcomes of a batch that has ended, or its fault."""
    told = {"begun": batch.begun, "seconds": batch.ended_at - batch.began_at}
    try:
        return pack_outcomes(told, batch.outcomes())
    except (Exception, CancelledError) as fault:
        return pack_fault(told, fault)


@dataclass(slots=True)
class _Asked:
    """A batch whose caller waits."""

    has_ended: threading.Event = field(default_factory=threading.Event)
    reply: bytes = b""


class ChildrenProcess:
    """The user's side of a process that serves children; it is started again when it has died.

    Parameters
    ----------
    tasks, slots, memory_mb
        What :func:`serve_children` gets.
    tell
        Called from another thread with the state of the process, at least each second while it lives.
    """

    def __init__(
        self, tasks: str, slots: int, memory_mb: int, tell: Callable[[Mapping[str, object]], None]
    ) -> None:
        self._options = {"tasks": tasks, "slots": slots, "memory_mb": memory_mb}
        self._tell = tell
        self._lock = threading.Lock()
        self._asked: dict[str, _Asked] = {}
        self._process: subprocess.Popen[bytes] | None = None
        self._is_closed = threading.Event()
        threading.Thread(target=self._run, name="children", daemon=True).start()

    def compute(self, key: str, request: bytes) -> bytes:
        """Have a batch computed, and wait for its reply."""
        asked = _Asked()
        with self._lock:
            self._asked[key] = asked
        try:
            if not self._order("start", key, request):
                return pack_fault({"begun": 0, "seconds": 0.0}, ReturnedError("the children are not there"))
            asked.has_ended.wait()
            return asked.reply
        finally:
            with self._lock:
                self._asked.pop(key, None)

    def stop(self, key: str) -> None:
        """Have no other call of a batch begun."""
        self._order("stop", key)

    def kill(self, key: str) -> None:
        """End the computation of a batch."""
        self._order("kill", key)

    def close(self) -> None:
        """Kill the children."""
        self._is_closed.set()
        with self._lock:
            if self._process is not None and self._process.stdin is not None:
                with suppress(OSError):
                    self._process.stdin.close()

    def _order(self, order: str, key: str, request: bytes = b"") -> bool:
        data = pack({"order": order, "key": key}, [request])
        with self._lock:
            if self._process is None or self._process.stdin is None or key not in self._asked:
                return False
            try:
                write(self._process.stdin, data)  # type: ignore[arg-type]  # a buffered pipe is one
            except (OSError, ValueError):
                return False
        return True

    def _run(self) -> None:
        while not self._is_closed.is_set():
            process = subprocess.Popen(
                worker_command("children", **self._options),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,
            )
            with self._lock:
                self._process = process
            if self._is_closed.is_set():
                self.close()
            begun = self._listen(process)
            with self._lock:
                self._process = None
            process.kill()
            code = process.wait()
            fault = (
                ReturnedError("its Dask worker was closed")
                if self._is_closed.is_set()
                else SandboxBrokenError("the process around the child died")
            )
            with self._lock:
                for key, asked in self._asked.items():
                    told = {"begun": begun.get(key, 0), "seconds": 0.0}
                    asked.reply = pack_fault(told, fault)
                    asked.has_ended.set()
            if not self._is_closed.is_set():
                logger.warning("the process of the children ended with code %d; another one is started", code)
                self._tell({"is_ready": False, "fault": None, "begun": {}, "stopped": {}, "shares": {}})
            self._is_closed.wait(_PAUSE_SECONDS)

    def _listen(self, process: "subprocess.Popen[bytes]") -> dict[str, int]:
        """Pass on what the process says until it ends; return what had begun by then."""
        begun: dict[str, int] = {}
        assert process.stdout is not None
        with process.stdout as stream:
            while (data := read(stream)) is not None:  # type: ignore[arg-type]  # a buffered pipe is one
                document, blobs = unpack(data)
                if "ended" in document:
                    with self._lock:
                        asked = self._asked.get(str(document["ended"]))
                    if asked is not None:
                        asked.reply = blobs[0]
                        asked.has_ended.set()
                elif isinstance(state := document.get("state"), dict):
                    begun = state["begun"]
                    self._tell(state)
        return begun
