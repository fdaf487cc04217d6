"""Computed points of a sweep as a matrix over two axes, and as a table with order statistics."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.schemas.query.terms import Condition, Value
from service.schemas.sweep.sweep import Sweep
from service.storage.searching.statistics import Facet, Statistic, statistic_of
from service.storage.sweeps.point_reader import (
    OUTCOME,
    FloatArray,
    IntArray,
    PointBlock,
    PointQuery,
    PointReader,
    WordArray,
)


@dataclass(frozen=True, slots=True)
class PointGrid:
    """The cells, of shape [rows, columns]: of a sweep of one axis there is one row."""

    indices: IntArray
    """Indices of the points."""
    numbers: FloatArray
    """NaN where a point has none, or is not computed yet."""
    outcomes: WordArray
    """None where a point is not computed yet."""


def cell_indices(sweep: Sweep, at: Mapping[int, int]) -> IntArray:
    """Return the indices of the points of the cells; they grow along a row and from row to row.

    ``at`` has for each axis but one or two, by its index among the axes, the index on it.
    """
    lengths = [each.axis.length for each in sweep.axes]
    # In a grid the last axis runs fastest.
    strides = [int(np.prod(lengths[axis + 1 :], dtype=np.int64)) for axis in range(len(lengths))]
    first = sum(at[axis] * strides[axis] for axis in at)
    *rows, columns = [axis for axis in range(len(lengths)) if axis not in at]
    indices: IntArray = first + strides[columns] * np.arange(lengths[columns], dtype=np.int64)[None, :]
    for axis in rows:
        indices = indices + strides[axis] * np.arange(lengths[axis], dtype=np.int64)[:, None]
    return indices


def read_grid(reader: PointReader, indices: IntArray, name: str) -> PointGrid:
    """Return the number ``name`` of the points that are computed, read a block at a time."""
    wanted = indices.ravel()
    numbers, outcomes = np.full(len(wanted), np.nan), np.full(len(wanted), None, dtype=np.object_)
    for block in reader.among(wanted):
        cells: NDArray[np.intp] = np.searchsorted(wanted, block.indices)
        numbers[cells] = block.column(name)
        outcomes[cells] = block.outcomes
    return PointGrid(indices, numbers.reshape(indices.shape), outcomes.reshape(indices.shape))


class PointTable:
    """The points that meet the conditions; a column is read when it is asked for, at 8 bytes a point."""

    def __init__(self, reader: PointReader, conditions: Sequence[Condition]) -> None:
        self._reader, self._query = reader, PointQuery(tuple(conditions))

    def facet(self, name: str, limit: int) -> Facet:
        """Return the most frequent values of a column."""
        counted = Counter[Value | None]()
        for block in self._reader.blocks(self._query):
            for value, rows in _groups(block, name):
                counted[value] += len(rows)
        values = sorted(counted.items(), key=lambda item: (-item[1], item[0] is None, item[0] or 0.0))
        return Facet(name, tuple(values[:limit]), sum(count for _, count in values[limit:]))

    def statistics(self, name: str, by: str | None, *, bins: int, groups: int) -> Iterator[Statistic]:
        """Yield the statistics of a number in each of the largest groups."""
        found: dict[Value | None, list[FloatArray]]
        found = {None: []} if by is None else {value: [] for value, _ in self.facet(by, groups).values}
        for block in self._reader.blocks(self._query):
            numbers = block.column(name)
            if by is None:
                found[None].append(numbers)
                continue
            for value, rows in _groups(block, by):
                if value in found:
                    found[value].append(numbers[rows])
        for value, parts in found.items():
            yield statistic_of(name, value, np.concatenate([np.empty(0), *parts]), bins)


def _groups(block: PointBlock, name: str) -> Iterator[tuple[Value | None, IntArray]]:
    """Yield each value of a column with the rows that have it."""
    column = block.outcomes.astype(np.str_) if name == OUTCOME else block.column(name)
    values, inverse = np.unique(column, return_inverse=True)
    order = np.argsort(inverse, kind="stable")
    ends = np.searchsorted(inverse[order], np.arange(1, max(1, len(values))))
    for value, rows in zip(values.tolist(), np.split(order, ends), strict=False):
        yield (None if value != value else value), rows
