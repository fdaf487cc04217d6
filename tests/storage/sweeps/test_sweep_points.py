"""Points are found as a filter and a sort of all of them would find them."""

import operator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.schemas.query.terms import Condition, Kind, OrderKey, Subject
from service.schemas.sweep.reading import read_sweep
from service.storage.codecs.packing import SOLVED
from service.storage.sweeps import point_reader
from service.storage.sweeps.point_reader import PointQuery, PointReader
from service.storage.sweeps.sweep_store import SweepStore
from tests.support.effort import examples
from tests.support.sweeps import POINTS, SWEEP, energy_of, finish_sweep, is_refused, period_of

A, LAMBDA = "/potential/parameters/a", "/motion/lambda"
COLUMNS = ["index", A, LAMBDA, "period", "energy"]
ORDERED = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}
COMPARE = {**ORDERED, "=": operator.eq, "!=": operator.ne}
INDICES = np.arange(POINTS)
EVERY = {
    "index": INDICES.astype(float),
    **read_sweep(SWEEP).columns(0, POINTS),
    "period": period_of(INDICES),
    "energy": energy_of(INDICES),
}
OUTCOMES = np.where(is_refused(INDICES), "no_motion", SOLVED)


@pytest.fixture(params=["half done", "done"])
def stored(request, database, jobs):
    """The reader's arguments for a sweep in many small chunks, and the indices that are there."""
    store = SweepStore(database)
    record = store.submit(SWEEP, points=POINTS, most=9)
    finish_sweep(jobs, chunks=6 if request.param == "half done" else None)
    found = [range(chunk.first, chunk.first + chunk.count) for chunk in store.chunks(record.id)]
    return store, record.id, np.array([index for each in found for index in each])


def subject(column):
    return Subject("fact", column, Kind.TEXT if column == "outcome" else Kind.NUMBER)


@st.composite
def conditions(draw):
    column = draw(st.sampled_from([*COLUMNS, "outcome"]))
    operator = draw(st.sampled_from(["=", "!=", "in", *(ORDERED if column != "outcome" else ()), "is null"]))
    if operator == "is null":
        return Condition(subject(column), draw(st.sampled_from(["is null", "is not null"])))
    if column == "outcome":
        value = st.sampled_from([SOLVED, "no_motion", "other"])
    else:
        values = EVERY[column]
        value = st.sampled_from(values[np.isfinite(values)].tolist()) | st.floats(-3, 3)
    given = draw(st.lists(value, min_size=1, max_size=4 if operator == "in" else 1))
    return Condition(subject(column), operator, tuple(given))


QUERIES = st.builds(
    PointQuery,
    conditions=st.lists(conditions(), max_size=2).map(tuple),
    order=st.lists(st.builds(OrderKey, st.sampled_from(COLUMNS).map(subject), st.booleans()), max_size=3).map(
        tuple
    ),
    limit=st.none() | st.integers(1, POINTS),
    offset=st.integers(0, 30),
)


def meets(index, condition):
    column = condition.subject.name
    value = str(OUTCOMES[index]) if column == "outcome" else float(EVERY[column][index])
    is_missing = value != value
    match condition.operator:
        case "is null":
            return is_missing
        case "is not null":
            return not is_missing
        case "in":
            return value in condition.values
    return not is_missing and COMPARE[condition.operator](value, condition.values[0])


def place(index, key):
    """Return what the index of a point is sorted by: without the number last, either way."""
    value = float(EVERY[key.subject.name][index])
    return (True, 0.0) if value != value else (False, -value if key.descending else value)


def expected(query, there):
    """The indices that are meant, found in the plainest way."""
    kept = [index for index in there if all(meets(index, each) for each in query.conditions)]
    kept.sort(key=lambda index: [place(index, key) for key in query.order])
    stop = None if query.limit is None else query.offset + query.limit
    return kept[query.offset : stop], len(kept)


