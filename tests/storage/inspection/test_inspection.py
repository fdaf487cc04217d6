"""A database in use is clean; violations are found, and repaired where that loses nothing."""

import json
from contextlib import contextmanager

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from service.jobs.keys import Role
from service.jobs.records import JobKind, JobResult, JobState, Solved
from service.schemas.reading.documents import Annotation
from service.storage.codecs.packing import encode_document
from service.storage.database.availability import file_of
from service.storage.database.database import Database
from service.storage.inspection.inspect import inspect, invariants, repair
from service.storage.jobs.job_store import JobStore
from service.storage.keys import KeyStore
from service.storage.solutions.result_store import AuditStore, ResultStore
from service.storage.sweeps.sweep_store import SweepStore
from tests.support.databases import PROBLEM, SUMMARY, copy_of
from tests.support.finishing import finish_success
from tests.support.lists import list_jobs
from tests.workers.chores import do_chunk

SWEEP = {"seconds": 0.01}


def claim(jobs, lease_seconds=600.0):
    return jobs.claim("worker", lease_seconds=lease_seconds)


ANNOTATION = Annotation({"project": "thesis"}, "to be looked at")


def solve(jobs, digest, **of):
    job = jobs.submit(PROBLEM, digest, **of)
    assert finish_success(jobs, claim(jobs), SUMMARY, dense=b"dense", samples=b"samples")
    return job.id


def work_on(jobs, sweeps, sweep_id, until):
    """Compute chunks, the pilot first, until so many points are done."""
    while sweeps.get(sweep_id).done < until:
        claimed = claim(jobs)
        assert jobs.finish(claimed, do_chunk(json.dumps(claimed.payload)))[0]


@pytest.fixture
def sweeps(database):
    return SweepStore(database)


def live(database):
    """Do all that can be done, in the ordinary way; return the ids of some of it."""
    jobs, sweeps = JobStore(database), SweepStore(database)
    key, _ = KeyStore(database).create(Role.SUBMIT)
    solved = solve(jobs, "solved", key_id=key.id, annotation=ANNOTATION)
    audited = jobs.submit(PROBLEM, "solved")
    assert audited.reused
    AuditStore(database).submit(audited.solution_id, PROBLEM, "audited", key_id=key.id)
    assert jobs.finish(claim(jobs), Solved(SUMMARY, b"dense", b"samples", {"verdict": "agrees"}))[0]
    ResultStore(database).submit(JobKind.ATLAS, {"lambda": [1, 2]}, "drawn", key_id=key.id)
    assert jobs.finish(claim(jobs), JobResult(encode_document({"parts": []})))[0]
    jobs.submit(PROBLEM, "refused")
    jobs.finish_failure(claim(jobs), {"code": "no_motion", "detail": "none"})
    jobs.submit(PROBLEM, "lost")
    jobs.lose(claim(jobs), "died", max_attempts=3)
    assert finish_success(jobs, claim(jobs), SUMMARY, dense=b"dense", samples=b"")
    jobs.cancel(jobs.submit(PROBLEM, "cancelled").id)
    stopped = jobs.submit(PROBLEM, "stopped")
    claim(jobs)
    jobs.cancel(stopped.id)
    done, begun, ended = (
        sweeps.submit(SWEEP, points=n, most=100, key_id=key.id, annotation=ANNOTATION)
        for n in (40, 4000, 4000)
    )
    work_on(jobs, sweeps, done.id, 40)
    work_on(jobs, sweeps, begun.id, 200)
    sweeps.cancel(ended.id)
    while claim(jobs) is not None:
        pass
    jobs.submit(PROBLEM, "waiting")
    return {"solved": solved, "done": done.id, "begun": begun.id, "ended": ended.id, "key": key.id}


@pytest.fixture
def lived(database):
    return live(database)


def broken(database):
    return {finding.code for finding in inspect(database) if finding.broken}


def without_constraints(connection):
    if connection.dialect.name == "sqlite":
        raw = connection.connection
        raw.execute("PRAGMA foreign_keys = OFF")
        raw.execute("PRAGMA ignore_check_constraints = ON")
        return
    connection.execute(text("SET session_replication_role = replica"))
    checks = "SELECT conrelid::regclass, conname FROM pg_constraint WHERE contype = 'c' AND conrelid <> 0"
    for table, name in connection.execute(text(f"{checks} AND connamespace = 'public'::regnamespace")).all():
        connection.execute(text(f"ALTER TABLE {table} DROP CONSTRAINT {name}"))


