"""Whatever clients and workers do, in any order and however late: the store does what a small model does."""

from dataclasses import dataclass, field

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    Bundle,
    RuleBasedStateMachine,
    invariant,
    multiple,
    rule,
    run_state_machine_as_test,
)
from sqlalchemy import event, func, select

from service.jobs.records import (
    MOST_DOUBTS,
    AttemptOutcome,
    Claim,
    JobFinishedError,
    JobState,
    Refused,
    Solved,
    pause_after,
)
from service.storage.jobs import rows
from service.storage.jobs.job_store import JobStore
from service.storage.tables.base import DatabaseNow
from service.storage.tables.operations import TABLES
from service.storage.tables.solutions import SolutionRow
from tests.support.effort import examples
from tests.support.lists import list_jobs

LEASE, RETRY, MAX_ATTEMPTS = 10.0, 4.0, 3
SUCCESS = Solved({"method": "quadrature"}, b"dense", b"samples")
FAILURE = Refused({"code": "no_motion", "detail": "there is none"})


class FakeClock:
    """In place of the database's: tells what it is told."""

    def __init__(self, engine):
        self.now = 1e9
        self._sql = str(DatabaseNow().compile(dialect=engine.dialect))
        event.listen(engine, "before_cursor_execute", self._rewrite, retval=True)

    def _rewrite(self, connection, cursor, statement, parameters, context, executemany):
        return statement.replace(self._sql, f"CAST({self.now!r} AS double precision)"), parameters


@dataclass
class Model:
    """What is known of a job."""

    id: str
    digest: str
    priority: int
    state: JobState = JobState.QUEUED
    ready_at: float = 0.0
    lease_until: float = 0.0
    began_at: float = 0.0
    claim: Claim | None = None
    reused: bool = False
    alone: bool = False
    has_begun: bool = False
    outcomes: list = field(default_factory=list)

    def end(self, state, outcome, ready_at=0.0):
        self.state, self.claim, self.ready_at = state, None, max(ready_at, self.ready_at)
        self.outcomes[-1] = outcome

    def lose(self, now, *, in_doubt):
        if in_doubt:
            self.alone = True
            self.end(JobState.QUEUED, AttemptOutcome.RETURNED)
            return
        self.alone = True
        losses = 1 + self.outcomes.count(AttemptOutcome.LOST)
        state = JobState.QUEUED if losses < MAX_ATTEMPTS else JobState.FAILED
        self.end(state, AttemptOutcome.LOST, now + pause_after(losses, RETRY, 0.0))


