"""Points are found as a filter and a sort of all of them would find them."""

import operator

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from service.schemas.sweep.reading import read_sweep
from service.storage.codecs.points import SOLVED
from service.storage.sweeps import point_reader
from service.storage.sweeps.point_query import Condition, PointQuery
from service.storage.sweeps.point_reader import PointReader
from service.storage.sweeps.sweep_store import SweepStore
from tests.support.effort import examples
from tests.support.sweeps import POINTS, SWEEP, energy_of, finish_sweep, is_refused, period_of

A, LAMBDA = "/potential/parameters/a", "/motion/lambda"
COLUMNS = ["index", A, LAMBDA, "period", "energy"]
COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "=": operator.eq}
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


@st.composite
def conditions(draw):
    column = draw(st.sampled_from(COLUMNS))
    values = EVERY[column]
    near = st.sampled_from(values[np.isfinite(values)].tolist())
    return Condition(column, draw(st.sampled_from(list(COMPARE))), draw(near | st.floats(-3, 3)))


QUERIES = st.builds(
    PointQuery,
    conditions=st.lists(conditions(), max_size=2).map(tuple),
    outcomes=st.lists(st.sampled_from([SOLVED, "no_motion", "other"]), max_size=1).map(tuple),
    order=st.none() | st.sampled_from(COLUMNS),
    descending=st.booleans(),
    limit=st.none() | st.integers(1, POINTS),
    offset=st.integers(0, 30),
)


def expected(query, there):
    """The indices that are meant, found in the plainest way."""
    kept = [
        index
        for index in there
        if all(COMPARE[c.operator](EVERY[c.column][index], c.number) for c in query.conditions)
        and all(OUTCOMES[index] == outcome for outcome in query.outcomes)
    ]
    if query.order is not None:
        sign = -1 if query.descending else 1
        key = EVERY[query.order]
        kept.sort(key=lambda index: (np.isnan(key[index]), 0 if np.isnan(key[index]) else sign * key[index]))
    stop = None if query.limit is None else query.offset + query.limit
    return kept[query.offset : stop], len(kept)


@pytest.mark.random_law
@settings(
    max_examples=examples(25, 60), deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
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


@pytest.mark.parametrize("order", [None, "period", "energy"])
def test_small_memory_changes_nothing_but_the_blocks(stored, monkeypatch, order):
    store, sweep_id, _ = stored
    sweep, query = read_sweep(SWEEP), PointQuery(order=order, offset=3)
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


def test_chunks_that_conditions_exclude_are_not_read(stored, monkeypatch):
    store, sweep_id, _ = stored
    reader, asked = PointReader(store, sweep_id, read_sweep(SWEEP), with_series=False), []
    read = store.data
    monkeypatch.setattr(
        store, "data", lambda sweep, firsts: asked.append(list(firsts)) or read(sweep, firsts)
    )
    nowhere = [Condition("period", ">", 1.5), Condition("energy", "=", 7.0), Condition(LAMBDA, "<", 0.0)]
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
    for query in (PointQuery(), PointQuery(order="period", descending=True), PointQuery(limit=5, offset=20)):
        for block in reader.blocks(query):
            assert np.array_equal(block.series["t"], SERIES["t"](block.indices))
            # Columns that no point had: the worker of this test has left them out.
            assert np.isnan(block.series["p"]).all()
