"""Runs functions in child processes that can be killed, with limits of time and memory.

Neither a thread nor a signal handler can stop a computation inside a compiled
library, and some inputs crash the interpreter; a child process contains both.
Children are forked from a clean server process that has imported the heavy
modules once, so that a killed child is replaced within milliseconds.

A child never outlives the process that asked for it, even if that process is killed: the kernel sends it
SIGKILL when the pipe to it closes. PR_SET_PDEATHSIG alone is not enough, since it follows the fork server,
which lives as long as any child. It is set too: children that have lost their fork server cannot be
monitored, and would go on taking calls from the pipe of their successors.
"""

import contextlib
import ctypes
import fcntl
import multiprocessing
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar, TypeVarTuple  # Any: the return types of the calls are not known here

from pebble import ProcessExpired, ProcessPool

from service.logs import Logging, current_logging, start_logging
from service.startup import keep_what_is_loaded

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")


START_SECONDS = 30.0
"""A free child that has not taken a call by then is stuck; importing the heavy modules takes less."""
_LOOK_SECONDS = 0.5
"""How often a waiting caller checks that its call can still finish."""
_RENEWALS = 3
"""How often a call is repeated because the processes around it died."""
_FORK_SERVER_LOST = 255
"""Exit code that multiprocessing reports for children whose fork server was killed."""
_MB, _MIB = 10**6, 1024 * 1024
_PR_SET_PDEATHSIG = 1
BREAKAGES = (OSError, EOFError, RuntimeError, BrokenProcessPool)
"""Raised by starting a child, or passing it a call, when the processes around it have died."""


class SandboxError(Exception):
    """A call did not come to an end in its child."""


class SandboxTimeoutError(SandboxError):
    """The time limit passed; the child was killed."""


class SandboxMemoryError(SandboxError):
    """The computation asked for more memory than its limit."""


class SandboxCrashError(SandboxError):
    """The child died: killed from outside, or crashed by a compiled library."""


class SandboxBrokenError(SandboxCrashError):
    """A process around the child died, such as the fork server; the computation did not cause it."""


