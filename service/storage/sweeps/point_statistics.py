"""Counts and order statistics of the computed points of a sweep that meet some conditions."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from service.schemas.query.conditions import Condition, Value
from service.storage.searching.statistics import Facet, Statistic, statistic_of
from service.storage.sweeps.point_query import OUTCOME, FloatArray, PointQuery
from service.storage.sweeps.point_reader import IntArray, PointBlock, PointReader


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
    values, places = np.unique(column, return_inverse=True)
    order = np.argsort(places, kind="stable")
    ends = np.searchsorted(places[order], np.arange(1, max(1, len(values))))
    for value, rows in zip(values.tolist(), np.split(order, ends), strict=False):
        yield (None if value != value else value), rows
