"""Reads the computed points of a sweep in blocks, so that memory does not grow with the sweep.

A query for points has conditions and a sort order. Chunks are read a few at a time, in transactions of their
own. A chunk that a condition excludes by its axes or its bounds is not read at all. Sorted points take two
steps: first only the sort keys are read and sorted; then the rows are gathered, as many at a time as memory
allows, each time from all chunks that contain any of them.
"""

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.schemas.query.terms import Condition, Kind, OrderKey, Subject
from service.schemas.sweep.sweep import Sweep
from service.storage.codecs.packing import decode_points
from service.storage.sweeps.sweep_store import StoredChunk, SweepStore

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
WordArray = NDArray[np.object_]

INDEX, OUTCOME = "index", "outcome"
"""Columns that every sweep has, beside its axes and its kept numbers."""

BY_INDEX = OrderKey(Subject("fact", INDEX, Kind.NUMBER))

_COMPARE: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "=": operator.eq,
    "!=": operator.ne,
}


def admits(condition: Condition, values: FloatArray) -> BoolArray:
    """Tell for each number whether the condition holds; a point without it meets only ``is null``."""
    has_number = np.isfinite(values)
    match condition.operator:
        case "is null":
            return ~has_number
        case "is not null":
            return has_number
        case "in":
            return has_number & np.isin(values, [float(value) for value in condition.values])
    met: BoolArray = has_number & _COMPARE[condition.operator](values, float(condition.values[0]))
    return met


def admits_words(condition: Condition, words: WordArray) -> BoolArray:
    """Tell for each outcome whether the condition holds; every point has one."""
    match condition.operator:
        case "is null" | "is not null":
            return np.full(len(words), condition.operator == "is not null")
        case "in":
            accepted = condition.values
        case _:
            accepted = condition.values[:1]
    found: BoolArray = np.isin(words.astype(np.str_), [str(value) for value in accepted])
    return ~found if condition.operator == "!=" else found


def may_admit(condition: Condition, bounds: tuple[float, float] | None) -> bool:
    """Tell whether the condition may hold for a point of a chunk.

    ``bounds`` are the smallest and the largest number that any of its points has;
    None if none has one.
    """
    if condition.operator == "is null":
        return True
    if bounds is None:
        return False
    low, high = bounds
    match condition.operator:
        case "<" | "<=":
            return bool(admits(condition, np.array([low]))[0])
        case ">" | ">=":
            return bool(admits(condition, np.array([high]))[0])
        case "=" | "in":
            return any(low <= float(value) <= high for value in condition.values)
        case "!=":
            return not low == high == condition.values[0]
    return True


@dataclass(frozen=True, slots=True)
class PointQuery:
    """The points asked for; every condition must hold."""

    conditions: tuple[Condition, ...] = ()
    order: tuple[OrderKey, ...] = ()
    """The columns to sort by; by index if there are none. Points without the number come last either way."""
    limit: int | None = None
    offset: int = 0
    after: tuple[float | None, ...] | None = None
    """The numbers of the order's columns, index included, at the point before the page."""

    @property
    def keys(self) -> tuple[OrderKey, ...]:
        """The columns of the order; the last one is the index."""
        for index, key in enumerate(self.order):
            if key.subject.name == INDEX:
                return self.order[: index + 1]
        return (*self.order, BY_INDEX)

    @property
    def is_by_index(self) -> bool:
        """True if the points come as they are stored."""
        return self.keys == (BY_INDEX,)

    @property
    def is_unconditional(self) -> bool:
        """True if no condition excludes any point."""
        return not self.conditions


IntArray = NDArray[np.int64]

BLOCK_ROWS = 8192
"""Points of a block at most."""
BLOCK_NUMBERS = 1_000_000
"""Numbers of a block at most, the samples of series among them, unless a single point has more."""
GATHERED_NUMBERS = 8_000_000
"""Numbers that are gathered at a time for sorted points: 64 MB."""
_CHUNKS_AT_ONCE = 200


@dataclass(frozen=True, slots=True)
class PointBlock:
    """Some points in columns, in the requested order."""

    indices: IntArray
    numbers: Mapping[str, FloatArray]
    """The axes by their pointers, then the kept numbers; NaN where a point has none."""
    outcomes: WordArray
    series: Mapping[str, FloatArray]
    """Arrays of shape [points, samples]; NaN where a point has none."""

    def column(self, name: str) -> FloatArray:
        """Return the index, an axis or a kept number."""
        return self.indices.astype(np.float64) if name == INDEX else self.numbers[name]

    def taken(self, rows: IntArray | BoolArray | slice) -> "PointBlock":
        """Return some of the points."""
        return PointBlock(
            self.indices[rows],
            {name: values[rows] for name, values in self.numbers.items()},
            self.outcomes[rows],
            {name: values[rows] for name, values in self.series.items()},
        )


