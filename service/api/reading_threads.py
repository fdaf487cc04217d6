"""Threads apart from those of the endpoints: for parsing documents, and for what monitors ask for.

Large documents are parsed one at a time.

Parsing is pure Python: more threads do not speed it up, they only take the
interpreter from the event loop. A document of a megabyte may take a second; small
ones do not wait for it.
"""

import asyncio
from collections.abc import Callable
from typing import Generic, TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")

LARGE_BYTES = 50_000
"""Larger documents are read one after the other."""
_SMALL_AT_ONCE = 4


class ReadingThreads:
    """The threads in which documents are read, off the event loop."""

    def __init__(self) -> None:
        self._small, self._large = CapacityLimiter(_SMALL_AT_ONCE), CapacityLimiter(1)

    async def run(self, size: int, function: Callable[[*Arguments], T], *arguments: *Arguments) -> T:
        """Return ``function(*arguments)``, which reads a document of ``size`` bytes."""
        limiter = self._large if size > LARGE_BYTES else self._small
        return await to_thread.run_sync(function, *arguments, limiter=limiter)


class SharedAnswer(Generic[T]):
    """Makes something for all that ask for it, never twice at the same time: it costs as much for many.

    Parameters
    ----------
    threads
        Of its own, so that it is made although all others are busy.
    """

    def __init__(self, make: Callable[[], T], threads: CapacityLimiter) -> None:
        self._make, self._threads = make, threads
        self._making: asyncio.Task[T] | None = None

    async def get(self) -> T:
        """Return what is being made, or is made now."""
        if self._making is None:
            self._making = asyncio.create_task(to_thread.run_sync(self._make, limiter=self._threads))
            self._making.add_done_callback(self._forget)
        # Whoever asked first may leave: the others still wait for it.
        return await asyncio.shield(self._making)

    def _forget(self, made: asyncio.Task[T]) -> None:
        self._making = None
        if not made.cancelled():
            made.exception()  # whoever waits is told; if nobody does, it is no fault
