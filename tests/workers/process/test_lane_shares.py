"""The runner asks the store for the lanes that its worker has neglected."""

import pytest

from service.jobs.queue import Lane
from service.jobs.records import Claim, ClaimedJobs, Solved
from workers.process import runner as runner_module
from workers.process.results import JobLimits
from workers.process.runner import Runner

LIMITS = JobLimits(lease_seconds=1e6, job_seconds=1e6, memory_mb=1000, max_attempts=3, retry_seconds=0.0)
OUTCOME = Solved({"method": "quadrature"}, b"", b"")


class FakeClock:
    def __init__(self):
        self.now = 1000.0

    def monotonic(self):
        return self.now


class FakeStore:
    """Has jobs of some lanes without end, and hands them out as the real one does."""

    def __init__(self, waiting):
        self.waiting, self.handed_out, self.asked, self._number = set(waiting), [], [], 0

    def take(self, worker, count, *, lease_seconds, starved=(), together=1):
        self.asked.append(tuple(starved))
        lanes = [lane for lane in starved[:count] if lane in self.waiting]
        lanes += [min(self.waiting)] * (count - len(lanes)) if self.waiting else []
        self.handed_out += lanes
        return ClaimedJobs(tuple(map(self._claim, lanes)))

    def finish(self, claim, outcome, *, then_take=0, lease_seconds=0.0, starved=(), together=1):
        return True, self.take("worker", then_take, lease_seconds=lease_seconds, starved=starved)

    def heartbeat(self, claims, *, lease_seconds):
        return frozenset()

    def _claim(self, lane):
        self._number += 1
        return Claim(str(self._number), 1, "worker", {}, "digest", None, lane=lane)


class FakeBatch:
    begun, has_ended, ended_at, is_stuck = 1, False, 0.0, False

    def __init__(self, began_at):
        self.began_at = began_at

    def kill(self):
        pass

    def outcomes(self):
        return [OUTCOME]


class FakePool:
    """Computes nothing: a job is done when the test says so."""

    def __init__(self, slots):
        self.slots, self.batches = slots, []

    def places(self):
        return self.slots

    def start(self, *_, **__):
        self.batches.append(FakeBatch(runner_module.time.monotonic()))
        return self.batches[-1]


@pytest.fixture
def clock(monkeypatch):
    clock = FakeClock()
    monkeypatch.setattr(runner_module, "time", clock)
    return clock


def started(store, slots=1):
    runner = Runner(store, pool := FakePool(slots), name="worker", limits=LIMITS)
    runner.fill()
    return runner, pool


def finish(runner, pool, clock, seconds):
    """The jobs that run end ``seconds`` later, and others begin."""
    clock.now += seconds
    done, pool.batches = pool.batches, []
    for batch in done:
        batch.has_ended, batch.ended_at = True, clock.now
    runner.collect(refill=True)


@pytest.mark.parametrize("slots", [1, 3])
def test_sweeps_get_their_eighth_while_single_jobs_never_end(clock, slots):
    store = FakeStore({Lane.SINGLE, Lane.SWEEP})
    runner, pool = started(store, slots)
    for _ in range(400):
        finish(runner, pool, clock, 1.0)
    number = len(store.handed_out)
    assert abs(store.handed_out.count(Lane.SWEEP) - number / 8) <= 2 * slots
    assert set(store.handed_out[:slots]) == {Lane.SINGLE}


def test_a_single_job_that_comes_among_sweeps_is_the_next(clock):
    store = FakeStore({Lane.SWEEP})
    runner, pool = started(store)
    for _ in range(100):
        finish(runner, pool, clock, 1.5)
    store.waiting.add(Lane.SINGLE)
    finish(runner, pool, clock, 1.5)
    assert store.handed_out[-1] is Lane.SINGLE


def test_a_lane_in_which_nothing_waits_is_asked_once_and_saves_nothing_up(clock):
    store = FakeStore({Lane.SINGLE})
    runner, pool = started(store)
    for _ in range(80):
        finish(runner, pool, clock, 1.0)
    asked = [starved for starved in store.asked if Lane.SWEEP in starved]
    assert 5 <= len(asked) <= 12  # once in about eight seconds, since it starts from its first debt each time
    store.waiting.add(Lane.SWEEP)
    for _ in range(8):
        finish(runner, pool, clock, 1.0)
    assert store.handed_out[-8:].count(Lane.SWEEP) <= 2


def test_a_claim_that_is_lost_counts_for_the_time_it_has_had(clock):
    store = FakeStore({Lane.SINGLE, Lane.SWEEP})
    runner, _ = started(store)
    clock.now += 100.0
    runner.keep_leases()
    assert not runner.is_busy
    runner.fill()
    assert store.asked[-1] in [(Lane.SWEEP,), (Lane.LIST,)]