class PointReader:
    """Reads the stored points of one sweep, with or without their series."""

    def __init__(self, store: SweepStore, sweep_id: str, sweep: Sweep, *, with_series: bool) -> None:
        self._store, self._id, self._sweep = store, sweep_id, sweep
        self._series = sweep.series_columns if with_series else ()
        self.row_numbers = 2 + len(sweep.axes) + len(sweep.keep) + len(self._series) * sweep.samples
        """Numbers that a point takes in memory."""
        self.block_rows = max(1, min(BLOCK_ROWS, BLOCK_NUMBERS // self.row_numbers))

    def held(self, query: PointQuery) -> int:
        """Return the bytes that :meth:`blocks` keeps in memory while they are used, about."""
        rows = self.block_rows if query.is_by_index else max(1, GATHERED_NUMBERS // self.row_numbers)
        stored = sum(chunk.count for chunk in self._store.chunks(self._id))
        sorted_ones = 0 if query.is_by_index else 8 * (1 + len(query.keys)) * stored
        return sorted_ones + 8 * self.row_numbers * min(rows, stored, query.limit or stored)

    def count(self, query: PointQuery) -> int:
        """Return how many of the stored points meet the conditions."""
        if query.is_unconditional:
            return sum(chunk.count for chunk in self._store.chunks(self._id))
        return sum(len(block.indices) for block in self._matching(query, self._candidates(query), ()))

    def blocks(self, query: PointQuery) -> Iterator[PointBlock]:
        """Yield the points that are asked for, some at a time."""
        rows = self._by_index(query) if query.is_by_index else self._gathered(self.sorted(query))
        for block in rows:
            for start in range(0, len(block.indices), self.block_rows):
                yield block.taken(slice(start, start + self.block_rows))

    def sorted(self, query: PointQuery) -> IntArray:
        """Return the indices of the points that are asked for, in their order."""
        indices = [np.empty(0, dtype=np.int64)]
        columns = [[np.empty(0)] for _ in query.keys]
        for block in self._matching(query, self._candidates(query), ()):
            indices.append(block.indices)
            for key, column in zip(query.keys, columns, strict=True):
                values = block.column(key.subject.name)
                column.append(-values if key.descending else values)
        found, keys = np.concatenate(indices), [np.concatenate(column) for column in columns]
        # NaN is sorted to the end; equal keys stay in the order of their indices.
        order = np.lexsort(keys[::-1])
        if query.after is not None:
            order = order[_later(query, keys)[order]]
        stop = None if query.limit is None else query.offset + query.limit
        sorted_indices: IntArray = found[order[query.offset : stop]]
        return sorted_indices

    def _by_index(self, query: PointQuery) -> Iterator[PointBlock]:
        skip, left, chunks = query.offset, query.limit, self._candidates(query)
        first = 0 if query.after is None or query.after[0] is None else int(query.after[0]) + 1
        chunks = (chunk for chunk in chunks if chunk.first + chunk.count > first)
        if query.is_unconditional and not first:
            skip, chunks = _without_first(chunks, skip)
        for found in self._matching(query, chunks, self._series):
            block = found.taken(slice(int(np.searchsorted(found.indices, first)), None))
            rows = len(block.indices)
            stop = rows if left is None else min(rows, skip + left)
            if skip < stop:
                yield block.taken(slice(skip, stop))
                left = None if left is None else left - (stop - skip)
            skip = max(0, skip - rows)
            if left == 0:
                return

    def _candidates(self, query: PointQuery) -> Iterator[StoredChunk]:
        """Yield the chunks that may have such points, by their bounds."""
        kept = [each for each in query.conditions if each.subject.name in self._sweep.keep]
        for chunk in self._store.chunks(self._id):
            if all(may_admit(each, chunk.bounds.get(each.subject.name)) for each in kept):
                yield chunk

    def _matching(
        self, query: PointQuery, chunks: Iterable[StoredChunk], series: Sequence[str]
    ) -> Iterator[PointBlock]:
        """Yield the points of ``chunks`` that meet the conditions, by index."""
        kept = [each for each in query.conditions if each.subject.name in self._sweep.keep]
        words = [each for each in query.conditions if each.subject.name == OUTCOME]
        given = [each for each in query.conditions if each not in kept and each not in words]
        for batch in self._batches(chunks):
            indices = _indices(batch)
            axes = self._sweep.columns_at(indices)
            mask = _all(given, {INDEX: indices.astype(np.float64), **axes}, len(indices))
            if not mask.any():
                continue
            block = self._read(batch, indices, axes, series)
            mask &= _all(kept, block.numbers, len(indices))
            for each in words:
                mask &= admits_words(each, block.outcomes)
            yield block if mask.all() else block.taken(mask)

    def _gathered(self, wanted: IntArray) -> Iterator[PointBlock]:
        """Yield the points of the indices ``wanted``, in their order."""
        at_once = max(1, GATHERED_NUMBERS // self.row_numbers)
        for start in range(0, len(wanted), at_once):
            yield self._gather(wanted[start : start + at_once])

    def among(self, wanted: IntArray) -> Iterator[PointBlock]:
        """Yield those of the points with the growing indices ``wanted`` that are stored, without series."""
        for batch in self._batches(self._holding(wanted)):
            indices = _indices(batch)
            block = self._read(batch, indices, self._sweep.columns_at(indices), ())
            yield block.taken(np.isin(indices, wanted, assume_unique=True))

    def _holding(self, ordered: IntArray) -> Iterator[StoredChunk]:
        """Yield the chunks that have any of the points with these growing indices."""
        for chunk in self._store.chunks(self._id):
            first, last = np.searchsorted(ordered, [chunk.first, chunk.first + chunk.count])
            if first < last:
                yield chunk

    def _gather(self, wanted: IntArray) -> PointBlock:
        order = np.argsort(wanted)
        ordered, size = wanted[order], len(wanted)
        found = PointBlock(
            wanted,
            {name: np.empty(size) for name in (*self._sweep.pointers, *self._sweep.keep)},
            np.empty(size, dtype=np.object_),
            {name: np.empty((size, self._sweep.samples)) for name in self._series},
        )
        for batch in self._batches(self._holding(ordered)):
            indices = _indices(batch)
            block = self._read(batch, indices, self._sweep.columns_at(indices), self._series)
            first, last = np.searchsorted(ordered, [indices[0], indices[-1] + 1])
            rows, to = np.searchsorted(indices, ordered[first:last]), order[first:last]
            for name, values in found.numbers.items():
                values[to] = block.numbers[name][rows]
            for name, values in found.series.items():
                values[to] = block.series[name][rows]
            found.outcomes[to] = block.outcomes[rows]
        return found

    def _batches(self, chunks: Iterable[StoredChunk]) -> Iterator[list[StoredChunk]]:
        """Yield the chunks some at a time: small ones together, up to a block's rows."""
        batch: list[StoredChunk] = []
        rows = 0
        for chunk in chunks:
            if batch and (rows + chunk.count > self.block_rows or len(batch) == _CHUNKS_AT_ONCE):
                yield batch
                batch, rows = [], 0
            batch.append(chunk)
            rows += chunk.count
        if batch:
            yield batch

    def _read(
        self,
        batch: Sequence[StoredChunk],
        indices: IntArray,
        axes: Mapping[str, FloatArray],
        series: Sequence[str],
    ) -> PointBlock:
        packets = self._store.data(self._id, [chunk.first for chunk in batch])
        parts = [decode_points(packet, with_series=bool(series)) for packet in packets]
        sizes = [chunk.count for chunk in batch]
        samples = self._sweep.samples
        return PointBlock(
            indices,
            {
                **axes,
                **{name: _joined([part.numbers for part in parts], name, sizes) for name in self._sweep.keep},
            },
            np.array([outcome for part in parts for outcome in part.outcomes], dtype=np.object_),
            {name: _joined([part.series for part in parts], name, sizes, samples) for name in series},
        )


def _indices(batch: Sequence[StoredChunk]) -> IntArray:
    return np.concatenate(
        [np.arange(chunk.first, chunk.first + chunk.count, dtype=np.int64) for chunk in batch]
    )


def _all(conditions: Sequence[Condition], columns: Mapping[str, FloatArray], rows: int) -> BoolArray:
    mask = np.ones(rows, dtype=np.bool_)
    for condition in conditions:
        mask &= admits(condition, columns[condition.subject.name])
    return mask


def _later(query: PointQuery, keys: Sequence[FloatArray]) -> BoolArray:
    """Tell for each point whether it comes after the position ``query.after``; ``keys`` grow in the order."""
    assert query.after is not None
    later, equal = np.zeros(len(keys[0]), dtype=np.bool_), np.ones(len(keys[0]), dtype=np.bool_)
    for key, values, bound in zip(query.keys, keys, query.after, strict=True):
        missing = np.isnan(values)
        if bound is None:
            equal &= missing
            continue
        least = -bound if key.descending else bound
        later |= equal & (missing | (values > least))
        equal &= values == least
    return later


def _joined(
    parts: Sequence[Mapping[str, FloatArray]], name: str, sizes: Sequence[int], *samples: int
) -> FloatArray:
    """Return one column of several chunks; a chunk whose points have no such number left it out."""
    return np.concatenate(
        [
            part[name] if name in part else np.full((size, *samples), np.nan)
            for part, size in zip(parts, sizes, strict=True)
        ]
    )


def _without_first(chunks: Iterator[StoredChunk], rows: int) -> tuple[int, Iterator[StoredChunk]]:
    """Drop the chunks that end within the first ``rows`` points; return how many are left to drop."""
    for chunk in chunks:
        if rows < chunk.count:
            return rows, chain([chunk], chunks)
        rows -= chunk.count
    return 0, iter(())