class Sandbox:
    """Child processes that run module-level functions, with limits of time and memory.

    Parameters
    ----------
    workers
        Number of children.
    memory_mb
        Private memory a child may take beyond what it has when idle, in MiB;
        None for no limit. Only Linux can enforce it.
    preload
        Names of modules that the fork server imports once for all children.
    """

    def __init__(self, workers: int, *, memory_mb: int | None = None, preload: Sequence[str] = ()) -> None:
        # Children inherit it: multiprocessing starts its helpers by `python -c`, which would otherwise
        # import a file of the working folder in place of a module, even `multiprocessing.py`.
        os.environ["PYTHONSAFEPATH"] = "1"
        self._memory_mb = memory_mb
        self._lock = threading.Lock()
        self.is_closed = False
        self._context = multiprocessing.get_context("forkserver")
        # "__main__" makes the fork server import the main module once, instead of every child.
        self._context.set_forkserver_preload(["service.gc_tuning", "__main__", *preload])
        self._seats = [_Seat(self._new_pool()) for _ in range(workers)]
        self._leaving: list[ProcessPool] = []
        """Children without a slot: not there yet, or with a last call."""

    def start(self) -> None:
        """Start the children now, so that the first call need not wait for them."""
        with self._lock:
            for seat in self._seats if not self.is_closed else ():
                # If the pool cannot start now, the first call makes a new one.
                with contextlib.suppress(*BREAKAGES):
                    self._usable_pool(seat)

    def submit(
        self,
        function: Callable[[*Arguments], T],
        *arguments: *Arguments,
        seconds: float | None,
        slot: int | None = None,
    ) -> Future[T]:
        """Queue a call of a module-level function; :func:`result_of` returns its result.

        It goes to the child of ``slot``, or else to the one with the fewest calls. The time limit starts when
        the child takes it. Cancelling the future kills the child that computes it, within 0.2 s.
        """
        with self._lock:
            if self.is_closed:
                raise SandboxBrokenError("the children have been stopped for good")
            seat = min(self._seats, key=_Seat.load) if slot is None else self._seats[slot]
            for _ in range(_RENEWALS):
                try:
                    future: Future[T] = self._usable_pool(seat).schedule(
                        function, args=arguments, timeout=seconds
                    )
                except BREAKAGES as fault:
                    cause = fault
                    self._replace_pool(seat)
                else:
                    seat.calls.append(future)
                    return future
        raise SandboxBrokenError("no child process can be started") from cause

    def run(
        self,
        function: Callable[[*Arguments], T],
        *arguments: *Arguments,
        seconds: float | None,
        crashes: int = 1,
        submitted: Callable[[Future[T]], None] | None = None,
        slot: int | None = None,
    ) -> T:
        """Call a module-level function in a child and wait; raises what :func:`result_of` raises.

        A call whose child dies is repeated, at most ``crashes`` times, since the child may have been killed
        from outside. A call lost because the processes around the child died is repeated some times
        more. ``submitted`` is called with the future of every try.
        """
        breakages = 0
        while True:
            try:
                future = self.submit(function, *arguments, seconds=seconds, slot=slot)
                if submitted is not None:
                    submitted(future)
                return self._wait_for(future, seconds)
            except SandboxBrokenError:
                breakages += 1
                if breakages > _RENEWALS:
                    raise
                self._replace_idle()
            except SandboxCrashError:
                crashes -= 1
                if crashes < 0:
                    raise

    def _wait_for(self, future: Future[T], seconds: float | None) -> T:
        """Return the result of a call; raises if it can no longer finish."""
        start_by = time.monotonic() + START_SECONDS
        while not wait([future], timeout=_LOOK_SECONDS).done:
            if self._is_lost(future, late=time.monotonic() > start_by):
                self.renew(future)
                raise SandboxBrokenError("the call was lost with the processes that should have run it")
            if seconds is not None and time.monotonic() > start_by + seconds:
                self.renew(future)
                raise SandboxTimeoutError("the child could not be stopped at the time limit")
        return result_of(future)

    def _replace_idle(self) -> None:
        """Give free slots new processes and pipes: the old children may have died holding a lock."""
        with self._lock:
            for seat in self._seats:
                if not seat.load():
                    self._replace_pool(seat)

    def _is_lost(self, future: Future[T], *, late: bool) -> bool:
        """No process is left to run the call, or a free child should have taken it long ago."""
        with self._lock:
            for seat in self._seats:
                if future in seat.calls:
                    idle = seat.load() == 1 and not future.running()
                    return not future.done() and (not seat.pool.active or (late and idle))
        return not future.done()

    def renew(self, future: Future[T]) -> None:
        """Replace the child that has not taken ``future``; its calls are cancelled.

        A child that is killed while it holds the lock of its pipe leaves its
        successors waiting for that lock for ever.
        """
        with self._lock:
            for seat in self._seats:
                if future in seat.calls:
                    for call in seat.calls:
                        call.cancel()
                    self._replace_pool(seat)

    @property
    def is_idle(self) -> bool:
        """No child is running a call."""
        with self._lock:
            return not any(seat.load() for seat in self._seats)

    def replace(self, number: int, prepare: Callable[[], object], *, seconds: float) -> None:
        """Replace the child of a slot by a new one that has called ``prepare``; wait for the old one's calls.

        Raises what :func:`result_of` raises; then the old child stays.
        """
        with self._lock:
            if self.is_closed:
                raise SandboxBrokenError("the children have been stopped for good")
            new = self._new_pool()
            self._leaving.append(new)  # until it has a slot it is closed from here
        try:
            _prepare(new, prepare, seconds)
        except BaseException:
            with self._lock:
                self._leaving.remove(new)
            stop(new)
            raise
        with self._lock:
            seat = self._seats[number]
            old, calls = seat.pool, list(seat.calls)
            if not self.is_closed:
                seat.pool = new
                self._leaving.remove(new)
                self._leaving.append(old)
        wait(calls)
        stop(old)
        with self._lock, contextlib.suppress(ValueError):
            self._leaving.remove(old)

    def close(self) -> None:
        """Kill the children; no others are started."""
        with self._lock:
            self.is_closed = True
            for pool in (*(seat.pool for seat in self._seats), *self._leaving):
                stop(pool)

    def _usable_pool(self, seat: "_Seat") -> ProcessPool:
        """Return the pool; a new one if it broke, as it does when an idle child is killed."""
        if not seat.pool.active:
            self._replace_pool(seat)
        return seat.pool

    def _replace_pool(self, seat: "_Seat") -> None:
        stop(seat.pool)
        seat.pool = self._new_pool()

    def _new_pool(self) -> ProcessPool:
        return ProcessPool(
            max_workers=1,
            initializer=confine_child,
            initargs=(self._memory_mb, current_logging()),
            context=self._context,
        )


