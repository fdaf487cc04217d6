"""Lists come in their order from an index: every page of them, nulls and ties included."""

from contextlib import contextmanager
from itertools import product

from sqlalchemy import delete, event, text

from service.jobs.records import JobState
from service.schemas.query.reading import read_where
from service.schemas.query.terms import ListQuery, OrderKey
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import JobStore
from service.storage.searching.sources import SOLUTIONS
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.solutions import SolutionRow
from tests.storage.searching.rows import subject_of
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.lists import list_jobs, list_sweeps

SORTED = ("created_at", "A", "B", "C", "period", "energy", "error", "drift", "trace", "seconds")


def solution_query(sort="created_at", descending=True, where=(), **further):
    conditions, faults = read_where(where, SOLUTIONS)
    assert not faults
    return ListQuery(conditions, (OrderKey(subject_of(sort), descending),), **further)


def store(database, found):
    """Store solutions with these periods, errors and families instead of all others."""
    made = [
        SolutionRow(
            id=new_id(), job_id=new_id(), digest="d", problem=PROBLEM, summary=SUMMARY,
            created_at=float(place), family=family, period=period, error=error,
        )
        for place, (period, error, family) in enumerate(found)
    ]  # fmt: skip
    with database.write() as session:
        session.execute(delete(SolutionRow))
        session.add_all(made)


@contextmanager
def plans(database):
    """Collect how the database will answer each SELECT, without the scans that tiny tables invite."""
    found = []

    def explain(connection, cursor, statement, parameters, context, executemany):
        if not statement.startswith("SELECT"):
            return
        if connection.dialect.name == "sqlite":
            cursor.execute(f"EXPLAIN QUERY PLAN {statement}", parameters)
        else:
            cursor.execute("SET LOCAL enable_seqscan = off; SET LOCAL enable_bitmapscan = off")
            cursor.execute(f"EXPLAIN {statement}", parameters)
        found.append((statement, " ".join(str(row[-1]) for row in cursor.fetchall())))

    event.listen(database.engine, "before_cursor_execute", explain)
    try:
        yield found
    finally:
        event.remove(database.engine, "before_cursor_execute", explain)


def only_an_index(database):
    return "COVERING INDEX" if database.engine.dialect.name == "sqlite" else "Index Only Scan"


def assert_is_walked(found, word):
    """Every list of ids and every count is answered by an index, and nothing is sorted."""
    walks = [
        plan
        for statement, plan in found
        if statement.startswith("SELECT count") or "OFFSET" in statement or "LIMIT" in statement
    ]
    assert len(walks) >= 2
    for plan in walks:
        assert word in plan, plan
        assert "TEMP B-TREE" not in plan, plan
        assert "Sort" not in plan, plan


def test_every_order_of_solutions_is_walked_on_an_index(database):
    # One has the number and one has not: both parts of the order are read.
    store(database, [(1.0, 1.0, "gravity"), (None, None, None)])
    for sort, descending in product([*SORTED, "/motion/lambda"], [True, False]):
        with plans(database) as found:
            page = SolutionStore(database).find(solution_query(sort, descending, offset=1, limit=2))
            assert page.total == 2
            SolutionStore(database).find(solution_query(sort, descending, offset=90_000))
        assert_is_walked(found, only_an_index(database))


def test_filters_are_counted_without_reading_the_rows(database):
    store(database, [(1.0, 1.0, "gravity")] * 3)
    queries = [
        solution_query(where=["family=gravity"]),
        solution_query(where=["tier=draft"]),
        solution_query(where=["method=quadrature,tier=draft"]),
        solution_query(where=["period>=0.5,period<=2"]),
    ]
    for query in queries:
        with plans(database) as found:
            SolutionStore(database).find(query)
        plans_of_counts = [plan for statement, plan in found if statement.startswith("SELECT count")]
        assert plans_of_counts
        for plan in plans_of_counts:
            assert only_an_index(database) in plan, plan


def test_lists_of_jobs_and_sweeps_are_walked_on_an_index(database):
    JobStore(database).submit(PROBLEM, "digest")
    is_sqlite = database.engine.dialect.name == "sqlite"
    for state in (None, *JobState):
        with plans(database) as found:
            list_jobs(JobStore(database), state=state, offset=90_000)
        # For one row, Postgres does not care which of the two indexes it takes.
        assert_is_walked(found, "COVERING INDEX" if is_sqlite else "Index")
        with plans(database) as found:
            list_sweeps(SweepStore(database), state=state, offset=90_000)
        assert_is_walked(found, only_an_index(database))


def test_the_oldest_job_that_waits_is_found_by_an_index(database):
    statement = "SELECT created_at FROM jobs WHERE state = 'queued' ORDER BY id LIMIT 1"
    with plans(database) as found, database.read() as session:
        session.execute(text(statement))
    ((_, plan),) = found
    assert "ix_jobs_state_id_kind" in plan
    assert "TEMP B-TREE" not in plan
    assert "Sort" not in plan
