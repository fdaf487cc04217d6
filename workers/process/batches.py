"""Several short jobs that one call of a child computes, one after the other.

What a call costs around its computation (a message to the child and one back, three threads of the pool, and
a commit) is shared by all of them. Each job keeps limits of its own: parent and child share a file of two
bytes, by which the parent knows which job is being computed, and takes back those that are not.
"""

import contextlib
import logging
import os
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence

from service.jobs.records import Outcome
from service.logs import about

logger = logging.getLogger(__name__)

Call = tuple[Mapping[str, object], Sequence[object]]
"""Fields for the log, and the arguments of the computation."""

_BEGUN, _STOP = 0, 1
"""Places of the two bytes: the number of jobs that were begun, and whether no other one may be."""


class Ledger:
    """The parent's side of the file that tells how far a child is."""

    def __init__(self) -> None:
        descriptor, self.path = tempfile.mkstemp(prefix="polhode-batch-")
        self._descriptor = descriptor
        os.pwrite(descriptor, bytes(2), 0)

    def begun(self) -> int:
        """Return how many jobs the child has begun: the last of them is being computed, or is done."""
        return os.pread(self._descriptor, 1, _BEGUN)[0]

    def stop(self) -> int:
        """Have the child begin no other job; return how many it has begun at most."""
        # In this order, and the child's writes in the other: one of the two sees what the other has written.
        os.pwrite(self._descriptor, b"\1", _STOP)
        return self.begun()

    def close(self) -> None:
        """Remove the file."""
        os.close(self._descriptor)
        with contextlib.suppress(OSError):
            os.unlink(self.path)  # noqa: PTH108  # a path object for each batch costs more than this


def compute_in_turn(
    path: str, seconds: float, compute: Callable[..., Outcome], calls: Sequence[Call]
) -> list[Outcome | None]:
    """Compute jobs until all are done, ``seconds`` are over, or the parent says so; runs in the child.

    The answer has the outcomes of the first jobs: None for one that raised, which is computed again alone,
    where its fault is told.
    """
    outcomes: list[Outcome | None] = []
    end = time.monotonic() + seconds
    descriptor = os.open(path, os.O_RDWR)
    try:
        for number, (fields, given) in enumerate(calls, start=1):
            if outcomes and time.monotonic() > end:
                break
            os.pwrite(descriptor, bytes([number]), _BEGUN)
            if os.pread(descriptor, 1, _STOP) != b"\0":
                break
            with about(**fields):
                try:
                    outcomes.append(compute(*given))
                except Exception as fault:
                    logger.debug("not computed in a batch: %r", fault)
                    outcomes.append(None)
    finally:
        os.close(descriptor)
    return outcomes
