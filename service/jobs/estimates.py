"""How long a sweep still takes, judged by what its latest chunks took."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from service.jobs.chunking import CHUNK_SECONDS

RECENT_SECONDS = 300.0
"""Chunks that ended longer ago do not count: points, workers and what else these do change."""
PAUSE_SECONDS = 30.0
"""If none of a sweep's chunks was at work for longer, nobody was there to do them, and all before is past."""
TELLING_SECONDS = CHUNK_SECONDS / 5
"""Shorter tries tell what a chunk costs whatever its size, rather than what its points take."""
LEAST_WORK = 5 * CHUNK_SECONDS
"""Seconds of work from which something can be said even by short tries: longer ones may never come."""


@dataclass(frozen=True, slots=True)
class ChunkRun:
    """One try at a chunk; instants in seconds by one clock."""

    started_at: float
    ended_at: float | None
    """None while it runs."""
    points: int
    """That it brought."""

    def until(self, now: float) -> float:
        """Return when it ended, or ``now``."""
        return now if self.ended_at is None else self.ended_at


def remaining_seconds(left: int, runs: Sequence[ChunkRun], *, since: float, now: float) -> float | None:
    """Return how long ``left`` points take if it goes on as lately; None if that cannot be said.

    ``runs`` are all tries that ended after ``since`` and those that run. The
    speed is the points in a second of a worker's time, times the workers that
    were at work on the average. A worker's first chunk brings few points, since
    it compiles or loads programs: as many of the slowest chunks are left out as
    there are workers. Nor do the small chunks count with which a sweep begins.
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
    """Return the tries after the last pause, and when the first of them began, or ``since``."""
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
