"""A bounded, fair queue of verdict computations for the few child processes that run them.

A verdict may take seconds. A waiting request blocks no thread: the calls are in
a bounded queue, and as many threads as there are children take them from it.
No client can occupy all of it:

- a call is refused at once if the queue, or its key's share of it, is full;
- keys take turns, and so do single problems and lists;
- lists together, and each key, leave one child to the others;
- the time limit of a verdict includes the waiting;
- if the client of a call disconnects, the call leaves the queue or its child is stopped.
"""

import asyncio
import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, InvalidStateError
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus

from service.api.replies import ApiError
from service.sandbox import Sandbox, SandboxTimeoutError
from service.settings import Settings

Examination = Callable[[str], str]
"""A function of :mod:`service.verdicts.examination`: from a document to an answer, both as JSON text."""

_GRACE_SECONDS = 1.0
"""Extra time, after the limit, in which a child reports that it was killed; this takes 0.2 s."""
_SHARE = 2
"""One key may use half of the queue."""


@dataclass(frozen=True, slots=True)
class Claimant:
    """The client that a call is counted for. Without keys all clients are one."""

    key_id: str | None
    is_list: bool = False


@dataclass(eq=False, slots=True)
class _Call:
    """One call: waiting, then with a child, then answered."""

    examination: Examination
    text: str
    claimant: Claimant
    crashes: int
    deadline: float
    answer: Future[str] = field(default_factory=Future)
    attempt: Future[str] | None = None
    """The child's call in progress."""
    has_waited: bool = False
    is_dropped: bool = False


