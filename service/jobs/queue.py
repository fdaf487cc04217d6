"""Rules of the queue: which job a worker takes next, how many it gives to a child, and its chunks.

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

A sweep is cut into chunks; from the latest ones it is estimated how long the rest still takes. The first
chunks are small, the others take about a second each, and those at the end are smaller again.

P. Goyal, H. M. Vin, H. Cheng: Start-time Fair Queueing, IEEE/ACM Transactions on Networking 5 (1997) 690-704.
"""

import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

WAITING_CHUNKS = 16
"""Chunks of one sweep that wait in the queue, as long as there are points for them."""
PILOT_POINTS = 16
"""Points of the first chunk, which measures how long a point takes."""
CHUNK_SECONDS = 1.0
"""Seconds that a chunk should take, where few are computed at a time."""
LONGEST_SECONDS = 1.5
"""The same where many are: after two seconds a child hands back what it has not computed."""
CHUNKS_A_SECOND = 30.0
"""Chunks end no oftener while they are not the longest: one bridge of a cluster carries twice as many."""
UNKNOWN_POINT_SECONDS = CHUNK_SECONDS / PILOT_POINTS
"""Assumed seconds for a point until a chunk has measured it."""
LARGEST_CHUNK = 65_536
"""Points of a chunk at most."""
LARGEST_BLOCK = 2_000_000
"""Numbers of a chunk's series at most: 16 MB."""
PARTS = 8
"""Number of parts into which a chunk is split that failed, or was returned with much left to do."""
_LAST_SHARE = 8
"""Near the end a chunk is at most this part of what is left, so that no worker computes it alone ..."""
_SMALLEST_SHARE = 4
"""... but not smaller than this part of a chunk of CHUNK_SECONDS."""


@dataclass(frozen=True, slots=True)
class Range:
    """The points first, first + 1, ..., first + count - 1."""

    first: int
    count: int


def largest_chunk(samples: int, columns: int) -> int:
    """Return how many points a chunk may have whose series are ``columns`` times ``samples`` numbers."""
    return max(1, min(LARGEST_CHUNK, LARGEST_BLOCK // max(samples * columns, 1)))


def pilot(points: int, most: int) -> Range:
    """Return the first chunk of a sweep of so many points, where a chunk has ``most`` points at most."""
    return Range(0, min(PILOT_POINTS, most, points))


def next_size(point_seconds: float, left: int, most: int, places: int = 1) -> int:
    """Return the size of the next chunk: a point takes ``point_seconds``, ``left`` points have no chunk.

    So many ``places`` compute at a time: the more, the longer is a chunk, and the smaller at the end.
    """
    seconds = min(max(CHUNK_SECONDS, places / CHUNKS_A_SECOND), LONGEST_SECONDS)
    usual = seconds / point_seconds if point_seconds > seconds / most else float(most)
    size = min(usual, max(left / max(_LAST_SHARE, places), usual / _SMALLEST_SHARE))
    return max(1, min(int(size), most, left))


def cut(whole: Range, parts: int) -> Sequence[Range]:
    """Return ``whole`` in at most ``parts`` ranges of nearly equal size, none of them empty."""
    parts = min(parts, whole.count)
    edges = [whole.first + whole.count * k // parts for k in range(parts + 1)]
    return [Range(start, stop - start) for start, stop in itertools.pairwise(edges)]


def cut_rest(rest: Range, point_seconds: float) -> Sequence[Range]:
    """Return the rest of a partly computed chunk: in parts, if it would take much too long as one."""
    chunks = rest.count * point_seconds / CHUNK_SECONDS
    return cut(rest, min(PARTS, max(1, round(chunks))))


def further(
    next_index: int, points: int, waiting: int, point_seconds: float, most: int, places: int = 1
) -> Iterator[Range]:
    """Yield the ranges that fill up the queue, where ``waiting`` chunks are in it already."""
    while waiting < WAITING_CHUNKS and next_index < points:
        size = next_size(point_seconds, points - next_index, most, places)
        yield Range(next_index, size)
        next_index, waiting = next_index + size, waiting + 1


RECENT_SECONDS = 300.0
"""Chunks that ended longer ago do not count: points and workers may have changed since."""
PAUSE_SECONDS = 30.0
"""A longer gap in which no chunk ran is a pause: chunks before it do not count."""
TELLING_SECONDS = CHUNK_SECONDS / 5
"""Shorter attempts measure the fixed cost of a chunk rather than its points."""
LEAST_WORK = 5 * CHUNK_SECONDS
"""Enough work for an estimate from short attempts alone, since longer ones may never come."""


@dataclass(frozen=True, slots=True)
class ChunkRun:
    """One attempt at a chunk; instants in seconds by one clock."""

    started_at: float
    ended_at: float | None
    """None while it runs."""
    points: int
    """Points that it computed."""

    def until(self, now: float) -> float:
        """Return the end of the attempt, or ``now`` while it runs."""
        return now if self.ended_at is None else self.ended_at


def remaining_seconds(left: int, runs: Sequence[ChunkRun], *, since: float, now: float) -> float | None:
    """Return how long ``left`` points take at the recent speed; None if it is not known.

    ``runs`` are all attempts that ended after ``since`` and those that run. The
    speed is the number of points per second of a worker's time, times the average
    number of busy workers. A worker's first chunk is slow, since it compiles or loads
    programs: as many of the slowest chunks are left out as there are workers. The
    small chunks at the start of a sweep do not count either.
    """
    recent, begin = _since_the_last_pause(runs, since, now)
    elapsed = now - begin
    if elapsed <= 0.0:
        return None
    at_work = sum(run.until(now) - max(run.started_at, begin) for run in recent)
    ended = sorted((run for run in recent if run.ended_at is not None), key=_point_seconds)
    steady = ended[: max(0, len(ended) - math.ceil(at_work / elapsed))]
    telling = [run for run in steady if run.until(now) - run.started_at >= TELLING_SECONDS]
    points = sum(run.points for run in telling or steady)
    work = sum(run.until(now) - run.started_at for run in telling or steady)
    if not points or not (telling or work >= LEAST_WORK):
        return None
    return left * (work / points) / (at_work / elapsed)


def _since_the_last_pause(runs: Sequence[ChunkRun], since: float, now: float) -> tuple[list[ChunkRun], float]:
    """Return the attempts after the last pause, and when the first of them began, or ``since``."""
    found, begin = list[ChunkRun](), now
    for run in sorted(runs, key=lambda run: run.until(now), reverse=True):
        if begin - run.until(now) > PAUSE_SECONDS:
            break
        found.append(run)
        begin = min(begin, run.started_at)
    return found, max(begin, since)


def _point_seconds(run: ChunkRun) -> float:
    assert run.ended_at is not None
    return (run.ended_at - run.started_at) / run.points if run.points else math.inf


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
