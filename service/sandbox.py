"""Functions run in child processes that can be killed.

Neither a thread nor a signal handler can stop a computation inside a compiled
library, and some inputs crash the interpreter; a child process bears both.
Children are forked from a clean server process that has imported the heavy
modules once, so that a child that was killed is replaced within milliseconds.

A child never outlives the process that asked for it, even if that one is
killed: the kernel sends it SIGKILL when the pipe to it closes. The usual
PR_SET_PDEATHSIG would follow the fork server, which itself stays as long as
any child does.
"""

import contextlib
import fcntl
import multiprocessing
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar, TypeVarTuple  # Any: a seat does not know what its calls return

from pebble import ProcessExpired, ProcessPool

from service.logs import Logging, current_logging, start_logging

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")

_MIB = 1024 * 1024


class SandboxTimeoutError(Exception):
    """The time limit passed; the child was killed."""


class SandboxMemoryError(Exception):
    """The computation asked for more memory than its limit."""


class SandboxCrashError(Exception):
    """The child died: killed from outside, or crashed by a compiled library."""


class Sandbox:
    """Some child processes that run functions of modules, with limits of time and memory.

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
        # Children inherit it: multiprocessing starts its helpers by `python -c`, which would else import
        # whatever lies in the working folder under the name of a module, even `multiprocessing.py`.
        os.environ["PYTHONSAFEPATH"] = "1"
        self._memory_mb = memory_mb
        self._lock = threading.Lock()
        self._context = multiprocessing.get_context("forkserver")
        # With "__main__", the main module too is imported once and not by every child.
        self._context.set_forkserver_preload(["__main__", *preload])
        self._seats = [_Seat(self._new_pool()) for _ in range(workers)]

    def start(self) -> None:
        """Start the children now, so that the first call need not wait for them."""
        with self._lock:
            for seat in self._seats:
                self._usable_pool(seat)

    def submit(
        self, function: Callable[[*Arguments], T], *arguments: *Arguments, seconds: float | None
    ) -> Future[T]:
        """Queue a call of a module's function; read it with :func:`result_of`.

        Cancelling the future kills the child at work on it, within 0.2 s. The
        time limit counts from the moment a child takes the call.
        """
        with self._lock:
            seat = min(self._seats, key=_Seat.load)
            future: Future[T] = self._usable_pool(seat).schedule(function, args=arguments, timeout=seconds)
            seat.calls.append(future)
            return future

    def run(self, function: Callable[[*Arguments], T], *arguments: *Arguments, seconds: float | None) -> T:
        """Call a module's function in a child and wait; raises what :func:`result_of` raises.

        A call whose child dies is made once more: somebody else may have killed it.
        """
        try:
            return result_of(self.submit(function, *arguments, seconds=seconds))
        except SandboxCrashError:
            return result_of(self.submit(function, *arguments, seconds=seconds))

    def renew(self, future: Future[T]) -> None:
        """Replace the child that should have taken ``future`` and has not; its calls are cancelled.

        A child that is killed in the instant in which it holds the lock of its
        pipe leaves its successors waiting for that lock for ever.
        """
        with self._lock:
            for seat in self._seats:
                if future in seat.calls:
                    for call in seat.calls:
                        call.cancel()
                    self._replace_pool(seat)

    @property
    def is_idle(self) -> bool:
        """No child has anything to do."""
        with self._lock:
            return not any(seat.load() for seat in self._seats)

    def close(self) -> None:
        """Kill the children, whatever they do."""
        with self._lock:
            for seat in self._seats:
                _stop(seat.pool)

    def _usable_pool(self, seat: "_Seat") -> ProcessPool:
        """Return the pool; a new one if it broke, as it does when an idle child is killed."""
        if not seat.pool.active:
            self._replace_pool(seat)
        return seat.pool

    def _replace_pool(self, seat: "_Seat") -> None:
        _stop(seat.pool)
        seat.pool = self._new_pool()

    def _new_pool(self) -> ProcessPool:
        return ProcessPool(
            max_workers=1,
            initializer=_confine_child,
            initargs=(self._memory_mb, current_logging()),
            context=self._context,
        )


@dataclass(slots=True)
class _Seat:
    """One child with its own pipe, so that what happens to one child is nothing to the others."""

    pool: ProcessPool
    calls: list[Future[Any]] = field(default_factory=list)

    def load(self) -> int:
        """Forget the calls that are over; return the number of the others."""
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
        Whatever the function raised.
    """
    try:
        return future.result()
    except TimeoutError as fault:
        raise SandboxTimeoutError("the time limit passed") from fault
    except MemoryError as fault:
        raise SandboxMemoryError("the memory limit was reached") from fault
    except ProcessExpired as fault:
        raise SandboxCrashError(f"the child process {_cause_of_death(fault.exitcode)}") from fault
    except BrokenProcessPool as fault:
        raise SandboxCrashError("the pool of child processes broke") from fault


def _cause_of_death(exit_code: int) -> str:
    if exit_code >= 0:
        return f"ended with code {exit_code}"
    with contextlib.suppress(ValueError):
        return f"died of {signal.Signals(-exit_code).name}"
    return f"died of signal {-exit_code}"


def _stop(pool: ProcessPool) -> None:
    pool.stop()  # type: ignore[no-untyped-call]
    pool.join()


def _confine_child(memory_mb: int | None, logging: Logging | None) -> None:
    """Prepare a new child."""
    if logging is not None:
        start_logging(logging.format, logging.level)
    # Die at once when told to: a Python handler would wait for the compiled code to return.
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        _die_with(parent)
    if memory_mb is not None and sys.platform == "linux":
        _limit_memory(memory_mb * _MIB)


def _die_with(parent: BaseProcess) -> None:
    pipe = parent.sentinel
    if sys.platform == "linux":
        fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    # Elsewhere a thread must do; it has to wait for compiled code that holds the interpreter.
    # Here it covers a parent that died before the signal was set up.
    threading.Thread(target=_kill_self_after, args=(parent,), daemon=True).start()


def _kill_self_after(parent: BaseProcess) -> None:
    parent.join()
    os.kill(os.getpid(), signal.SIGKILL)


def _limit_memory(extra: int) -> None:
    """Limit the private writable memory: address space alone is reserved freely by threads and compilers."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    line = next(line for line in status.splitlines() if line.startswith("VmData:"))
    limit = int(line.split()[1]) * 1024 + extra
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
