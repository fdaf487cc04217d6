"""Counts of values, and order statistics of numbers, under the conditions of a query.

A quartile is one of the numbers, the smallest that at least a quarter (half, three
quarters) of them do not exceed; so it is exact, and the same on every database.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any  # subqueries with columns of some type

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Double, Subquery, bindparam, case, func, select
from sqlalchemy.orm import Session

from service.schemas.query.conditions import Condition, Subject, Value
from service.schemas.query.kinds import Kind
from service.storage.searching.conditions import conditions_of
from service.storage.searching.sources import Source

FloatArray = NDArray[np.float64]
QUARTERS = (1, 2, 3)


@dataclass(frozen=True, slots=True)
class Facet:
    """The most frequent values of a fact."""

    name: str
    values: tuple[tuple[Value | None, int], ...]
    """Each with its count, the most frequent first; None counts the rows without a value."""
    others: int
    """Rows with a value that is not among these."""


@dataclass(frozen=True, slots=True)
class Statistic:
    """A number over the rows of a group."""

    name: str
    group: Value | None
    """The value that these rows have in common; None without groups, and for rows without such a value."""
    rows: int
    count: int
    """Rows that have the number; what follows is of these."""
    smallest: float | None
    quartiles: tuple[float, float, float] | None
    largest: float | None
    edges: tuple[float, ...] = ()
    """Edges of the bins; each bin goes from an edge up to the next one without it, the last one with it."""
    counts: tuple[int, ...] = ()
    """Count of the numbers in each bin."""


def facets(
    session: Session, source: Source, conditions: Sequence[Condition], by: Sequence[Subject], limit: int
) -> Iterator[Facet]:
    """Yield for each of the subjects its ``limit`` most frequent values."""
    for subject in by:
        # In a subquery, so that the expression has one set of parameters: Postgres compares them by place.
        rows = _rows(source, conditions, {"value": subject})
        number = func.count().label("number")
        counted = select(rows.c.value, number).group_by(rows.c.value)
        found = session.execute(counted.order_by(number.desc(), *_in_order(rows.c.value)).limit(limit)).all()
        total = session.scalar(select(func.count()).select_from(rows)) or 0
        values = tuple((_plain(subject, value), int(count)) for value, count in found)
        yield Facet(subject.text, values, total - sum(count for _, count in values))


def statistics(
    session: Session,
    source: Source,
    conditions: Sequence[Condition],
    of: Sequence[Subject],
    by: Subject | None,
    *,
    bins: int,
    groups: int,
) -> Iterator[Statistic]:
    """Yield the statistics of each number in each of the ``groups`` largest groups."""
    for subject in of:
        wanted = {"number": subject} if by is None else {"number": subject, "value": by}
        rows = _rows(source, conditions, wanted)
        whole = func.count(), func.count(rows.c.number), func.min(rows.c.number), func.max(rows.c.number)
        if by is None:
            found: list[Any] = [(None, *session.execute(select(*whole)).one())]
        else:
            statement = select(rows.c.value, *whole).group_by(rows.c.value)
            largest_first = statement.order_by(whole[0].desc(), *_in_order(rows.c.value)).limit(groups)
            found = list(session.execute(largest_first).all())
        for value, total, count, smallest, largest in found:
            group = [] if by is None else [_is(rows.c.value, value)]
            edges: tuple[float, ...] = ()
            counts: tuple[int, ...] = ()
            if count and bins:
                edges = bin_edges(smallest, largest, bins)
                counts = _histogram(session, rows, group, edges)
            yield Statistic(
                subject.text,
                None if by is None else _plain(by, value),
                total,
                count,
                None if smallest is None else float(smallest),
                _quartiles(session, rows, group, count) if count else None,
                None if largest is None else float(largest),
                edges,
                counts,
            )


def statistic_of(name: str, group: Value | None, numbers: FloatArray, bins: int) -> Statistic:
    """Return the same of numbers in memory; NaN where a row has none."""
    known = np.sort(numbers[np.isfinite(numbers)])
    if not len(known):
        return Statistic(name, group, len(numbers), 0, None, None, None)
    smallest, largest = float(known[0]), float(known[-1])
    first, middle, third = (float(known[quartile_rank(len(known), quarter)]) for quarter in QUARTERS)
    edges = bin_edges(smallest, largest, bins) if bins else ()
    below = [int(np.searchsorted(known, edge)) for edge in edges[1:-1]]
    counts = tuple(np.diff([0, *below, len(known)]).tolist()) if bins else ()
    return Statistic(
        name, group, len(numbers), len(known), smallest, (first, middle, third), largest, edges, counts
    )


def quartile_rank(count: int, quarter: int) -> int:
    """Return the place, from 0, of a quartile among ``count`` sorted numbers."""
    return max(0, -(-count * quarter // 4) - 1)


def bin_edges(smallest: float, largest: float, bins: int) -> tuple[float, ...]:
    """Return the ends of equally wide bins; a single bin if all numbers are the same."""
    if smallest == largest:
        return (float(smallest), float(largest))
    return tuple(np.linspace(smallest, largest, bins + 1).tolist())


def _rows(source: Source, conditions: Sequence[Condition], wanted: dict[str, Subject]) -> Subquery:
    columns: list[Any] = [source.expression(subject).label(name) for name, subject in wanted.items()]
    return select(*columns).select_from(source.row).where(*conditions_of(source, conditions)).subquery()


def _in_order(value: ColumnElement[Any]) -> list[ColumnElement[Any]]:
    return [value.is_(None), value]


def _is(column: ColumnElement[Any], value: object) -> ColumnElement[bool]:
    same: ColumnElement[bool] = column.is_(None) if value is None else column == value
    return same


def _quartiles(
    session: Session, rows: Subquery, group: Sequence[ColumnElement[bool]], count: int
) -> tuple[float, float, float]:
    in_order = (
        select(rows.c.number).where(rows.c.number.is_not(None), *group).order_by(rows.c.number).limit(1)
    )
    first, middle, third = (
        float(session.scalars(in_order.offset(quartile_rank(count, quarter))).one()) for quarter in QUARTERS
    )
    return first, middle, third


def _histogram(
    session: Session, rows: Subquery, group: Sequence[ColumnElement[bool]], edges: Sequence[float]
) -> tuple[int, ...]:
    """Count by comparisons with the edges, which mean the same on every database; roundings may not."""
    below = [
        func.sum(case((rows.c.number < bindparam(None, edge, type_=Double()), 1), else_=0))
        for edge in edges[1:-1]
    ]
    counted = select(*below, func.count(rows.c.number)).where(*group)
    return tuple(np.diff([0, *map(int, session.execute(counted).one())]).tolist())


def _plain(subject: Subject, value: Any) -> Value | None:  # noqa: ANN401
    if value is None or isinstance(value, str):
        return value
    return bool(value) if subject.kind is Kind.TRUTH else float(value)
