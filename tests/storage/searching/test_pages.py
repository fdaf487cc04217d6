"""Conditions, orders and pages mean on both databases what plain Python says they mean."""

from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import event, text

from service.schemas.query.reading import read_where
from service.schemas.query.terms import ListQuery, OrderKey
from service.storage.searching import narrowing
from service.storage.searching.sources import SOLUTIONS
from tests.storage.searching.rows import (
    add,
    ask,
    expected,
    ids_by_cursor,
    queries,
    rows,
    store,
    subject_of,
    value_of,
)
from tests.support.effort import each_once, examples

EMPTY = {"invariants": {}}

on_a_database = settings(
    max_examples=examples(6, 300), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@given(rows, st.lists(queries, min_size=4, max_size=4))
@on_a_database
def test_a_page_is_what_python_finds(database, found, asked):
    made = store(database, found)
    for query in asked:
        ids = expected(made, query)
        page = ask(database, query)
        assert list(page.ids) == ids[query.offset :][: query.limit]
        assert page.total == len(ids)
        assert (page.next is None) == (query.offset + query.limit >= len(ids))


@given(rows, st.lists(queries, min_size=3, max_size=3))
@on_a_database
def test_pages_by_cursor_together_are_the_whole_once(database, found, asked):
    made = store(database, found)
    for query in asked:
        whole, pages, after = expected(made, query), [], None
        while True:
            page = ask(database, replace(query, offset=0, after=after, is_counted=False))
            pages += page.ids
            after = page.next
            if after is None:
                break
            assert len(page.ids) == query.limit
        assert pages == whole


@given(rows, rows, queries)
@on_a_database
def test_rows_that_come_in_meanwhile_neither_repeat_others_nor_hide_them(database, first, later, query):
    made = store(database, first)
    page = ask(database, replace(query, offset=0))
    both = made + add(database, later)
    if page.next is None:
        return
    seen, after = list(page.ids), page.next
    while after is not None:
        page = ask(database, replace(query, offset=0, after=after))
        seen += page.ids
        after = page.next
    assert len(seen) == len(set(seen))
    whole = expected(both, query)
    old = {row["id"] for row in made}
    assert [each for each in seen if each in old] == [each for each in whole if each in old]
    # Of the new ones exactly those are seen that belong behind the first page.
    last = whole.index(seen[min(query.limit, len(seen)) - 1])
    assert seen[query.limit :] == whole[last + 1 :]


@given(rows)
@on_a_database
def test_columns_are_the_values_that_conditions_compare(database, found):
    made = {row["id"]: row for row in store(database, found)}
    columns = tuple(map(subject_of, ["id", "period", "/motion/lambda", "/potential/b/0", "tier", "drift"]))
    page = ask(database, ListQuery(columns=columns))
    assert {row[0] for row in page.values} == set(made)
    for row in page.values:
        assert list(row) == [value_of(made[row[0]], column) for column in columns]


@pytest.mark.parametrize("few", [0, 2, 1000])
def test_a_page_does_not_depend_on_how_its_rows_are_found(database, monkeypatch, few):
    """Few rows that meet a condition are found by their ids, many in the order of the page."""
    monkeypatch.setattr(narrowing, "MANY", few)
    problem = {"motion": {"lambda": 1}}
    found = [
        ({**problem, "body": {"A": n % 3}}, {"period": {"value": float(n)}, "energy": {"value": n % 4 * 1.0}})
        for n in range(12)
    ]
    made = store(database, [(each, {**EMPTY, **summary}) for each, summary in found])
    for where in ("period>=9", "A=1,period<8", "/motion/lambda=1,energy=3", "A in (0,2),/motion/lambda>1"):
        conditions, faults = read_where([where], SOLUTIONS)
        assert faults == []
        for keys in ((OrderKey(subject_of("energy"), True),), (OrderKey(subject_of("period")),)):
            query = ListQuery(conditions, keys)
            assert list(ask(database, query).ids) == expected(made, query)


@each_once(
    few=[0, 1000],
    is_descending=[False, True],
    where=["label.project=thesis", "label.project=thesis,label.run in (0,1)", "label.project=thesis,energy>0",
     "label.run=0,label.project=thesis", "label.project!=thesis", "label.run is null,label.project=thesis"],
)  # fmt: skip
def test_pages_in_the_order_of_time_are_read_from_the_index_of_labels(
    database, monkeypatch, few, is_descending, where
):
    monkeypatch.setattr(narrowing, "MANY", few)
    found = [
        ({}, {**EMPTY, "energy": {"value": n % 2 * 1.0}},
         {"project": "thesis" if n % 3 else "other", **({"run": str(n % 4)} if n % 5 else {})})
        for n in range(24)
    ]  # fmt: skip
    made = store(database, found)
    conditions, faults = read_where([where], SOLUTIONS)
    assert faults == []
    for name in ("id", "created_at"):
        query = ListQuery(conditions, (OrderKey(subject_of(name), is_descending),), limit=3)
        whole = expected(made, query)
        assert whole
        assert ids_by_cursor(database, query, len(whole)) == whole


@pytest.mark.one_in(2)
@pytest.mark.parametrize("common", [True, False])
def test_a_condition_on_a_label_reads_the_index_of_labels_however_many_rows_there_are(database, common):
    plans = []

    def explain(connection, cursor, statement, parameters, context, executemany):
        is_sqlite = connection.dialect.name == "sqlite"
        if statement.startswith("SELECT") and "solution_labels" in statement:
            cursor.execute(f"EXPLAIN {'QUERY PLAN' if is_sqlite else ''} {statement}", parameters)
            plans.append(str(cursor.fetchall()))

    # Labelled ones are the oldest: to walk from the newest would read all others first.
    labels = [{"project": "thesis"} if n < (1500 if common else 20) else {} for n in range(6000)]
    add(database, [({}, EMPTY, each) for each in labels])
    with database.write() as session:
        # As Postgres does by itself after a while; without it, it takes the tables for empty ones.
        session.execute(text("ANALYZE"))
    conditions, _ = read_where(["label.project=thesis"], SOLUTIONS)
    event.listen(database.engine, "before_cursor_execute", explain)
    for name in ("created_at", "id"):
        page = ask(database, ListQuery(conditions, (OrderKey(subject_of(name), True),), is_counted=False))
        assert len(page.ids) == (50 if common else 20)
    event.remove(database.engine, "before_cursor_execute", explain)
    assert plans
    # Neither a walk through all solutions, nor through an index of theirs; and many are not sorted.
    walks = [
        "SCAN solutions",
        "Seq Scan on solutions",
        "ix_solutions_",
        *(["B-TREE", "Sort"] if common else []),
    ]
    for plan in plans:
        assert "solution_labels" in plan, plan
        assert [walk for walk in walks if walk in plan] == [], plan