def damage(database, *statements):
    """Write past every constraint."""
    with database.engine.connect() as connection:
        without_constraints(connection)
        for statement in statements:
            assert connection.execute(text(statement)).rowcount > 0, statement
        connection.commit()
        connection.invalidate()


class Rehearsal(Database):
    """All transactions inside of one that is never committed."""

    def __init__(self, connection):
        self.engine = connection.engine
        self.file = file_of(connection.engine.url)
        self._connection = connection

    @contextmanager
    def read(self):
        with Session(self._connection, join_transaction_mode="create_savepoint") as session:
            yield session

    @contextmanager
    def write(self):
        with self.read() as session, session.begin():
            yield session


@pytest.fixture(scope="module", params=["sqlite", "postgres"])
def shared(request, tmp_path_factory):
    """A database in which everything has been done; nobody changes it for good."""
    if request.param == "sqlite":
        url = copy_of(request.getfixturevalue("sqlite_template"), tmp_path_factory.mktemp("shared"))
    else:
        server = request.getfixturevalue("postgres")
        url = server.url(server.create_database(request.getfixturevalue("postgres_template")))
    database = Database(url)
    live(database)
    yield database
    database.close()


@pytest.fixture
def rehearsal(shared):
    with shared.engine.connect() as connection:
        without_constraints(connection)
        if not connection.in_transaction():
            connection.begin()
        yield Rehearsal(connection)
        connection.rollback()
        connection.invalidate()


def test_what_is_used_in_order_is_clean(database, lived):
    assert broken(database) == set()


def test_a_new_database_is_clean(database):
    findings = list(inspect(database))
    assert all(finding.is_clean for finding in findings)
    assert len({finding.code for finding in findings}) == len(findings)


DAMAGE = [
    ("UPDATE jobs SET state = 'paused' WHERE digest = 'waiting'", "jobs_checks", False),
    ("UPDATE jobs SET owner = NULL WHERE state = 'running'", "jobs_checks", False),
    ("UPDATE sweeps SET refused = done + 1", "sweeps_checks", True),
    ("DELETE FROM solutions", "dense_outputs_solution_id", True),
    ("DELETE FROM solutions", "jobs_solution_id", True),
    ("DELETE FROM solutions", "samples_solution_id", True),
    ("DELETE FROM jobs WHERE digest = 'solved'", "job_labels_job_id", True),
    ("DELETE FROM solutions", "solution_labels_solution_id", True),
    ("DELETE FROM sweeps", "sweep_labels_sweep_id", True),
    ("DELETE FROM sweeps", "sweep_chunks_sweep_id", True),
    ("DELETE FROM sweeps", "jobs_sweep_id", True),
    ("DELETE FROM jobs WHERE digest = 'solved'", "attempts_job_id", True),
    ("UPDATE jobs SET finished_at = NULL", "finished_at", True),
    ("UPDATE jobs SET finished_at = 1 WHERE digest = 'waiting'", "finished_at", True),
    ("UPDATE jobs SET error = NULL", "error", False),
    ("UPDATE jobs SET lease_until = lease_until - 1e4 WHERE state = 'running'", "stale_lease", True),
    ("UPDATE jobs SET attempt = 2 WHERE digest = 'solved'", "attempts", False),
    ("DELETE FROM attempts WHERE number = 1", "attempts", False),
    ("UPDATE attempts SET ended_at = NULL", "open_attempts", True),
    ("UPDATE attempts SET ended_at = 1 WHERE ended_at IS NULL", "running_attempts", False),
    ("UPDATE solutions SET digest = 'other'", "own_solutions", False),
    ("UPDATE jobs SET reused = NOT reused WHERE digest = 'solved'", "own_solutions", False),
    ("UPDATE jobs SET reused = NOT reused WHERE digest = 'solved'", "solutions_of_successes", False),
    (
        "UPDATE jobs SET state = 'cancelled', solution_id = NULL WHERE digest = 'solved'",
        "solutions_of_successes",
        False,
    ),
    ("DELETE FROM dense_outputs", "functions_of_time", False),
    ("DELETE FROM solutions WHERE digest = 'solved'", "audits_solution_id", True),
    ("DELETE FROM jobs WHERE digest = 'audited'", "audits_job_id", True),
    ("UPDATE audits SET comparison = NULL", "comparisons", False),
    (
        "UPDATE jobs SET state = 'cancelled', solution_id = NULL WHERE digest = 'audited'",
        "early_comparisons",
        True,
    ),
    ("DELETE FROM jobs WHERE digest = 'drawn'", "atlases_job_id", True),
    ("DELETE FROM atlases", "missing_atlases", True),
    ("UPDATE jobs SET state = 'cancelled' WHERE digest = 'drawn'", "early_atlases", True),
    ("UPDATE sweep_chunks SET first = first - 1 WHERE first > 0", "sweep_overlaps", False),
    ("DELETE FROM sweep_chunks WHERE first = 0", "sweep_gaps", True),
    ("DELETE FROM jobs WHERE state = 'running'", "sweep_ends", True),
    ("UPDATE sweeps SET next_index = 4000 WHERE state = 'running'", "sweep_ends", True),
    ("UPDATE sweeps SET done = 0", "sweep_counts", True),
    ("UPDATE sweeps SET refused = 1", "sweep_counts", True),
    ("UPDATE sweeps SET state = 'running', finished_at = NULL WHERE points = 40", "sweep_success", True),
    ("UPDATE sweeps SET state = 'succeeded' WHERE state = 'running'", "sweep_success", True),
    ("UPDATE sweeps SET state = 'cancelled' WHERE state = 'running'", "sweep_leftovers", True),
    ("UPDATE sweeps SET finished_at = NULL", "sweep_finished_at", False),
    ("UPDATE api_keys SET stored_bytes = stored_bytes - 1", "stored_bytes", True),
]


