"""Lists come in their order from an index: every page of them, nulls and ties included."""

from contextlib import contextmanager
from itertools import count

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import delete, event, text

from service.jobs.states import JobState
from service.storage.database.ids import new_id
from service.storage.jobs.job_store import SqlJobStore
from service.storage.solutions.solution_store import (
    SORT_COLUMNS,
    NumberRange,
    SolutionQuery,
    SolutionStore,
)
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.tables.solutions import SolutionRow
from tests.support.databases import PROBLEM, SUMMARY
from tests.support.effort import examples

CREATED = count(1)
# Few values, so that many rows tie.
numbers = st.sampled_from([None, -1.0, 0.0, 0.5, 2.0, 1e300])
rows = st.lists(st.tuples(numbers, numbers, st.sampled_from(["gravity", "rational", None])), max_size=12)


def store(database, found):
    """Store solutions with these periods, errors and families instead of all others."""
    made = [
        SolutionRow(
            id=new_id(), job_id=new_id(), digest="d", problem=PROBLEM, summary=SUMMARY,
            created_at=float(next(CREATED) // 2), family=family, period=period, error=error,
        )
        for period, error, family in found
    ]  # fmt: skip
    with database.write() as session:
        session.execute(delete(SolutionRow))
        session.add_all(made)
    return made


def in_order(found, name, descending):
    """Sort as documented: by the number, then by the id; those without the number last either way."""
    known = [row for row in found if getattr(row, name) is not None]
    unknown = [row for row in found if getattr(row, name) is None]
    known.sort(key=lambda row: (getattr(row, name), row.id), reverse=descending)
    unknown.sort(key=lambda row: row.id, reverse=descending)
    return [row.id for row in known + unknown]


def keeps(query, row):
    interval = query.intervals.get("period", NumberRange())
    number = row.period
    is_inside = interval == NumberRange() or (
        number is not None
        and (interval.lower is None or number >= interval.lower)
        and (interval.upper is None or number <= interval.upper)
    )
    return is_inside and query.family in (None, row.family)


queries = st.builds(
    SolutionQuery,
    family=st.sampled_from([None, "gravity"]),
    intervals=st.sampled_from([{}, {"period": NumberRange(lower=0.0)}, {"period": NumberRange(upper=0.5)}]),
    sort=st.sampled_from(SORT_COLUMNS),
    descending=st.booleans(),
    limit=st.integers(1, 5),
    offset=st.integers(0, 14),
)


@given(rows, queries)
@settings(
    max_examples=examples(20, 60), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_page_is_what_sorting_in_memory_gives(database, found, query):
    made = store(database, found)
    expected = in_order([row for row in made if keeps(query, row)], query.sort, query.descending)
    page = SolutionStore(database).find(query)
    assert [solution.id for solution in page.solutions] == expected[query.offset :][: query.limit]
    assert page.total == len(expected)


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


@pytest.mark.parametrize("descending", [True, False])
@pytest.mark.parametrize("sort", SORT_COLUMNS)
def test_every_order_of_solutions_is_walked_on_an_index(database, sort, descending):
    # One has the number and one has not: both parts of the order are read.
    store(database, [(1.0, 1.0, "gravity"), (None, None, None)])
    with plans(database) as found:
        query = SolutionQuery(sort=sort, descending=descending, offset=1, limit=2)
        SolutionStore(database).find(query)
        SolutionStore(database).find(SolutionQuery(sort=sort, descending=descending, offset=90_000))
    assert_is_walked(found, only_an_index(database))


def test_filters_are_counted_without_reading_the_rows(database):
    store(database, [(1.0, 1.0, "gravity")] * 3)
    queries = [
        SolutionQuery(family="gravity"),
        SolutionQuery(tier="draft"),
        SolutionQuery(method="quadrature", tier="draft"),
        SolutionQuery(intervals={"period": NumberRange(0.5, 2.0)}),
    ]
    for query in queries:
        with plans(database) as found:
            SolutionStore(database).find(query)
        (plan,) = [plan for statement, plan in found if statement.startswith("SELECT count")]
        assert only_an_index(database) in plan, plan


@pytest.mark.parametrize("state", [None, *JobState])
def test_lists_of_jobs_are_walked_on_an_index(database, state):
    SqlJobStore(database).submit(PROBLEM, "digest")
    with plans(database) as found:
        SqlJobStore(database).list_jobs(state=state, offset=90_000)
    is_sqlite = database.engine.dialect.name == "sqlite"
    # For one row, Postgres does not care which of the two indexes it takes.
    assert_is_walked(found, "COVERING INDEX" if is_sqlite else "Index")


@pytest.mark.parametrize("state", [None, *JobState])
def test_lists_of_sweeps_are_walked_on_an_index(database, state):
    with plans(database) as found:
        SweepStore(database).list_sweeps(state=state, offset=90_000)
    assert_is_walked(found, only_an_index(database))


def test_the_oldest_job_that_waits_is_found_by_an_index(database):
    statement = "SELECT created_at FROM jobs WHERE state = 'queued' ORDER BY id LIMIT 1"
    with plans(database) as found, database.read() as session:
        session.execute(text(statement))
    ((_, plan),) = found
    assert "ix_jobs_state_id_kind" in plan
    assert "TEMP B-TREE" not in plan
    assert "Sort" not in plan