class JobMachine(RuleBasedStateMachine):
    claims = Bundle("claims")

    def __init__(self, database, clock):
        super().__init__()
        with database.write() as session:
            for table in reversed(TABLES):
                session.execute(table.__table__.delete())
        self.database, self.clock, self.store = database, clock, JobStore(database)
        self.jobs: dict[str, Model] = {}
        self.solved: set[str] = set()
        self.unended: list[tuple[str, str, float]] = []

    def holder(self, claim):
        """The job of which ``claim`` holds, None if it was lost."""
        job = self.jobs[claim.job_id]
        return job if job.claim == claim else None

    def note(self, job, worker):
        """Note that an attempt ends without a result."""
        self.unended.append((worker, job.id, self.clock.now))

    def is_in_doubt(self, job):
        worker = job.claim.worker
        others = [each for each in self.jobs.values() if each is not job and each.claim is not None]
        ended = [at for by, other, at in self.unended if by == worker and other != job.id]
        beside = any(each.claim.worker == worker for each in others)
        beside = beside or any(at >= job.began_at for at in ended)
        return not job.alone or (
            (beside or not job.has_begun) and job.outcomes.count(AttemptOutcome.RETURNED) < MOST_DOUBTS
        )

    def expect_taken(self, worker, count, taken):
        """Compare what was taken with the head of the queue; return the claims."""
        waiting = [
            j for j in self.jobs.values() if j.state is JobState.QUEUED and j.ready_at <= self.clock.now
        ]
        head = sorted(waiting, key=lambda job: (-job.priority, job.id))[:count]
        again = [job for job in head if job.digest in self.solved]
        assert list(taken.reused) == [job.id for job in again]
        assert [claim.job_id for claim in taken.claims] == [job.id for job in head if job not in again]
        for job in head:
            job.outcomes.append(None)
        for job in again:
            job.reused = True
            job.end(JobState.SUCCEEDED, AttemptOutcome.SUCCEEDED)
        for claim in taken.claims:
            job = self.jobs[claim.job_id]
            assert (claim.worker, claim.attempt, claim.alone) == (worker, len(job.outcomes), job.alone)
            job.state, job.claim, job.lease_until = JobState.RUNNING, claim, self.clock.now + LEASE
            job.began_at, job.has_begun = self.clock.now, False
        return multiple(*taken.claims)

    @rule(digests=st.lists(st.sampled_from("abc"), min_size=1, max_size=3), priority=st.integers(-1, 1))
    def submit(self, digests, priority):
        problems = [({"digest": digest}, digest) for digest in digests]
        for job, digest in zip(self.store.submit_many(problems, priority=priority), digests, strict=True):
            model = self.jobs[job.id] = Model(job.id, digest, priority)
            if digest in self.solved:
                model.state, model.reused = JobState.SUCCEEDED, True

    @rule(target=claims, worker=st.sampled_from(["first", "second"]), count=st.integers(1, 3))
    def take(self, worker, count):
        return self.expect_taken(worker, count, self.store.take(worker, count, lease_seconds=LEASE))

    @rule(target=claims, claim=claims, then_take=st.integers(0, 2))
    def succeed(self, claim, then_take):
        kept, taken = self.store.finish(claim, SUCCESS, then_take=then_take, lease_seconds=LEASE)
        job = self.holder(claim)
        assert kept == (job is not None)
        if job is not None:
            job.end(JobState.SUCCEEDED, AttemptOutcome.SUCCEEDED)
            self.solved.add(job.digest)
        return self.expect_taken(claim.worker, then_take, taken)

    @rule(target=claims, first=claims, second=claims, fails=st.booleans(), then_take=st.integers(0, 2))
    def end_two(self, first, second, fails, then_take):
        if first.worker != second.worker or first.job_id == second.job_id:
            return multiple()
        ended = [(first, SUCCESS), (second, FAILURE if fails else SUCCESS)]
        kept, taken = self.store.finish_problems(ended, then_take=then_take, lease_seconds=LEASE)
        holders = {claim.job_id: self.holder(claim) for claim, _ in ended}
        assert kept == {job_id for job_id, job in holders.items() if job is not None}
        for claim, outcome in ended:
            job = holders[claim.job_id]
            if job is not None and outcome is SUCCESS:
                job.end(JobState.SUCCEEDED, AttemptOutcome.SUCCEEDED)
                self.solved.add(job.digest)
            elif job is not None:
                job.end(JobState.FAILED, AttemptOutcome.FAILED)
        return self.expect_taken(first.worker, then_take, taken)

    @rule(claim=claims)
    def fail(self, claim):
        job = self.holder(claim)
        assert self.store.finish(claim, FAILURE)[0] == (job is not None)
        if job is not None:
            job.end(JobState.FAILED, AttemptOutcome.FAILED)

    @rule(claim=claims, has_begun=st.booleans())
    def lose(self, claim, has_begun):
        job = self.holder(claim)
        limits = {"max_attempts": MAX_ATTEMPTS, "retry_seconds": RETRY}
        lost = self.store.lose(claim, "died", has_begun=has_begun, **limits)
        assert lost == (job is not None)
        if job is not None:
            in_doubt = not has_begun and self.is_in_doubt(job)
            self.note(job, claim.worker)
            job.lose(self.clock.now, in_doubt=in_doubt)

    @rule(claim=claims)
    def give_back(self, claim):
        job = self.holder(claim)
        assert self.store.give_back(claim) == (job is not None)
        if job is not None:
            self.note(job, claim.worker)
            job.end(JobState.QUEUED, AttemptOutcome.RETURNED)

    @rule(claim=claims)
    def heartbeat(self, claim):
        job = self.holder(claim)
        assert bool(self.store.heartbeat([claim], lease_seconds=LEASE)) == (job is not None)
        if job is not None:
            job.lease_until = self.clock.now + LEASE

    @rule(claim=claims)
    def note_begun(self, claim):
        job = self.holder(claim)
        self.store.note_begun(claim)
        if job is not None:
            job.has_begun = True

    @rule(claim=claims)
    def cancel(self, claim):
        job = self.jobs[claim.job_id]
        if job.state in (JobState.SUCCEEDED, JobState.FAILED):
            with pytest.raises(JobFinishedError):
                self.store.cancel(job.id)
            return
        assert self.store.cancel(job.id).state is JobState.CANCELLED
        if job.state is JobState.RUNNING:
            job.end(JobState.CANCELLED, AttemptOutcome.CANCELLED)
        job.state = JobState.CANCELLED

    @rule(seconds=st.sampled_from([0.5, 3.0, 4.0, 10.0, 10.5, 60.0]))
    def wait(self, seconds):
        self.clock.now += seconds

    @rule()
    def reconcile(self):
        running = [job for job in self.jobs.values() if job.state is JobState.RUNNING]
        expired = [job for job in running if job.lease_until < self.clock.now]
        found = self.store.reconcile(max_attempts=MAX_ATTEMPTS, retry_seconds=RETRY)
        assert set(found) == {job.id for job in expired}
        # In their order, as each may be the last one of its worker.
        for job in (self.jobs[job_id] for job_id in found):
            in_doubt = self.is_in_doubt(job)
            self.note(job, job.claim.worker)
            job.lose(self.clock.now, in_doubt=in_doubt)

    @invariant()
    def the_store_is_the_model(self):
        stored = {job.id: job for job in list_jobs(self.store, limit=1000).jobs}
        assert stored.keys() == self.jobs.keys()
        held = self.store.held([job.claim for job in self.jobs.values() if job.claim is not None])
        for job in self.jobs.values():
            found = stored[job.id]
            assert (found.state, found.attempt, found.reused) == (job.state, len(job.outcomes), job.reused)
            assert (found.solution_id is not None) == (job.state is JobState.SUCCEEDED)
            assert (job.id in held) == (job.state is JobState.RUNNING)
            if job.outcomes:
                assert [attempt.outcome for attempt in self.store.attempts(job.id)] == job.outcomes
        computed = sum(job.state is JobState.SUCCEEDED and not job.reused for job in self.jobs.values())
        with self.database.read() as session:
            assert session.scalar(select(func.count()).select_from(SolutionRow)) == computed


@pytest.mark.random_law
def test_the_store_does_what_the_model_does(database, monkeypatch):
    # Jobs come back at times that can be foretold.
    monkeypatch.setattr(rows.random, "uniform", lambda low, high: 0.0)
    clock = FakeClock(database.engine)
    run_state_machine_as_test(
        lambda: JobMachine(database, clock),
        settings=settings(max_examples=examples(5, 20), stateful_step_count=25, deadline=None),
    )
