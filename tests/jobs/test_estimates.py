"""How long a sweep still takes: what is told is held against what a simulated installation then takes."""

import heapq
from dataclasses import dataclass
from itertools import count

import numpy as np
import pytest

from service.jobs.queue import (
    PAUSE_SECONDS,
    PILOT_POINTS,
    RECENT_SECONDS,
    WAITING_CHUNKS,
    ChunkRun,
    Range,
    further,
    remaining_seconds,
)

MOST = 65_536


@dataclass
class Installation:
    """Workers that do the chunks of one sweep, by a clock of their own."""

    points: int
    workers: int
    point_seconds: float
    start_up: float = 1.0
    """Seconds that a worker's first chunk takes beside its points."""
    per_chunk: float = 0.02
    pause: tuple[float, float] = (0.0, 0.0)
    """Between these instants no chunk is begun."""
    share: int = 1
    """Number of turns of the workers of which the sweep has one."""

    def run(self) -> tuple[list[ChunkRun], float]:
        """Return all tries but the first chunk's, and when the last ended."""
        waiting, next_index, known = [Range(0, PILOT_POINTS)], PILOT_POINTS, 1.0 / PILOT_POINTS
        free = [(0.0, worker) for worker in range(self.workers)]
        begun: set[int] = set()
        runs, done, ends = list[ChunkRun](), 0, list[tuple[float, int, float]]()
        while done < self.points:
            now, worker = heapq.heappop(free)
            while ends and ends[0][0] <= now:
                _, brought, known = heapq.heappop(ends)
                done += brought
                for each in further(next_index, self.points, len(waiting), known, MOST):
                    waiting.append(each)
                    next_index = each.first + each.count
            if not waiting:
                if not ends:
                    break
                heapq.heappush(free, (ends[0][0], worker))
                continue
            if self.pause[0] <= now < self.pause[1]:
                heapq.heappush(free, (self.pause[1], worker))
                begun.clear()
                continue
            chunk = waiting.pop(0)
            assert len(waiting) <= WAITING_CHUNKS
            took = self.per_chunk + chunk.count * self.point_seconds
            took += 0.0 if worker in begun else self.start_up
            begun.add(worker)
            if chunk.first:
                runs.append(ChunkRun(now, now + took, chunk.count))
            heapq.heappush(ends, (now + took, chunk.count, took / chunk.count))
            heapq.heappush(free, (now + took * self.share, worker))
        return runs, max(run.until(0.0) for run in runs)


def told_at(now: float, runs: list[ChunkRun], points: int) -> float | None:
    """Return what the service tells at an instant, at which it knows nothing of the future."""
    since = now - RECENT_SECONDS
    known = [
        ChunkRun(run.started_at, run.ended_at, run.points)
        if run.until(now) <= now
        else ChunkRun(run.started_at, None, 0)
        for run in runs
        if run.started_at <= now and run.until(now) > since
    ]
    done = PILOT_POINTS + sum(run.points for run in runs if run.until(now) <= now)
    return remaining_seconds(points - done, known, since=since, now=now)


def told(installation: Installation):
    """Return instants, what is told at each (NaN for nothing) and what it really takes from there."""
    runs, end = installation.run()
    instants = np.arange(0.25, end, 0.75)
    estimates = [told_at(float(now), runs, installation.points) for now in instants]
    return instants, np.array([np.nan if each is None else each for each in estimates]), end - instants


@pytest.mark.one_in(4)
@pytest.mark.parametrize("workers", [1, 2, 7])
@pytest.mark.parametrize("point_seconds", [1e-4, 5e-3, 0.4])
@pytest.mark.parametrize("start_up", [0.0, 1.0, 20.0])
def test_it_is_told_soon_and_right(workers, point_seconds, start_up):
    points = round(60.0 * workers / point_seconds)
    instants, estimates, truth = told(Installation(points, workers, point_seconds, start_up))
    # Chunks are small at first, and have their price whatever their size: never far off all the same.
    assert np.nanmax(estimates / (truth + 1.0)) <= 3.0
    # One worker starts and does the first 16 points alone, then the others start.
    late = instants > 2 * start_up + 16 * point_seconds + 10.0
    assert not np.isnan(estimates[late]).any()
    assert np.all(np.abs(estimates - truth)[late] <= 0.35 * truth[late] + 2.0)


def test_the_start_of_the_workers_is_not_taken_for_the_speed_of_points():
    # What was told once: 16 points in 0.7 s, hence 446 s for 10 000 that take ten.
    installation = Installation(10_000, 1, 1e-3, start_up=0.7)
    _, estimates, truth = told(installation)
    assert np.nanmax(estimates) <= 2.0 * truth[0]


def test_a_pause_of_the_workers_is_no_work():
    night = 400.0
    installation = Installation(60_000, 2, 2e-3, pause=(20.0, 20.0 + night))
    instants, estimates, truth = told(installation)
    asleep = (instants > 25.0 + PAUSE_SECONDS) & (instants < 20.0 + night)
    assert np.isnan(estimates[asleep]).all()
    awake = instants > 30.0 + night
    assert not np.isnan(estimates[awake]).any()
    late = awake & (truth > 5.0)
    assert np.all(np.abs(estimates - truth)[late] <= 0.35 * truth[late] + 2.0)


def test_workers_that_are_shared_take_longer():
    alone = Installation(30_000, 2, 2e-3)
    shared = Installation(30_000, 2, 2e-3, share=3)
    for installation in (alone, shared):
        instants, estimates, truth = told(installation)
        late = (instants > 10.0) & (truth > 6.0)
        assert np.all(np.abs(estimates - truth)[late] <= 0.35 * truth[late] + 3.0)


def test_points_that_become_slower_are_noticed():
    runs, instants = list[ChunkRun](), count()
    for _ in range(400):
        now = float(next(instants))
        runs.append(ChunkRun(now, now + 1.0, 1000))
    for _ in range(400):
        now = float(next(instants))
        runs.append(ChunkRun(now, now + 1.0, 10))
    points = PILOT_POINTS + sum(run.points for run in runs) + 10_000
    assert told_at(400.0, runs, points) == pytest.approx(14.0, rel=1e-9)
    # All that counts is of the slow kind by now.
    assert told_at(800.0, runs, points) == pytest.approx(1000.0, rel=1e-9)


def test_nothing_is_told_of_what_nobody_has_done():
    assert remaining_seconds(10, [], since=0.0, now=100.0) is None
    assert remaining_seconds(10, [ChunkRun(90.0, None, 0)], since=0.0, now=100.0) is None
    assert remaining_seconds(10, [ChunkRun(99.9, 100.0, 5)] * 2, since=0.0, now=100.0) is None


def test_chunks_that_are_always_short_tell_in_the_end():
    runs = [ChunkRun(k / 20, (k + 1) / 20, 2) for k in range(200)]
    assert told_at(10.0, runs, PILOT_POINTS + 400 + 80) == pytest.approx(2.0, rel=1e-9)
