"""Estimates how long a sweep still takes from its latest chunks."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from service.jobs.chunking import CHUNK_SECONDS

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
