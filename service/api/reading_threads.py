"""Threads for parsing documents, separate from those for the database; large documents one at a time.

Parsing is pure Python: more threads do not speed it up, they only take the
interpreter from the event loop. A document of a megabyte may take a second; small
ones do not wait for it.
"""

from collections.abc import Callable
from typing import TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")

LARGE_BYTES = 50_000
"""Larger documents are read one after the other."""
_SMALL_AT_ONCE = 4


class ReadingThreads:
    """Where documents are read, off the event loop."""

    def __init__(self) -> None:
        self._small, self._large = CapacityLimiter(_SMALL_AT_ONCE), CapacityLimiter(1)

    async def run(self, size: int, function: Callable[[*Arguments], T], *arguments: *Arguments) -> T:
        """Return ``function(*arguments)``, which reads a document of ``size`` bytes."""
        limiter = self._large if size > LARGE_BYTES else self._small
        return await to_thread.run_sync(function, *arguments, limiter=limiter)
