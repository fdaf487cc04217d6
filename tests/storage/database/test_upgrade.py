"""A database of the first schema, with jobs at every point of their lives, brought to this version."""

import json
import uuid

import pytest
from sqlalchemy import MetaData, inspect, text

from service.jobs.records import AttemptOutcome, JobState
from service.schemas.query.terms import Kind, ListQuery, equals
from service.storage.database.database import Database, make_engine
from service.storage.database.migration import migrate
from service.storage.database.rows import new_id
from service.storage.inspection.inspect import inspect as inspect_database
from service.storage.jobs.job_store import JobStore
from service.storage.solutions.solution_store import SolutionStore
from tests.support.databases import FIRST, SUMMARY, upgrade_to
from tests.support.finishing import finish_success

PROBLEM = {
    "body": {"A": "17/10", "C": 1},
    "potential": {"type": "expression", "expression": "g1 + γ*g3^2", "parameters": {"γ": 10**30}},
    "time": {"times": [0.1, "1/3", 1e-300]},
}
NOW = 1.7e9


class Old:
    """A database of the first schema, written without the models of this version."""

    def __init__(self, url):
        upgrade_to(url, FIRST)
        self.engine = make_engine(url)
        self.metadata = MetaData()
        self.metadata.reflect(self.engine)

    def put(self, table, **values):
        with self.engine.begin() as connection:
            connection.execute(
                self.metadata.tables[table].insert(), {n: self._raw(v) for n, v in values.items()}
            )

    def _raw(self, value):
        # SQLite keeps ids as 32 hexadecimal digits.
        if isinstance(value, uuid.UUID):
            return value.hex if self.engine.dialect.name == "sqlite" else value
        return value

    def job(self, state, *, digest="digest", **values):
        job_id = uuid.UUID(new_id())
        given = {"attempt": 0, "progress": 0.0, "reused": False, "created_at": NOW, **values}
        self.put("jobs", id=job_id, state=state, problem=PROBLEM, digest=digest, **given)
        return job_id

    def attempt(self, job_id, number, outcome=None, detail=None):
        ended_at = None if outcome is None else NOW + number + 0.5
        self.put(
            "attempts", job_id=job_id, number=number, worker="host:1:ab", started_at=NOW + number,
            ended_at=ended_at, outcome=outcome, detail=detail,
        )  # fmt: skip

    def solution(self, job_id):
        solution_id = uuid.UUID(new_id())
        self.put(
            "solutions", id=solution_id, job_id=job_id, digest="solved", problem=PROBLEM, summary=SUMMARY,
            created_at=NOW + 2, family="expression", method="quadrature", tier="standard", A=1.7, C=1.0,
            period=6.5, energy=-0.0, error=3e-15,
        )  # fmt: skip
        self.put("dense_outputs", solution_id=solution_id, data=bytes(range(256)) * 4000)
        self.put("samples", solution_id=solution_id, data=b"")
        return solution_id


def rows(engine):
    """Return the rows of all tables, each as its columns by name, in an order of their own."""
    found = {}
    with engine.connect() as connection:
        for table in inspect(engine).get_table_names():
            listed = [dict(row) for row in connection.execute(text(f'SELECT * FROM "{table}"')).mappings()]
            found[table] = sorted(listed, key=lambda row: json.dumps(row, default=str, sort_keys=True))
    return found


@pytest.fixture
def old(empty_url):
    old = Old(empty_url)
    yield old
    old.engine.dispose()


@pytest.fixture
def ids(old):
    """Write a job at every point of its life; return the ids by what it is."""
    made = {"queued": old.job("queued"), "returned": old.job("queued", attempt=1, started_at=NOW)}
    old.attempt(made["returned"], 1, "returned", "the worker stopped")
    made["running"] = old.job(
        "running", attempt=2, progress=0.25, owner="host:1:ab", lease_until=NOW + 10, started_at=NOW + 2
    )
    old.attempt(made["running"], 1, "lost", "the child process died of SIGKILL")
    old.attempt(made["running"], 2)
    made["solver"] = uuid.UUID(new_id())
    made["solution"] = old.solution(made["solver"])
    finished = {"solution_id": made["solution"], "progress": 1.0, "finished_at": NOW + 2}
    old.put(
        "jobs", id=made["solver"], state="succeeded", problem=PROBLEM, digest="solved", attempt=1,
        reused=False, created_at=NOW, started_at=NOW + 1, **finished,
    )  # fmt: skip
    old.attempt(made["solver"], 1, "succeeded")
    made["reused"] = old.job("succeeded", digest="solved", **{**finished, "reused": True})
    error = {"code": "no_motion", "detail": "p² < 0", "pointer": "/motion/lambda"}
    made["failed"] = old.job("failed", attempt=1, error=error, finished_at=NOW + 3)
    old.attempt(made["failed"], 1, "failed", "no_motion")
    made["cancelled"] = old.job("cancelled", attempt=1, finished_at=NOW + 3)
    old.attempt(made["cancelled"], 1, "cancelled")
    return made


def test_every_old_value_is_what_it_was(old, ids, empty_url):
    before = rows(old.engine)
    migrate(empty_url)
    after = rows(old.engine)
    for table, listed in before.items():
        if table == "alembic_version":
            continue
        columns = [column.name for column in old.metadata.tables[table].columns]
        kept = [{name: row[name] for name in columns} for row in after[table]]
        kept.sort(key=lambda row: json.dumps(row, default=str, sort_keys=True))
        assert kept == listed, table
    assert [len(before[t]) for t in ("jobs", "attempts", "solutions", "dense_outputs")] == [7, 6, 1, 1]


@pytest.fixture
def upgraded(old, ids, empty_url):
    migrate(empty_url)
    database = Database(empty_url)
    yield database
    database.close()


def test_the_upgraded_database_is_in_order(upgraded):
    assert [finding.code for finding in inspect_database(upgraded) if not finding.is_clean] == []


def test_lives_go_on_where_they_were(upgraded, ids):
    jobs = JobStore(upgraded)
    state = {name: jobs.get(str(job_id)).state.value for name, job_id in ids.items() if name != "solution"}
    assert state == {
        "queued": "queued", "returned": "queued", "running": "running", "solver": "succeeded",
        "reused": "succeeded", "failed": "failed", "cancelled": "cancelled",
    }  # fmt: skip
    # The running one's worker is gone since long; the oldest queued one is claimed first.
    assert jobs.reconcile(max_attempts=3, retry_seconds=0.0) == (str(ids["running"]),)
    outcomes = [attempt.outcome for attempt in jobs.attempts(str(ids["running"]))]
    # Nobody knows whether it had begun.
    assert outcomes == [AttemptOutcome.LOST, AttemptOutcome.RETURNED]
    claim = jobs.claim("worker", lease_seconds=60.0)
    assert (claim.job_id, claim.payload) == (str(ids["queued"]), PROBLEM)
    assert finish_success(jobs, claim, SUMMARY, dense=b"d", samples=b"s")


def test_old_solutions_are_found_read_and_used_again(upgraded, ids):
    solutions, solution_id = SolutionStore(upgraded), str(ids["solution"])
    (found,) = solutions.find(ListQuery(equals("family", Kind.WORD, "expression"))).solutions
    assert (found.id, found.problem, found.summary) == (solution_id, PROBLEM, SUMMARY)
    assert solutions.dense(solution_id) == bytes(range(256)) * 4000
    assert solutions.samples(solution_id) == b""
    again = JobStore(upgraded).submit(PROBLEM, "solved")
    assert (again.state, again.solution_id) == (JobState.SUCCEEDED, solution_id)