@pytest.mark.one_in(2)
@pytest.mark.random_law
@settings(
    max_examples=examples(6, 60), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(query=QUERIES)
def test_the_points_that_are_meant_are_found_in_their_order(stored, query):
    store, sweep_id, there = stored
    reader = PointReader(store, sweep_id, read_sweep(SWEEP), with_series=False)
    indices, total = expected(query, there)
    blocks = list(reader.blocks(query))
    assert [index for block in blocks for index in block.indices] == indices
    assert reader.count(query) == total
    for block in blocks:
        assert block.outcomes.tolist() == OUTCOMES[block.indices].tolist()
        for name in COLUMNS[1:]:
            assert np.array_equal(block.numbers[name], EVERY[name][block.indices], equal_nan=True)


@pytest.mark.one_in(2)
@pytest.mark.random_law
@settings(
    max_examples=examples(5, 60), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(query=QUERIES)
def test_what_comes_after_a_point_is_the_rest(stored, query):
    store, sweep_id, there = stored
    reader = PointReader(store, sweep_id, read_sweep(SWEEP), with_series=False)
    whole, _ = expected(replace(query, offset=0, limit=None), there)
    for index in whole[:: max(1, len(whole) // 4)]:
        numbers = [float(EVERY[key.subject.name][index]) for key in query.keys]
        after = tuple(None if number != number else number for number in numbers)
        rest = reader.blocks(replace(query, after=after, offset=0))
        ids = [each for block in rest for each in block.indices]
        assert ids == whole[whole.index(index) + 1 :][: query.limit]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("order", [None, "period", "energy"])
def test_small_memory_changes_nothing_but_the_blocks(stored, monkeypatch, order):
    store, sweep_id, _ = stored
    keys = () if order is None else (OrderKey(subject(order)),)
    sweep, query = read_sweep(SWEEP), PointQuery(order=keys, offset=3)
    whole = list(PointReader(store, sweep_id, sweep, with_series=False).blocks(query))
    monkeypatch.setattr(point_reader, "BLOCK_ROWS", 4)
    monkeypatch.setattr(point_reader, "GATHERED_NUMBERS", 70)
    small = list(PointReader(store, sweep_id, sweep, with_series=False).blocks(query))
    assert max(len(block.indices) for block in small) <= 4
    assert (
        np.concatenate([b.indices for b in small]).tolist()
        == np.concatenate([b.indices for b in whole]).tolist()
    )
    for name in COLUMNS[1:]:
        joined = [np.concatenate([b.numbers[name] for b in blocks]) for blocks in (small, whole)]
        assert np.array_equal(*joined, equal_nan=True)


@pytest.mark.one_in(2)
def test_chunks_that_conditions_exclude_are_not_read(stored, monkeypatch):
    store, sweep_id, _ = stored
    reader, asked = PointReader(store, sweep_id, read_sweep(SWEEP), with_series=False), []
    read = store.data
    monkeypatch.setattr(
        store, "data", lambda sweep, firsts: asked.append(list(firsts)) or read(sweep, firsts)
    )
    nowhere = [
        Condition(subject(name), operator, (value,))
        for name, operator, value in (("period", ">", 1.5), ("energy", "=", 7.0), (LAMBDA, "<", 0.0))
    ]
    for condition in nowhere:
        assert reader.count(PointQuery(conditions=(condition,))) == 0
    assert asked == []


SERIES = {
    "t": lambda indices: indices[:, None] + np.arange(3.0),
    "g1": lambda indices: -indices[:, None] * np.ones(3),
}


def test_series_come_with_their_points(database, jobs):
    store = SweepStore(database)
    document = {**SWEEP, "series": True}
    record = store.submit(document, points=POINTS, most=9)
    finish_sweep(jobs, series=SERIES)
    reader = PointReader(store, record.id, read_sweep(document), with_series=True)
    for query in (
        PointQuery(),
        PointQuery(order=(OrderKey(subject("period"), True),)),
        PointQuery(limit=5, offset=20),
    ):
        for block in reader.blocks(query):
            assert np.array_equal(block.series["t"], SERIES["t"](block.indices))
            # Columns that no point had: the worker of this test has left them out.
            assert np.isnan(block.series["p"]).all()