class VerdictQueue:
    """Gives every call for a verdict its turn. Safe between threads.

    Parameters
    ----------
    sandbox
        Has ``children`` children; its owner closes it after the queue.
    children
        Verdicts that are reached at the same time.
    settings
        Give the number of calls that may wait, and the time limit from a call to its answer.
    """

    def __init__(self, sandbox: Sandbox, settings: Settings, *, children: int) -> None:
        self._sandbox, self._settings, self._children = sandbox, settings, children
        self._lock = threading.Lock()
        self._changed = threading.Condition(self._lock)
        self._waiting: dict[Claimant, deque[_Call]] = {}
        """Clients in the order of their turns; the one served last is at the end."""
        self._running: list[_Call] = []
        self._closed = False
        self._threads = [
            threading.Thread(target=self._serve, name="verdicts", daemon=True) for _ in range(children)
        ]
        for thread in self._threads:
            thread.start()

    async def ask(
        self,
        examination: Examination,
        text: str,
        claimant: Claimant,
        *,
        crashes: int = 1,
        seconds: float | None = None,
    ) -> str:
        """Return a child's answer. Cancelling leaves the queue and stops the child.

        After a crash the call is repeated, at most ``crashes`` times. The time limit, including the wait, is
        ``seconds``, or that of verdicts if it is not given.

        Raises
        ------
        ApiError
            503: the queue is full, or no child became free in time.
        SandboxError
            It did not come to an end.
        """
        call = self._enter(_Call(examination, text, claimant, crashes, self._deadline(seconds)))
        try:
            rest = call.deadline - time.monotonic()
            return await asyncio.wait_for(asyncio.wrap_future(call.answer), rest + _GRACE_SECONDS)
        except (SandboxTimeoutError, TimeoutError) as fault:
            if call.has_waited:
                raise self.busy("no child process for verdicts became free in time") from fault
            raise SandboxTimeoutError("the time limit passed") from fault
        finally:
            self._drop(call)

    @property
    def waiting(self) -> int:
        """Number of calls that no child has taken yet."""
        with self._lock:
            return self._count_waiting()

    @property
    def is_idle(self) -> bool:
        """No child is busy."""
        with self._lock:
            return not self._running

    def close(self) -> None:
        """Stop the children's work, and tell waiting clients to try again."""
        with self._lock:
            self._closed = True
            calls = [*self._running, *(call for line in self._waiting.values() for call in line)]
            self._changed.notify_all()
        for call in calls:
            with suppress(InvalidStateError):
                call.answer.set_exception(self.busy("the service stops"))
            self._drop(call)
        for thread in self._threads:
            thread.join()

    def _deadline(self, seconds: float | None) -> float:
        return time.monotonic() + (self._settings.verdict_seconds if seconds is None else seconds)

    def _enter(self, call: _Call) -> _Call:
        claimant = call.claimant
        with self._lock:
            capacity = self._settings.verdict_places
            # If a child is free, the call does not wait: that child's thread takes it at once.
            before = self._count_waiting() - (self._children - len(self._running))
            if self._closed or before >= capacity:
                raise self.busy(f"{capacity} requests wait for verdicts; more are not accepted")
            share = max(1, capacity // _SHARE)
            if claimant.key_id is not None and self._count_before(claimant.key_id) >= share:
                raise self.busy(f"{share} requests of this key wait for verdicts; more are not accepted")
            call.has_waited = before >= 0
            self._waiting.setdefault(claimant, deque()).append(call)
            self._changed.notify()
        return call

    def _count_waiting(self, key_id: str | None = None) -> int:
        lines = self._waiting.items()
        return sum(len(line) for claimant, line in lines if key_id is None or claimant.key_id == key_id)

    def _count_before(self, key_id: str) -> int:
        at_work = sum(call.claimant.key_id == key_id for call in self._running)
        return self._count_waiting(key_id) - (self.most - at_work)

    @property
    def most(self) -> int:
        """Children that lists together, or one key, may occupy."""
        return max(1, self._children - 1)

    def busy(self, detail: str) -> ApiError:
        """Return the refusal of what was not examined and may be sent again."""
        headers = {"Retry-After": str(max(1, math.ceil(self._settings.verdict_seconds)))}
        return ApiError(HTTPStatus.SERVICE_UNAVAILABLE, "verdicts_busy", detail, headers=headers)

    def _drop(self, call: _Call) -> None:
        """Remove a call from the queue, or stop its child; do nothing if it was answered."""
        with self._lock:
            call.is_dropped = True
            line = self._waiting.get(call.claimant)
            if line is not None and call in line:
                line.remove(call)
                if not line:
                    del self._waiting[call.claimant]
            attempt = call.attempt
        if attempt is not None:
            attempt.cancel()
        call.answer.cancel()

    def _serve(self) -> None:
        """Run calls as long as the queue is open; one thread for each child."""
        while (call := self._next_call()) is not None:
            try:
                self._make(call)
            finally:
                with self._lock:
                    self._running.remove(call)
                    # A list or a key at its limit of children may get one now.
                    self._changed.notify_all()

    def _next_call(self) -> _Call | None:
        with self._lock:
            while not self._closed:
                call = self._take_turn()
                if call is not None:
                    self._running.append(call)
                    return call
                self._changed.wait()
        return None

    def _take_turn(self) -> _Call | None:
        keys = Counter(call.claimant.key_id for call in self._running)
        lists = sum(call.claimant.is_list for call in self._running)
        for claimant, line in self._waiting.items():
            has_its_share = claimant.key_id is not None and keys[claimant.key_id] >= self.most
            if has_its_share or (claimant.is_list and lists >= self.most):
                for call in line:
                    call.has_waited = True
                continue
            del self._waiting[claimant]
            call = line.popleft()
            if line:
                self._waiting[claimant] = line
            return call
        return None

    def _make(self, call: _Call) -> None:
        # The call may have been cancelled meanwhile.
        with suppress(InvalidStateError):
            try:
                call.answer.set_result(self._answer(call))
            except InvalidStateError:
                raise
            except Exception as fault:  # every exception must reach the waiting request
                call.answer.set_exception(fault)

    def _answer(self, call: _Call) -> str:
        while (rest := call.deadline - time.monotonic()) > 0:
            try:
                return self._sandbox.run(
                    call.examination,
                    call.text,
                    seconds=rest,
                    crashes=call.crashes,
                    submitted=lambda attempt: self._note(call, attempt),
                )
            except CancelledError:
                # Cancelled by this queue; or the child was replaced because of another call.
                if call.is_dropped or self._closed:
                    raise
        raise SandboxTimeoutError("the time limit passed")

    def _note(self, call: _Call, attempt: Future[str]) -> None:
        with self._lock:
            call.attempt = attempt
            is_dropped = call.is_dropped
        if is_dropped:
            attempt.cancel()