@pytest.mark.any_database
@pytest.mark.one_in(3)
@pytest.mark.parametrize(("statement", "code", "is_mended"), DAMAGE)
def test_damage_is_found_and_mended_if_that_loses_nothing(rehearsal, statement, code, is_mended):
    with rehearsal.write() as session:
        assert session.execute(text(statement)).rowcount > 0
    assert code in broken(rehearsal)
    mended = {finding.code for finding in repair(rehearsal) if finding.mended}
    assert (code in broken(rehearsal)) is not is_mended
    if is_mended:
        assert mended


def test_every_law_is_tried(database):
    never = {"api_keys_checks", "sweep_chunks_checks", "attempts_checks"}  # made like the other checks
    # Two solutions of a job would break a unique index, as long as there is one.
    never |= {"solved_once"}
    # Without any chunk at all: a test of its own.
    never |= {"sweep_stands_still"}
    assert {law.code for law in invariants()} - never == {code for _, code, _ in DAMAGE}


@pytest.mark.any_database
def test_a_sweep_whose_chunks_were_lost_is_finished_after_mending(database, jobs, sweeps, lived):
    chunks = "kind = 'chunk' AND state IN ('queued', 'running')"
    damage(database, "DELETE FROM sweep_chunks WHERE first > 0", f"DELETE FROM jobs WHERE {chunks}")
    list(repair(database))
    jobs.cancel(list_jobs(jobs, state=JobState.QUEUED).jobs[0].id)
    work_on(jobs, sweeps, lived["begun"], 4000)
    assert sweeps.get(lived["begun"]).state is JobState.SUCCEEDED
    assert sweeps.get(lived["done"]).done <= 40
    work_on(jobs, sweeps, lived["done"], 40)
    assert broken(database) <= {"attempts_job_id"}


@pytest.mark.any_database
def test_a_sweep_without_any_chunk_goes_on_after_mending(database, jobs, sweeps):
    sweep = sweeps.submit(SWEEP, points=100, most=100)
    damage(database, "DELETE FROM jobs", "UPDATE sweeps SET next_index = 0")
    assert broken(database) == {"sweep_stands_still"}
    list(repair(database))
    assert broken(database) == set()
    work_on(jobs, sweeps, sweep.id, 100)


@pytest.mark.any_database
def test_a_job_whose_solution_is_gone_is_computed_again(database, jobs, lived):
    damage(database, "DELETE FROM solutions")
    list(repair(database))
    assert broken(database) == set()
    assert jobs.get(lived["solved"]).state is JobState.QUEUED


def test_a_released_lease_leaves_the_job_to_the_next_worker(database, jobs):
    job = jobs.submit(PROBLEM, "digest")
    claim(jobs, lease_seconds=-100.0)
    (stale,) = (finding for finding in inspect(database) if finding.broken)
    assert (stale.code, stale.is_clean, stale.examples) == ("stale_lease", True, (job.id,))
    assert [finding.mended for finding in repair(database)] == [1]
    assert claim(jobs).attempt == 2
    assert broken(database) == set()


def test_another_schema_is_all_that_is_told(database):
    damage(database, "UPDATE alembic_version SET version_num = '0001'")
    (finding,) = inspect(database)
    assert (finding.code, finding.is_clean, finding.examples) == ("schema", False, ("0001",))
