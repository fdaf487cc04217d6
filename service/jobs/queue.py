"""Rules of the queue: which job a worker takes next, and how many it gives to a child at a time.

The queue has three lanes: single jobs, lists, sweeps. A worker takes single jobs before lists, and lists
before chunks of sweeps. An endless stream of single jobs would then stop every sweep; hence each worker
measures the time that it spends on each lane, and gives lists and sweeps at least their share
(:class:`LaneShares`).

Between API keys the queue is shared by start-time fair queueing (:func:`turns`). Every job gets a number, its
turn, when it is queued; jobs of equal priority and lane are taken by turn. The turns of one key's jobs are at
least one gap apart. A key that had no jobs starts right behind the turn that was taken last: it gains nothing
by the pause, and does not wait behind the backlog of others. So keys with waiting jobs of equal gaps get one
job each in rotation, however many jobs each has queued. The gap is the expected cost of a job in seconds. It
is at least one second, so that small jobs are shared by number.

P. Goyal, H. M. Vin, H. Cheng: Start-time Fair Queueing, IEEE/ACM Transactions on Networking 5 (1997) 690-704.
"""

import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
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

    def starved(self) -> tuple[Lane, ...]:
        """Return the lanes that are owed a job, the largest balance first."""
        # A running job counts as one chunk's length, so that two slots do not pay the same debt twice.
        due = {
            lane: self._balance[lane] + self._running[lane] * _debt(lane, CHUNK_SECONDS) for lane in SHARES
        }
        return tuple(sorted((lane for lane in due if due[lane] > 0.0), key=lambda lane: -due[lane]))

    def begin(self, lane: Lane) -> None:
        """Record that a job of the lane has begun."""
        self._running[lane] += 1

    def end(self, lane: Lane, seconds: float, *, was_starved: bool) -> None:
        """Record that a job of the lane has ended, after ``seconds`` of one slot.

        ``was_starved``: it was taken out of order because the lane was owed a job.
        """
        self._running[lane] -= 1
        for behind, share in SHARES.items():
            if behind > lane:
                self._balance[behind] += share * seconds
        if lane in SHARES:
            debt, before = _debt(lane, seconds), self._balance[lane]
            least = -float("inf") if was_starved else min(before, debt, _debt(lane, CHUNK_SECONDS))
            self._balance[lane] = max(before + debt, least)

    def forget(self, lane: Lane) -> None:
        """Record that nothing waits in a lane that is owed a job: it builds up no credit."""
        self._balance[lane] = min(self._balance[lane], _debt(lane, CHUNK_SECONDS))


def _debt(lane: Lane, seconds: float) -> float:
    """Return by how much ``seconds`` of its own work change the balance of a lane."""
    return -(1.0 - SHARES[lane]) * seconds


LEAST_GAP = 1.0
LARGEST_GAP = 1000.0
"""Bounds of a gap, in seconds: a measured time can be nonsense if the clock was changed."""


def gap_for(seconds: float | None) -> float:
    """Return the gap before a job that is expected to take ``seconds``; None if unknown."""
    return LEAST_GAP if seconds is None else min(max(seconds, LEAST_GAP), LARGEST_GAP)


def turns(taken: float, last: float | None, gaps: Sequence[float]) -> list[float]:
    """Return the turns of new jobs of one key.

    Parameters
    ----------
    taken
        The largest turn that was taken of the same priority and lane, whosever it was; 0 if none was.
    last
        The largest turn that the key has there; None if it has no job there.
    gaps
        One for each of the jobs, in their order.
    """
    if not gaps:
        return []
    # Never before the turn taken last: two jobs of this key would then precede one of another key.
    start = taken + LEAST_GAP / 2
    if last is not None and last + gaps[0] > taken:
        start = last + gaps[0]
    return list(itertools.accumulate(gaps[1:], initial=start))


BATCH_SECONDS = 0.05
"""A call begins no further job after so long; nobody waits longer for a place because of a batch."""
MOST_TOGETHER = 32
_GROWTH = 4


class BatchSize:
    """The number of jobs that one worker gives to a child at a time.

    It begins with one, grows only while jobs are known to be short, and falls at once when they are not.
    """

    def __init__(self) -> None:
        self.most = 1

    def learn(self, number: int, seconds: float) -> None:
        """Record that ``number`` jobs have taken a child ``seconds`` in all.

        A smaller batch that was done in time tells nothing: most of its time may be that of the call.
        """
        if number < self.most and seconds <= BATCH_SECONDS:
            return
        fitting = int(BATCH_SECONDS * number / seconds) if seconds > 0.0 else MOST_TOGETHER
        self.most = max(1, min(fitting, _GROWTH * self.most, MOST_TOGETHER))

    def reset(self) -> None:
        """Record that a batch was not computed as one."""
        self.most = 1
