"""Cuts a sweep into chunks, and estimates from the latest ones how long the rest still takes.

The first chunks are small, the others take about a second each, and those at the end are smaller again.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

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
