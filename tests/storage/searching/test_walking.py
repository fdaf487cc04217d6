"""A page that is walked in windows along its order is the page that the database finds by its own choice."""

from contextlib import contextmanager
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import event

from service.schemas.query.conditions import OrderKey
from service.schemas.query.list_query import ListQuery
from service.schemas.query.where import read_where
from service.storage.database.database import Database
from service.storage.searching import narrowing, walking
from service.storage.searching.pages import find
from service.storage.searching.sources import OF_SOLUTION_ROWS, SOLUTIONS
from tests.storage.searching.rows import add, conditions, expected, rows, store, subject_of
from tests.support.effort import examples

# Those with an index, whose values tie in half of the rows; a second column that has none may follow.
walked_orders = st.tuples(
    st.sampled_from(["period", "energy", "error", "A", "/motion/lambda", "created_at", "id"]),
    st.lists(st.sampled_from(["energy", "trace", "tier", "/potential/b/0", "id"]), max_size=2),
    st.lists(st.booleans(), min_size=3, max_size=3),
).map(
    lambda drawn: tuple(
        OrderKey(subject_of(name), descending)
        for name, descending in zip([drawn[0], *drawn[1]], drawn[2], strict=False)
    )
)
walked_queries = st.builds(
    ListQuery, st.lists(conditions(), max_size=2).map(tuple), walked_orders, limit=st.integers(1, 5)
)


@pytest.fixture
def database(sqlite_url):
    database = Database(sqlite_url)
    yield database
    database.close()


def ask(database, query):
    with database.read() as session:
        return find(session, OF_SOLUTION_ROWS, query)


@contextmanager
def statements(database):
    """Collect the statements that read a window, and those that read a page by the database's choice."""
    windows, others = [], []

    def note(connection, cursor, statement, parameters, context, executemany):
        if "rowid IN" in statement:
            windows.append(statement)
        elif "solutions.family =" in statement:
            others.append(statement)

    event.listen(database.engine, "before_cursor_execute", note)
    try:
        yield windows, others
    finally:
        event.remove(database.engine, "before_cursor_execute", note)


@given(rows, st.lists(walked_queries, min_size=2, max_size=2), st.sampled_from([1, 2, 4]))
@settings(
    max_examples=examples(10, 300), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_windows_of_any_size_and_none_bring_the_same_pages(database, found, asked, window):
    made = store(database, found)
    for query in asked:
        whole = expected(made, query)
        for few, most in ((0, 10**6), (0, 7), (0, 0)):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(narrowing, "FEW", few)
                patch.setattr(walking, "WINDOW", window)
                patch.setattr(walking, "MOST", most)
                pages, after = [], None
                while True:
                    page = ask(database, replace(query, after=after))
                    pages += page.ids
                    after = page.next
                    if after is None:
                        break
                    assert len(page.ids) == query.limit
                assert pages == whole
                for offset in (1, 4):
                    page = ask(database, replace(query, offset=offset))
                    assert list(page.ids) == whole[offset:][: query.limit]


def solutions(count, *, rational=5):
    """One of ``rational`` solutions is of that family; a tenth has no period."""
    return [
        (
            {"potential": {"type": "gravity" if n % rational else "rational"}},
            {"invariants": {}, "period": {"value": n * 7919 % count / 9 if n % 10 else None}},
        )
        for n in range(count)
    ]


@pytest.mark.parametrize("order", [("period", "energy"), ("period",), ("created_at",)])
def test_where_many_rows_match_a_page_reads_few(database, order):
    made = add(database, solutions(3000))
    conditions, faults = read_where(["family=rational"], SOLUTIONS)
    assert not faults
    query = ListQuery(conditions, tuple(map(OrderKey, map(subject_of, order))), is_counted=False)
    whole = expected(made, query)
    with statements(database) as (windows, others):
        page = ask(database, query)
        following = ask(database, replace(query, after=page.next))
    assert [*page.ids, *following.ids] == whole[:100]
    # A window of 200 has 40 of a page, the next one the rest.
    assert len(windows) == 4
    assert others == []


def test_where_hardly_any_row_matches_the_walk_is_given_up(database, monkeypatch):
    monkeypatch.setattr(walking, "MOST", 2000)
    made = add(database, solutions(3000, rational=700))
    conditions, _ = read_where(["family=rational"], SOLUTIONS)
    query = ListQuery(conditions, (OrderKey(subject_of("created_at")),), is_counted=False)
    with statements(database) as (windows, others):
        page = ask(database, query)
    assert list(page.ids) == expected(made, query)
    assert len(page.ids) == 5
    # The first 200 rows have one: a page of 51 would take 10 000.
    assert len(windows) == 1
    assert len(others) == 1


def test_many_rows_of_one_value_are_not_walked_where_others_put_them_in_order(database, monkeypatch):
    monkeypatch.setattr(walking, "MOST", 1000)
    found = [({"potential": {"type": "rational"}, "body": {"A": 1}}, {"invariants": {}})] * 1100
    made = add(database, found)
    conditions, _ = read_where(["family=rational"], SOLUTIONS)
    query = ListQuery(
        conditions, (OrderKey(subject_of("A")), OrderKey(subject_of("energy"))), is_counted=False
    )
    with statements(database) as (windows, others):
        page = ask(database, query)
    assert list(page.ids) == expected(made, query)[:50]
    assert windows == []
    assert len(others) == 1
