"""People before batches: in which of three lanes a job waits, and what each lane is promised.

A worker takes single jobs before lists, and lists before chunks of sweeps. A
stream of single jobs that never ends would so stop every sweep; hence each
worker measures what it spends on each lane, and gives the lanes of batches at
least their share of it.
"""

from collections import Counter
from collections.abc import Mapping
from enum import IntEnum

from service.jobs.chunking import CHUNK_SECONDS


class Lane(IntEnum):
    """Where a job waits; of equal priority the smaller number is taken first."""

    SINGLE = 0
    """A problem that was sent alone: somebody may wait for it."""
    LIST = 1
    """A problem of a list."""
    SWEEP = 2
    """A chunk of a sweep."""


SHARES: Mapping[Lane, float] = {Lane.LIST: 1 / 8, Lane.SWEEP: 1 / 8}
"""What a lane gets, while jobs wait in it, of the time that a worker spends on it and the lanes before it."""


class LaneShares:
    """What one worker has spent on the lanes, and which lane it has neglected.

    The balance of a lane is the time that it should have had less the time that
    it has had. Above zero the lane is owed the next job. Neither side saves up:
    the balance of a lane in which nothing waits goes back to its first value,
    and a lane that had the worker for itself is in debt for its last job only.
    At first, and after each job, the lanes before it come first for as long as
    their part of the time says: seven seconds after a chunk of one second.
    """

    def __init__(self) -> None:
        self._balance = {lane: _debt(lane, CHUNK_SECONDS) for lane in SHARES}
        self._running: Counter[Lane] = Counter()

    def owed(self) -> tuple[Lane, ...]:
        """Return the lanes whose jobs come first now, the most neglected first."""
        # What runs is taken to last as long as a chunk should: two slots do not pay the same debt twice.
        due = {
            lane: self._balance[lane] + self._running[lane] * _debt(lane, CHUNK_SECONDS) for lane in SHARES
        }
        return tuple(sorted((lane for lane in due if due[lane] > 0.0), key=lambda lane: -due[lane]))

    def begin(self, lane: Lane) -> None:
        """Note that a job of the lane has begun."""
        self._running[lane] += 1

    def end(self, lane: Lane, seconds: float, *, was_owed: bool) -> None:
        """Note that a job of the lane has ended, after ``seconds`` of one slot.

        ``was_owed`` says that it was taken before others since the lane was owed it.
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
        """Note that nothing waits in a lane that is owed a job: it does not save up."""
        self._balance[lane] = min(self._balance[lane], _debt(lane, CHUNK_SECONDS))


def _debt(lane: Lane, seconds: float) -> float:
    """Return by how much ``seconds`` of its own work change the balance of a lane."""
    return -(1.0 - SHARES[lane]) * seconds
