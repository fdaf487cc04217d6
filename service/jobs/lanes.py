"""The three lanes of the queue (single jobs, lists, sweeps), and the share of time each is guaranteed.

A worker takes single jobs before lists, and lists before chunks of sweeps. An endless
stream of single jobs would then stop every sweep; hence each worker measures the time
that it spends on each lane, and gives lists and sweeps at least their share.
"""

from collections import Counter
from collections.abc import Mapping
from enum import IntEnum

from service.jobs.chunking import CHUNK_SECONDS


class Lane(IntEnum):
    """The part of the queue that a job waits in; at equal priority the smaller number is taken first."""

    SINGLE = 0
    """A problem that was sent alone, for which a client may wait."""
    LIST = 1
    """A problem of a list."""
    SWEEP = 2
    """A chunk of a sweep."""


SHARES: Mapping[Lane, float] = {Lane.LIST: 1 / 8, Lane.SWEEP: 1 / 8}
"""The lane's share, while jobs wait in it, of a worker's time on it and the lanes before it."""


class LaneShares:
    """The time one worker has spent on each lane, and which lanes are owed a job.

    The balance of a lane is the time it should have had minus the time it has
    had; above zero, the lane is owed the next job. Neither credit nor debt builds
    up: the balance of an empty lane is reset to its first value, and a lane that
    had the worker to itself is in debt for its last job only. After each job the
    lanes before it come first for as long as their share of the time: seven
    seconds after a chunk of one second.

    Parameters
    ----------
    left
        The part of the debt of one chunk that a new worker has left, from 0 to 1. Drawn at random for each
        worker it gives all lanes their shares also where workers die before they have paid a whole debt.
    """

    def __init__(self, left: float = 1.0) -> None:
        self._balance = {lane: left * _debt(lane, CHUNK_SECONDS) for lane in SHARES}
        self._running: Counter[Lane] = Counter()

    def owed(self) -> tuple[Lane, ...]:
        """Return the lanes that are owed a job, the largest balance first."""
        # A running job counts as one chunk's length, so that two slots do not pay the same debt twice.
        due = {
            lane: self._balance[lane] + self._running[lane] * _debt(lane, CHUNK_SECONDS) for lane in SHARES
        }
        return tuple(sorted((lane for lane in due if due[lane] > 0.0), key=lambda lane: -due[lane]))

    def begin(self, lane: Lane) -> None:
        """Record that a job of the lane has begun."""
        self._running[lane] += 1

    def end(self, lane: Lane, seconds: float, *, was_owed: bool) -> None:
        """Record that a job of the lane has ended, after ``seconds`` of one slot.

        ``was_owed``: it was taken out of order because the lane was owed a job.
        """
        self._running[lane] -= 1
        for behind, share in SHARES.items():
            if behind > lane:
                self._balance[behind] += share * seconds
        if lane in SHARES:
            debt, before = _debt(lane, seconds), self._balance[lane]
            least = -float("inf") if was_owed else min(before, debt, _debt(lane, CHUNK_SECONDS))
            self._balance[lane] = max(before + debt, least)

    def forget(self, lane: Lane) -> None:
        """Record that nothing waits in a lane that is owed a job: it builds up no credit."""
        self._balance[lane] = min(self._balance[lane], _debt(lane, CHUNK_SECONDS))


def _debt(lane: Lane, seconds: float) -> float:
    """Return by how much ``seconds`` of its own work change the balance of a lane."""
    return -(1.0 - SHARES[lane]) * seconds
