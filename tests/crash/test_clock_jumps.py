"""The clock that leases are judged by is set forward or back by hours: nothing is lost or doubled."""

import time

import pytest
from sqlalchemy import event, text

from service.jobs.records import AttemptOutcome, JobState
from service.sandbox import Sandbox
from service.storage.database.rows import database_now
from service.storage.inspection.inspect import inspect
from service.storage.jobs.job_store import JobStore
from tests.support.waiting import wait_until
from tests.workers.chores import CHORES
from workers.process.pool import ChildrenPool
from workers.process.results import JobLimits
from workers.process.runner import Runner

HOUR = 3600.0
LIMITS = JobLimits(lease_seconds=10.0, job_seconds=60.0, memory_mb=500, max_attempts=99, retry_seconds=0.0)
UNIX_EPOCH = 2440587.5
"""As a Julian day."""
POSTGRES_CLOCK = """
CREATE SCHEMA wrong;
CREATE TABLE wrong.clock AS SELECT 0.0::double precision AS shift;
CREATE FUNCTION wrong.clock_timestamp() RETURNS timestamptz LANGUAGE sql AS
  'SELECT pg_catalog.clock_timestamp() + make_interval(secs => (SELECT shift FROM wrong.clock))'
"""


class Clock:
    """The database's clock, which can be set."""

    def __init__(self, database):
        self._database = database
        self._shift = 0.0
        if database.engine.dialect.name == "sqlite":
            event.listen(database.engine, "connect", self._replace_sqlite)
        else:
            with database.engine.begin() as connection:
                for statement in POSTGRES_CLOCK.split(";"):
                    connection.execute(text(statement))
            event.listen(database.engine, "connect", self._replace_postgres)
        database.engine.dispose()

    def set(self, shift):
        """Let the clock be wrong by so many seconds."""
        self._shift = shift
        if self._database.engine.dialect.name != "sqlite":
            with self._database.engine.begin() as connection:
                connection.execute(text("UPDATE wrong.clock SET shift = :shift"), {"shift": shift})

    def _replace_sqlite(self, connection, _):
        connection.create_function(
            "julianday", 1, lambda _: UNIX_EPOCH + (time.time() + self._shift) / 86400.0
        )

    def _replace_postgres(self, connection, _):
        connection.execute("SET search_path = wrong, public, pg_catalog")
        connection.commit()


@pytest.fixture
def clock(database):
    return Clock(database)


@pytest.fixture(scope="module")
def children():
    sandboxes = [Sandbox(1, preload=["tests.workers.chores"]) for _ in range(2)]
    yield sandboxes
    for sandbox in sandboxes:
        sandbox.close()


@pytest.fixture
def workers(database, children):
    """Two workers whose steps the test takes."""
    return [
        Runner(JobStore(database), ChildrenPool(sandbox, CHORES, slots=1), name=name, limits=LIMITS)
        for name, sandbox in zip(("first", "second"), children, strict=True)
    ]


def look(worker):
    """Let a worker look at once for leases that have ended, as it does every second."""
    worker._reconcile_at = 0.0
    worker.reconcile()


def finish(worker):
    wait_until(lambda: worker.collect(refill=False) or not worker.is_busy)
    assert not worker.is_busy


def outcomes(jobs, job):
    return [attempt.outcome for attempt in jobs.attempts(job.id)]


def assert_solved_once(database, jobs, job):
    assert jobs.get(job.id).state is JobState.SUCCEEDED
    assert outcomes(jobs, job).count(AttemptOutcome.SUCCEEDED) == 1
    with database.read() as session:
        counted = text("SELECT count(*) FROM solutions")
        assert session.execute(counted).scalar_one() == 1
    assert [finding.code for finding in inspect(database) if finding.broken] == []


def test_the_clock_of_these_tests_is_the_one_of_the_database(database, clock):
    with database.read() as session:
        before = database_now(session)
    clock.set(HOUR)
    with database.read() as session:
        assert HOUR <= database_now(session) - before < 2 * HOUR


def test_forward_a_held_job_is_given_to_another_and_ends_once(database, jobs, clock, workers):
    first, second = workers
    job = jobs.submit({"chore": "sleep", "seconds": 0.2}, "digest")
    first.fill()
    clock.set(HOUR)
    look(second)
    second.fill()
    assert second.is_busy
    # Its claim is void; what it hands over is thrown away.
    finish(first)
    assert jobs.get(job.id).state is JobState.RUNNING
    finish(second)
    assert outcomes(jobs, job) == [AttemptOutcome.RETURNED, AttemptOutcome.SUCCEEDED]
    assert_solved_once(database, jobs, job)


def test_forward_a_worker_that_is_first_to_renew_its_lease_keeps_the_job(database, jobs, clock, workers):
    first, second = workers
    job = jobs.submit({"chore": "sleep", "seconds": 0.2}, "digest")
    first.fill()
    clock.set(HOUR)
    first._leases.due_at = 0.0
    first.keep_leases()
    look(second)
    second.fill()
    assert not second.is_busy
    finish(first)
    assert outcomes(jobs, job) == [AttemptOutcome.SUCCEEDED]
    assert_solved_once(database, jobs, job)


def test_back_a_held_job_stays_held(database, jobs, clock, workers):
    first, second = workers
    job = jobs.submit({"chore": "sleep", "seconds": 0.2}, "digest")
    first.fill()
    clock.set(-HOUR)
    look(second)
    second.fill()
    assert not second.is_busy
    finish(first)
    assert outcomes(jobs, job) == [AttemptOutcome.SUCCEEDED]
    assert_solved_once(database, jobs, job)


def test_back_a_job_whose_worker_died_waits_and_is_not_lost(database, jobs, clock, workers):
    first, second = workers
    job = jobs.submit({}, "digest")
    first.fill()
    # It dies: it neither renews its lease nor collects.
    clock.set(-HOUR)
    look(second)
    assert jobs.get(job.id).state is JobState.RUNNING
    clock.set(LIMITS.lease_seconds + 1.0)  # the clock has caught up
    look(second)
    second.fill()
    finish(second)
    assert outcomes(jobs, job) == [AttemptOutcome.RETURNED, AttemptOutcome.SUCCEEDED]
    assert_solved_once(database, jobs, job)
    finish(first)
    assert_solved_once(database, jobs, job)


@pytest.mark.parametrize("jumps", [(1, -1, 2, -2, 24, 0), (-1, -2, -3, 3, 0, 1)])
def test_whatever_the_clock_does_every_job_ends_once(database, jobs, clock, workers, jumps):
    submitted = [jobs.submit({"number": number}, f"digest {number}") for number in range(6)]
    for hours in (*jumps, 48):
        clock.set(hours * HOUR)
        for worker in workers:
            look(worker)
            worker.fill()
            worker.keep_leases()
        # One of them hands over at once; the other holds on beyond the next jump.
        finish(workers[0])

    def are_all_finished():
        for worker in workers:
            look(worker)
            worker.fill()
            finish(worker)
        return all(jobs.get(job.id).is_finished for job in submitted)

    wait_until(are_all_finished)
    assert {jobs.get(job.id).state for job in submitted} == {JobState.SUCCEEDED}
    assert all(outcomes(jobs, job).count(AttemptOutcome.SUCCEEDED) == 1 for job in submitted)
    assert [finding.code for finding in inspect(database) if finding.broken] == []