@dataclass(slots=True)
class _Seat:
    """One child with its own pipe, so that a fault in one child does not affect the others."""

    pool: ProcessPool
    calls: list[Future[Any]] = field(default_factory=list)

    def load(self) -> int:
        """Remove the finished calls; return the number of the others."""
        self.calls = [call for call in self.calls if not call.done()]
        return len(self.calls)


def result_of(future: Future[T]) -> T:
    """Wait for a submitted call and return its value.

    Raises
    ------
    SandboxTimeoutError, SandboxMemoryError, SandboxCrashError
        A limit was passed, or the child died.
    concurrent.futures.CancelledError
        The future was cancelled.
    Exception
        Any exception of the function.
    """
    try:
        return future.result()
    except TimeoutError as fault:
        raise SandboxTimeoutError("the time limit passed") from fault
    except MemoryError as fault:
        raise SandboxMemoryError("the memory limit was reached") from fault
    except ProcessExpired as fault:
        if fault.exitcode == _FORK_SERVER_LOST:
            raise SandboxBrokenError("the fork server of the child process died") from fault
        raise SandboxCrashError(f"the child process {cause_of_death(fault.exitcode)}") from fault
    except BrokenProcessPool as fault:
        # Also where the child itself died so early that its pool had not yet read that it took the call.
        raise SandboxBrokenError(
            "the child process died before it was known to run the call, or its pool broke"
        ) from fault


def _prepare(pool: ProcessPool, prepare: Callable[[], object], seconds: float) -> None:
    """Have the child of a new pool call ``prepare``."""
    give_up_at = time.monotonic() + START_SECONDS + seconds
    try:
        future: Future[object] = pool.schedule(prepare, timeout=seconds)
    except BREAKAGES as fault:
        raise SandboxBrokenError("no child process can be started") from fault
    while not wait([future], timeout=_LOOK_SECONDS).done:
        if not pool.active or time.monotonic() > give_up_at:
            raise SandboxBrokenError("the new child ended before it was ready")
    result_of(future)


def stop(pool: ProcessPool) -> None:
    """Kill the children of a pool, and wait for its threads."""
    with contextlib.suppress(*BREAKAGES):
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()


def cause_of_death(exit_code: int) -> str:
    """Return in words how a process ended."""
    if exit_code >= 0:
        return f"ended with code {exit_code}"
    with contextlib.suppress(ValueError):
        return f"died of {signal.Signals(-exit_code).name}"
    return f"died of signal {-exit_code}"


def lack_of_room(*, tasks: int, megabytes: int) -> str | None:
    """Return which limit of the system is too low for so many processes and threads, or so many megabytes.

    Without this a start would fail anywhere, and say so in a dozen ways. None if there is room.
    """
    most, _ = resource.getrlimit(resource.RLIMIT_NPROC)
    # The kernel does not count those of root.
    if os.geteuid() != 0 and most != resource.RLIM_INFINITY and most < tasks:
        return f"the limit of {most} processes and threads (ulimit -u) is too low: {tasks} are needed"
    room, _ = resource.getrlimit(resource.RLIMIT_AS)
    if room != resource.RLIM_INFINITY and room < megabytes * _MB:
        limit = f"the limit of {room // _MB} MB of address space (ulimit -v)"
        return f"{limit} is too low: {megabytes} MB are needed"
    return None


def confine_child(memory_mb: int | None, logging: Logging | None) -> None:
    """Prepare a new child."""
    keep_what_is_loaded()
    if logging is not None:
        start_logging(logging.format, logging.level)
    # Die at once on SIGTERM: a Python handler would wait for compiled code to return.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    # Ctrl-C in a terminal reaches every process; the parent decides when its children stop.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        _die_with(parent)
    if memory_mb is not None and sys.platform == "linux":
        _limit_memory(memory_mb * _MIB)


def _die_with(parent: BaseProcess) -> None:
    pipe = parent.sentinel
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))  # with the fork server, too
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    # Elsewhere a thread watches the pipe; it has to wait for compiled code that holds the interpreter.
    # Here it covers a parent that died before the signal was set up.
    threading.Thread(target=_kill_self_after, args=(parent,), daemon=True).start()


def _kill_self_after(parent: BaseProcess) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGKILL)


def _limit_memory(extra: int) -> None:
    """Limit the private writable memory: threads and compilers reserve address space freely."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmData:"))
    limit = int(line.split()[1]) * 1024 + extra
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
