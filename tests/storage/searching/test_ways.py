"""In whichever index the rows of a page are found, they are those that plain Python finds."""

from contextlib import contextmanager
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import event, select

from service.schemas.query.reading import read_where
from service.schemas.query.terms import ListQuery, OrderKey, facts_of
from service.storage.database.database import Database
from service.storage.searching import narrowing, pages
from service.storage.searching.sources import SOLUTIONS
from service.storage.tables.solutions import SolutionNumberRow
from tests.storage.searching.rows import (
    POINTERS,
    add,
    ask,
    conditions,
    expected,
    ids_by_cursor,
    rows,
    store,
    subject_of,
)
from tests.support.effort import each_once, examples

# Values tie in half of the rows; a second column, that may have no index, follows.
led_orders = st.tuples(
    st.sampled_from(["period", "energy", "A", "/motion/lambda", "created_at", "id", "tier", *POINTERS[3:5]]),
    st.lists(st.sampled_from(["energy", "trace", "tier", "/potential/b/0", "id"]), max_size=2),
    st.lists(st.booleans(), min_size=3, max_size=3),
).map(
    lambda drawn: tuple(
        OrderKey(subject_of(name), descending)
        for name, descending in zip([drawn[0], *drawn[1]], drawn[2], strict=False)
    )
)
led_queries = st.builds(
    ListQuery, st.lists(conditions(), max_size=3).map(tuple), led_orders, limit=st.integers(1, 5)
)
# Entries of an index that are read or tried at first, and in the end; entries that a row counts as.
WAYS = {
    "by few": (1000, 1000, 1),
    "in a window, or by what takes least": (2, 2000, 1),
    "in a window, or in an index alone": (2, 2000, 10_000),
    "in a window, or to the end": (3, 0, 2),
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize("way", WAYS)
@given(rows, st.lists(led_queries, min_size=2, max_size=2))
@settings(
    max_examples=examples(3, 200), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_every_way_finds_the_same_pages(database, way, found, asked):
    made = store(database, found)
    for query in asked:
        whole = expected(made, query)
        with pytest.MonkeyPatch.context() as patch:
            for name, value in zip(("MANY", "MOST", "ROW"), WAYS[way], strict=True):
                patch.setattr(narrowing, name, value)
                patch.setattr(pages, name, value)
            assert ids_by_cursor(database, query, len(whole)) == whole
            for offset in (1, 4):
                page = ask(database, replace(query, offset=offset))
                assert list(page.ids) == whole[offset:][: query.limit]


@given(rows, rows)
@settings(
    max_examples=examples(4, 100), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_numbers_come_and_go_with_their_solutions(database, before, found):
    store(database, before)
    made = store(database, found)  # which deletes those before
    columns = {"/body/A", "/body/B", "/body/C", "/motion/lambda", "family"}
    with database.read() as session:
        table = SolutionNumberRow
        stored = session.execute(select(table.owner_id, table.key, table.value)).all()
    documents = {row["id"]: facts_of(row["problem"]) for row in made}
    numbers = {(owner, key) for owner, facts in documents.items() for key in facts if key not in columns}
    assert {(owner, key) for owner, key, _ in stored} == numbers
    assert len(stored) == len(numbers)
    # SQLite's own reading of a decimal may be an ulp beside: conditions on rows read it in the same way.
    assert all(
        value == pytest.approx(documents[owner][key], rel=3e-16, abs=0) for owner, key, value in stored
    )


@contextmanager
def plans(database):
    """Collect how SQLite reads solutions for each statement."""
    found = []

    def explain(connection, cursor, statement, parameters, context, executemany):
        if statement.startswith("SELECT") and "count(*)" not in statement:
            cursor.execute(f"EXPLAIN QUERY PLAN {statement}", parameters)
            found.append(" | ".join(row[-1] for row in cursor.fetchall()))

    event.listen(database.engine, "before_cursor_execute", explain)
    try:
        yield found
    finally:
        event.remove(database.engine, "before_cursor_execute", explain)


@pytest.fixture
def sqlite_database(sqlite_url):
    database = Database(sqlite_url)
    yield database
    database.close()


def solutions(count):
    return [
        (
            {
                "potential": {"type": "gravity" if n % 5 else "rational", "parameters": {"a": n * 7 % count}},
                "motion": {"lambda": 1 + n * 11 % count},
            },
            {
                "invariants": {},
                "period": {"value": n * 7919 % count / 9 if n % 10 else None},
                "energy": {"value": n / count},
            },
        )
        for n in range(count)
    ]


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("where", "order", "index"),
    [
        ("energy>=0.99", "period", "ix_solutions_energy_id"),  # few meet it
        ("family=rational", "period", "ix_solutions_period_id"),  # many do: in the order of the page
        ("family=rational,energy<0.9", "created_at", "ix_solutions_created_at_id"),
        ("/potential/parameters/a>=2970", "period", "solution_numbers"),
        ("family=rational", "/potential/parameters/a", "solution_numbers"),
        ("/potential/parameters/a>=1000,family=rational,energy>0.1", "period", "solution_numbers"),
    ],
)
def test_a_page_is_read_in_one_index_and_no_row_is_where_it_has_all(
    sqlite_database, monkeypatch, where, order, index
):
    for module in (narrowing, pages):
        monkeypatch.setattr(module, "MANY", 500)
    made = add(sqlite_database, solutions(3000))
    conditions, faults = read_where([where], SOLUTIONS)
    assert not faults
    query = ListQuery(conditions, (OrderKey(subject_of(order)),), is_counted=False)
    with plans(sqlite_database) as found:
        page = ask(sqlite_database, query)
    assert list(page.ids) == expected(made, query)[:50]
    last = found[-1]
    assert index in last or (index == "solution_numbers" and "PRIMARY KEY (name=?" in last)
    # The index of numbers is their table.
    assert "COVERING INDEX" in last or (index == "solution_numbers" and "solutions" not in last)


@each_once(way=list(WAYS), order=["/potential/parameters/a", "energy"])
def test_what_no_index_tells_of_a_number_is_tested_beside_what_one_does(database, way, order):
    """A number that is collected from its own table may have a condition that is not."""
    problems = [{"potential": {"parameters": {"a": n}, "b": [n % 4]}} for n in range(40)]
    made = store(database, [(each, {"invariants": {}, "energy": {"value": 1.0}}, {}) for each in problems])
    conditions, faults = read_where(["/potential/b/0>=1,/potential/b/0!=2,energy<2"], SOLUTIONS)
    assert not faults
    query = ListQuery(conditions, (OrderKey(subject_of(order)),), limit=7)
    with pytest.MonkeyPatch.context() as patch:
        for name, value in zip(("MANY", "MOST", "ROW"), WAYS[way], strict=True):
            patch.setattr(narrowing, name, value)
            patch.setattr(pages, name, value)
        whole = expected(made, query)
        assert len(whole) == 20
        assert ids_by_cursor(database, query, len(whole)) == whole
