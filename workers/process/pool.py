"""Pools compute batches of calls in killable children, here or elsewhere. They know neither jobs nor claims.

What a call costs around its computation (a message to the child and one back, three threads of the pool, and
a commit) is shared by all jobs of a batch. Each keeps limits of its own: it is known which one is being
computed, and those that are not can be taken back.
"""

import contextlib
import logging
import os
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any, Protocol  # Any: an outcome, or those of a batch

from service.jobs.records import JobKind, Outcome
from service.logs import about, call_about
from service.sandbox import Sandbox, result_of

logger = logging.getLogger(__name__)


Computation = Callable[..., Outcome]
"""A module-level function from the payload of a claim, as JSON text, to the outcome of the job.

If the windows of its curve are kept, their text comes second; an audit has the stored solution third. Those
of kinds that tell how far they are have last a function that is told it, from 0 to 1.
"""
Computations = Mapping[JobKind, Computation]
Call = tuple[Mapping[str, object], Sequence[object]]
"""Fields for the log, and the arguments of the computation."""

START_SECONDS = 20.0
"""Limit for a child to take a batch; starting a new child takes far less."""
TELLING = frozenset({JobKind.STUDY})
"""Kinds whose computations tell how far they are; each call of them is alone."""
_BEGUN, _STOP, _SHARE = 0, 1, 2
"""Places of the three bytes of a ledger: the number of calls begun, whether no other one may be, and how much
of the only call is done."""
_SHARES = 256
"""One byte of a share, which can be written and read at the same time: 1 is beyond what it can tell."""


class ReturnedError(Exception):
    """The pool does not compute the batch, or cannot tell; nothing of it is to blame."""


class PoolBatch(Protocol):
    """Calls that one child of a pool computes, one after the other."""

    @property
    def begun(self) -> int:
        """Number of calls begun, the last of them perhaps not done. One alone counts as begun."""
        ...

    @property
    def share(self) -> float:
        """Share of a single call that is done, as far as it tells: from 0 to less than 1."""
        ...

    @property
    def has_ended(self) -> bool:
        """Nothing more comes of it: :meth:`outcomes` does not wait."""
        ...

    @property
    def began_at(self) -> float:
        """When it began, on the clock of :func:`time.monotonic`; now, if it is not known to have."""
        ...

    @property
    def ended_at(self) -> float:
        """When it ended; now, if it has not."""
        ...

    @property
    def is_taken(self) -> bool:
        """A child has it, or had it, as far as is known."""
        ...

    @property
    def is_stuck(self) -> bool:
        """No child has taken it, though one should have long ago."""
        ...

    def stop(self) -> int:
        """Have no other call begun; return how many have been begun, or may have, as far as is known.

        It may be called again, to learn more.
        """
        ...

    def kill(self) -> None:
        """End its computation; if no child has taken it, none will."""
        ...

    def outcomes(self) -> list[Outcome | None]:
        """Return the outcomes of the first calls; None for one that raised, unless it is the only one.

        That one is computed again alone, where its fault is told.

        Raises
        ------
        SandboxError
            A limit was passed, or the child died.
        ReturnedError
            It may not have begun.
        concurrent.futures.CancelledError
            It was killed.
        Exception
            Any exception of a single call.
        """
        ...


class Pool(Protocol):
    """Places at which batches are computed, with limits of time and memory."""

    def places(self) -> int:
        """Return how many batches can be computed at the same time, now."""
        ...

    def start(
        self, kind: JobKind, calls: Sequence[Call], *, seconds: float, turn_seconds: float
    ) -> PoolBatch:
        """Have a free place compute calls of a kind, each of which may take so many seconds.

        No other one is begun when ``turn_seconds`` have passed.
        """
        ...


class Ledger:
    """The parent's side of the file of three bytes that tells how far a child is, and whether it goes on."""

    def __init__(self, begun: int = 0) -> None:
        descriptor, self.path = tempfile.mkstemp(prefix="polhode-batch-")
        self._descriptor: int | None = descriptor
        self._last = bytes([begun, 0, 0])
        self._lock = threading.Lock()
        os.pwrite(descriptor, self._last, 0)

    def begun(self) -> int:
        """Return how many calls the child has begun; once closed, had begun by then."""
        return self._read()[_BEGUN]

    def share(self) -> float:
        """Return how much of its only call the child has done, as it told last."""
        return self._read()[_SHARE] / _SHARES

    def _read(self) -> bytes:
        with self._lock:
            if self._descriptor is not None:
                self._last = os.pread(self._descriptor, len(self._last), 0)
            return self._last

    def stop(self) -> int:
        """Have the child begin no other call; return how many it has begun at most."""
        # In this order, and the child's writes in the other: one of the two sees what the other has written.
        with self._lock:
            if self._descriptor is not None:
                os.pwrite(self._descriptor, b"\1", _STOP)
        return self.begun()

    def close(self) -> None:
        """Remove the file."""
        self.begun()
        with self._lock:
            if self._descriptor is None:
                return
            os.close(self._descriptor)
            self._descriptor = None
        with contextlib.suppress(OSError):
            os.unlink(self.path)  # noqa: PTH108  # a path object for each batch costs more than this


