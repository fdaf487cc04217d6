"""Every point of a sweep is computed once, whatever becomes of its chunks."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import select, update

from service.jobs.records import Claim, JobState
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome, decode_points
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SweepChunkRow
from tests.support.effort import examples

ATTEMPTS = 2


@dataclass
class Workers:
    """Some workers that do to their chunks whatever they are told."""

    database: Database
    jobs: JobStore
    claims: list[Claim] = field(default_factory=list)
    lost: list[Claim] = field(default_factory=list)

    def claim(self) -> bool:
        with self.database.write() as session:
            # However long a lost job would have to wait: these workers have time.
            session.execute(update(JobRow).values(ready_at=0.0))
        claim = self.jobs.claim("worker", lease_seconds=60.0)
        if claim is not None:
            self.claims.append(claim)
        return claim is not None

    def finish(self, claim: Claim, share: float = 1.0, seconds: float = 0.01) -> bool:
        first, count = claim.problem["first"], claim.problem["count"]
        done = max(1, int(count * share))
        numbers = {"period": np.arange(first, first + done, dtype=np.float64)}
        outcome = chunk_outcome(ChunkPoints([SOLVED] * done, numbers), seconds * done)
        return self.jobs.finish(claim, outcome)[0]

    def act(self, action: str, number: float) -> None:
        if action == "claim" or not self.claims:
            self.claim()
            return
        claim = self.claims.pop(int(number * len(self.claims)))
        match action:
            case "finish":
                assert self.finish(claim, seconds=number)
            case "return some":
                assert self.finish(claim, share=number, seconds=10 * number)
            case "crash":
                assert self.jobs.lose(claim, "it died", max_attempts=ATTEMPTS)
            case "fail":
                assert self.jobs.finish_failure(claim, {"code": "memory_limit", "detail": "it was full"})
            case "stop":
                assert self.jobs.give_back(claim)
            case "be silent":
                assert self.jobs.heartbeat([claim], lease_seconds=-1.0)
                assert self.jobs.reconcile(max_attempts=ATTEMPTS) == (claim.job_id,)
                self.lost.append(claim)

    def finish_everything(self) -> None:
        while self.claims or self.claim():
            assert self.finish(self.claims.pop())


@pytest.fixture
def sweeps(database):
    return SweepStore(database)


@pytest.fixture
def workers(database, jobs):
    return Workers(database, jobs)


def submit(sweeps, points, *, most=1000, **further):
    return sweeps.submit({"axes": []}, points=points, most=most, **further)


def stored(database, sweep_id):
    statement = select(SweepChunkRow).where(SweepChunkRow.sweep_id == sweep_id).order_by(SweepChunkRow.first)
    with database.read() as session:
        return list(session.scalars(statement))


def covered(chunks):
    """The indices of the stored points, as often as they are stored."""
    return [index for chunk in chunks for index in range(chunk.first, chunk.first + chunk.count)]


ACTIONS = st.sampled_from(["claim", "claim", "finish", "return some", "crash", "fail", "stop", "be silent"])
EVENTS = st.lists(st.tuples(ACTIONS, st.floats(0.001, 0.999)), max_size=40)
WHATEVER_HAPPENS = settings(
    max_examples=examples(8, 20), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.mark.random_law
@WHATEVER_HAPPENS
@given(points=st.integers(1, 120), most=st.integers(1, 100), events=EVENTS)
def test_every_point_is_stored_once(database, jobs, sweeps, points, most, events):
    workers = Workers(database, jobs)
    sweep = submit(sweeps, points, most=most)
    for action, number in events:
        workers.act(action, number)
    workers.finish_everything()
    chunks, done = stored(database, sweep.id), sweeps.get(sweep.id)
    assert covered(chunks) == list(range(points))
    assert (done.state, done.done) == (JobState.SUCCEEDED, points)
    assert done.refused == sum(chunk.refused for chunk in chunks)
    for chunk in chunks:
        found = decode_points(chunk.data)
        assert chunk.refused == sum(outcome != SOLVED for outcome in found.outcomes)
        if chunk.refused == 0:
            assert found.numbers["period"].tolist() == list(range(chunk.first, chunk.first + chunk.count))
    for claim in workers.lost:
        assert not workers.finish(claim)


@pytest.mark.random_law
@WHATEVER_HAPPENS
@given(points=st.integers(1, 120), most=st.integers(1, 100), events=EVENTS)
def test_a_cancelled_sweep_keeps_what_is_done_and_gets_nothing_more(
    database, jobs, sweeps, points, most, events
):
    workers = Workers(database, jobs)
    sweep = submit(sweeps, points, most=most)
    for action, number in events:
        workers.act(action, number)
    before = stored(database, sweep.id)
    if sweeps.get(sweep.id).state is JobState.SUCCEEDED:
        return
    cancelled = sweeps.cancel(sweep.id)
    assert sweeps.cancel(sweep.id) == cancelled
    assert not any(workers.finish(claim) for claim in workers.claims)
    assert not workers.claim()
    after, indices = sweeps.get(sweep.id), covered(before)
    assert (after.state, after.done) == (JobState.CANCELLED, len(indices))
    assert len(set(indices)) == len(indices)
    assert covered(stored(database, sweep.id)) == indices


def test_the_queue_is_kept_filled_with_chunks_of_about_a_second(sweeps, workers, database):
    sweep = submit(sweeps, 1_000_000, most=65_536)
    assert workers.claim()
    workers.finish(workers.claims.pop(), seconds=0.002)
    for _ in range(3):
        waiting = queued(database, sweep.id)
        assert len(waiting) == 16
        assert all(0.5 <= each["count"] * 0.002 <= 2.0 for each in waiting)
        assert workers.claim()
        workers.finish(workers.claims.pop(), seconds=0.002)


def queued(database, sweep_id):
    waiting = select(JobRow.problem).where(JobRow.sweep_id == sweep_id, JobRow.state == "queued")
    with database.read() as session:
        return list(session.scalars(waiting))
