"""A sweep by several children: every point once, in the order of its index, whatever happens to a child."""

import json
from concurrent.futures import Future

import numpy as np
import pytest

from service.jobs.queue import Range
from service.schemas.sweep.reading import read_sweep
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome
from workers.cli.sweep import SUFFIXES, schema_of, table_of
from workers.sweeping.local_pool import LocalPool

POINTS = 200
DOCUMENT = {
    "base": {
        "body": {"A": 2, "C": 1},
        "potential": {"type": "gravity", "a": -1},
        "motion": {"type": "planar", "lambda": 1},
        "time": {"stop": 1, "samples": 3},
    },
    "axes": [{"pointer": "/motion/lambda", "linspace": [1, 2, POINTS]}],
    "keep": ["period"],
}


def computed(first, count):
    """Points whose period is their index."""
    return chunk_outcome(
        ChunkPoints([SOLVED] * count, {"period": np.arange(first, first + count, dtype=float)}), 0.01 * count
    )


class Children:
    """Answer in the reverse order of what they are asked, as ``answer`` says."""

    def __init__(self, answer, at_once=4):
        self.asked = []
        self._answer = answer
        self._waiting = []
        self._at_once = at_once

    def submit(self, _, document_json, *, seconds):
        asked = json.loads(document_json)
        future = Future()
        self._waiting.append((future, Range(asked["first"], asked["count"])))
        if len(self._waiting) >= self._at_once or asked["first"] + asked["count"] >= POINTS:
            self.work()
        return future

    def work(self):
        while self._waiting:
            future, chunk = self._waiting.pop()
            self.asked.append(chunk)
            try:
                future.set_result(self._answer(chunk))
            except Exception as fault:
                future.set_exception(fault)


def pool_of(children):
    return LocalPool(read_sweep(DOCUMENT), DOCUMENT, children, way="compiled", workers=2, seconds=1.0)


def handed_out(pool):
    found = []
    for points in pool.points(lambda: False):
        if points is None:
            pool._sandbox.work()
        else:
            first, columns = points
            assert first == len(found)
            found += zip(columns.outcomes, columns.numbers["period"], strict=True)
    return found


def test_points_come_in_the_order_of_their_index():
    pool = pool_of(Children(lambda chunk: computed(chunk.first, chunk.count)))
    assert handed_out(pool) == [(SOLVED, k) for k in range(POINTS)]
    assert pool.missing() == []
    assert pool.computed == POINTS


def test_what_a_chunk_hands_back_is_computed_too():
    pool = pool_of(Children(lambda chunk: computed(chunk.first, (chunk.count + 1) // 2)))
    assert handed_out(pool) == [(SOLVED, k) for k in range(POINTS)]


@pytest.mark.parametrize(("fault", "code"), [(TimeoutError, "time_limit"), (MemoryError, "memory_limit")])
def test_a_point_that_cannot_be_computed_is_a_point_with_a_reason(fault, code):
    def answer(chunk):
        if chunk.first <= 77 < chunk.first + chunk.count:
            raise fault
        return computed(chunk.first, chunk.count)

    found = handed_out(pool_of(Children(answer)))
    assert [k for k, (outcome, _) in enumerate(found) if outcome != SOLVED] == [77]
    assert found[77][0] == code
    assert np.isnan(found[77][1])


def test_a_fault_of_ours_is_not_hidden():
    def answer(_):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        handed_out(pool_of(Children(answer)))


def test_told_to_stop_it_hands_out_what_is_computed_and_tells_what_is_missing():
    children = Children(lambda chunk: computed(chunk.first, chunk.count), at_once=3)
    pool = pool_of(children)
    found = set()
    for points in pool.points(lambda: len(children.asked) >= 3):
        if points is not None:
            first, columns = points
            found |= set(range(first, first + len(columns.outcomes)))
    absent = {k for gap in pool.missing() for k in range(gap.first, gap.first + gap.count)}
    assert found
    assert absent
    assert found.isdisjoint(absent)
    assert found | absent == set(range(POINTS))


def test_a_table_has_null_where_a_point_has_nothing():
    swept = read_sweep({**DOCUMENT, "series": True})
    rows = np.array([[0.0, 0.5, 1.0], [np.nan] * 3, [0.0, 0.5, np.nan]])
    points = ChunkPoints(
        [SOLVED, "no_motion", SOLVED],
        {"period": np.array([3.0, np.nan, np.nan])},
        dict.fromkeys(swept.series_columns, rows),
    )
    table = table_of(swept, 5, points)
    assert table.schema == schema_of(swept)
    found = table.to_pydict()
    assert found["index"] == [5, 6, 7]
    assert found["period"] == [3.0, None, None]
    assert found["outcome"] == [SOLVED, "no_motion", SOLVED]
    # A motion that ends has only the samples before.
    assert found["g1"] == [[0.0, 0.5, 1.0], None, [0.0, 0.5]]
    assert np.array_equal(found["/motion/lambda"], swept.columns(5, 3)["/motion/lambda"])


def test_the_kinds_of_files():
    assert SUFFIXES == (".parquet", ".arrow", ".csv")