def compute_in_turn(
    path: str, seconds: float, compute: Computation, calls: Sequence[Call]
) -> list[Outcome | None]:
    """Compute calls until all are done, ``seconds`` are over, or the parent says so; runs in the child."""
    outcomes: list[Outcome | None] = []
    end = time.monotonic() + seconds
    descriptor = os.open(path, os.O_RDWR)
    try:
        for number, (fields, arguments) in enumerate(calls, start=1):
            if outcomes and time.monotonic() > end:
                break
            os.pwrite(descriptor, bytes([number]), _BEGUN)
            if os.pread(descriptor, 1, _STOP) != b"\0":
                break
            with about(**fields):
                try:
                    outcomes.append(compute(*arguments))
                except Exception as fault:
                    logger.debug("not computed in a batch: %r", fault)
                    outcomes.append(None)
    finally:
        os.close(descriptor)
    return outcomes


def compute_telling(path: str, compute: Computation, call: Call) -> list[Outcome | None]:
    """Compute a call that tells how much of it is done; runs in the child."""
    fields, arguments = call
    descriptor = os.open(path, os.O_RDWR)
    try:
        with about(**fields):
            return [compute(*arguments, partial(_tell, descriptor))]
    finally:
        os.close(descriptor)


def _tell(descriptor: int, share: float) -> None:
    """Write how much is done, unless more was said to be."""
    told = bytes([int(min(max(share, 0.0) * _SHARES, _SHARES - 1.0))])
    if told > os.pread(descriptor, 1, _SHARE):
        os.pwrite(descriptor, told, _SHARE)


class ChildrenPool:
    """The children of a sandbox.

    Parameters
    ----------
    computations
        The function for each kind of call.
    slots
        The number of children.
    wake
        Called from another thread when a batch has ended.
    """

    def __init__(
        self,
        sandbox: Sandbox,
        computations: Computations,
        *,
        slots: int,
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        self._sandbox, self._computations = sandbox, computations
        self._slots, self._wake = slots, wake

    def places(self) -> int:
        """Return the number of children."""
        return self._slots

    def start(
        self, kind: JobKind, calls: Sequence[Call], *, seconds: float, turn_seconds: float
    ) -> "ChildBatch":
        """Queue the calls at the child that has the fewest."""
        compute = self._computations[kind]
        future: Future[Any]
        if kind in TELLING:
            (call,) = calls
            ledger = Ledger(begun=1)
            future = self._sandbox.submit(compute_telling, ledger.path, compute, call, seconds=seconds)
            return ChildBatch(self._sandbox, future, ledger, self._wake)
        if len(calls) == 1:
            ((fields, arguments),) = calls
            future = self._sandbox.submit(call_about, fields, compute, *arguments, seconds=seconds)
            return ChildBatch(self._sandbox, future, None, self._wake)
        ledger = Ledger()
        # The last call of a batch begins within that time, and may take as long as one that is alone.
        future = self._sandbox.submit(
            compute_in_turn, ledger.path, turn_seconds, compute, calls, seconds=seconds + turn_seconds
        )
        return ChildBatch(self._sandbox, future, ledger, self._wake)


class ChildBatch:
    """One call of a child; ``ledger`` is that of several calls, or of one that tells how far it is."""

    def __init__(
        self, sandbox: Sandbox, future: Future[Any], ledger: Ledger | None, wake: Callable[[], None]
    ) -> None:
        self._sandbox, self._future, self._ledger, self._wake = sandbox, future, ledger, wake
        self.began_at = time.monotonic()
        self._ended_at: float | None = None
        future.add_done_callback(self._end)

    def _end(self, _: Future[Any]) -> None:
        self._ended_at = time.monotonic()
        if self._ledger is not None:
            self._ledger.close()
        self._wake()

    @property
    def begun(self) -> int:
        """Number of calls begun."""
        return 1 if self._ledger is None else self._ledger.begun()

    @property
    def share(self) -> float:
        """Share of a single call that is done."""
        return 0.0 if self._ledger is None else self._ledger.share()

    @property
    def has_ended(self) -> bool:
        """Nothing more comes of it."""
        return self._future.done()

    @property
    def ended_at(self) -> float:
        """When it ended."""
        return self._ended_at or time.monotonic()

    @property
    def is_taken(self) -> bool:
        """A child has it, or had it."""
        return self._future.running() or self._future.done()

    @property
    def is_stuck(self) -> bool:
        """No child has taken it in time."""
        return not self.is_taken and time.monotonic() > self.began_at + START_SECONDS

    def stop(self) -> int:
        """Have no other call begun; return how many were."""
        return 1 if self._ledger is None else self._ledger.stop()

    def kill(self) -> None:
        """Kill the child, within 0.2 s; one that has taken nothing for long is replaced."""
        if self.is_stuck:
            self._sandbox.renew(self._future)
        self._future.cancel()

    def outcomes(self) -> list[Outcome | None]:
        """Return the outcomes of the first calls."""
        result = result_of(self._future)
        return [result] if self._ledger is None else result
