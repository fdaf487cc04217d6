"""Counts of values, and order statistics of numbers, under the conditions of a query.

A quartile is one of the numbers, the smallest that at least a quarter (half, three
quarters) of them do not exceed; so it is exact, and the same on every database.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any  # values and expressions of some type

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Select, func, null, select
from sqlalchemy.orm import Session

from service.schemas.query.terms import Condition, Kind, Subject, Value
from service.storage.searching.narrowing import met
from service.storage.searching.sources import Source

FloatArray = NDArray[np.float64]
QUARTERS = (1, 2, 3)
_PART = 1000
"""Rows that are read at a time, as many as stay in the cache of a processor."""


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
    met_by = met(session, source, conditions, by)
    view, given = met_by.source, met_by.given
    for subject in by:
        # In a subquery, so that the expression has one set of parameters: Postgres compares them by place.
        value = view.expression(subject).label("value")
        rows = view.select(value).where(*given).subquery()
        number = func.count()
        order = number.desc(), rows.c.value.is_(None), rows.c.value
        # The sum is that of all values, before the most frequent are taken.
        counted = select(rows.c.value, number, func.sum(number).over()).group_by(rows.c.value)
        found = session.execute(counted.order_by(*order).limit(limit)).all()
        total = int(found[0][2]) if found else 0
        values = tuple((_plain(subject, value), int(count)) for value, count, _ in found)
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
    """Yield the statistics of each number in each of the ``groups`` largest groups.

    The numbers are read once and sorted here: in SQL each quartile and each edge of a bin is a walk through
    all of them. A number of the problem that has no column is read in its own table.
    """
    codes: dict[Any, int] = {None: 0} if by is None else {}
    together = [each for each in of if not source.has_number(each)]
    found = _read(session, source, conditions, together, by, codes) if together else {}
    rows = Counter(dict(enumerate(np.bincount(found[together[0]].groups).tolist()))) if together else None
    for subject in of:
        if subject not in found:
            present = (*conditions, Condition(subject, "is not null"))
            found |= _read(session, source, present, [subject], by, codes)
    rows = _sizes(session, source, conditions, by, codes) if rows is None else rows
    largest_first = sorted(codes, key=lambda value: (-rows[codes[value]], value is None, value or 0))
    for subject in of:
        for value in largest_first[:groups]:
            numbers = found[subject].numbers[found[subject].groups == codes[value]]
            missing = np.full(rows[codes[value]] - len(numbers), np.nan)
            group = None if by is None else _plain(by, value)
            yield statistic_of(subject.text, group, np.concatenate([numbers, missing]), bins)


@dataclass(frozen=True, slots=True)
class _Numbers:
    """Numbers that have been read, each with the code of its group."""

    numbers: FloatArray
    groups: NDArray[np.intp]


def _read(
    session: Session,
    source: Source,
    conditions: Sequence[Condition],
    of: Sequence[Subject],
    by: Subject | None,
    codes: dict[Any, int],
) -> dict[Subject, _Numbers]:
    """Return the numbers of the rows that meet the conditions; groups that are new get a code."""
    subjects = of if by is None else (*of, by)
    met_by = met(session, source, conditions, subjects)
    view = met_by.source
    selected: list[Any] = [view.expression(each).label(f"value_{k}") for k, each in enumerate(subjects)]
    numbers: list[list[FloatArray]] = [[np.empty(0)] for _ in of]
    groups = [np.empty(0, np.intp)]
    for part in _parts(session, view.select(*selected).where(*met_by.given)):
        *columns, last = zip(*part, strict=True) if by is not None else (*zip(*part, strict=True), [None])
        for kept, column in zip(numbers, columns, strict=True):
            kept.append(np.array(column, dtype=np.float64))
        in_groups = [codes.setdefault(each, len(codes)) for each in last]
        groups.append(np.broadcast_to(np.array(in_groups, np.intp), len(part)))
    group = np.concatenate(groups)
    return {
        subject: _Numbers(np.concatenate(parts), group) for subject, parts in zip(of, numbers, strict=True)
    }


def _sizes(
    session: Session,
    source: Source,
    conditions: Sequence[Condition],
    by: Subject | None,
    codes: dict[Any, int],
) -> Counter[int]:
    """Return how many rows each group has, by its code."""
    if by is None:
        met_by = met(session, source, conditions)
        counted = met_by.source.select(null(), func.count()).where(*met_by.given)
    else:
        met_by = met(session, source, conditions, [by])
        rows = (
            met_by.source.select(met_by.source.expression(by).label("value")).where(*met_by.given).subquery()
        )
        counted = select(rows.c.value, func.count()).group_by(rows.c.value)
    return Counter(
        {codes.setdefault(value, len(codes)): count for value, count in session.execute(counted) if count}
    )


def _parts(session: Session, statement: Select[Any]) -> Iterator[Sequence[Any]]:
    """Yield what a statement selects, many rows at a time.

    They are read by the driver's cursor: the rows that SQLAlchemy makes of them take five times as long.
    """
    with closing(session.connection().execute(statement, execution_options={"yield_per": _PART})) as result:
        first, cursor = result.fetchone(), result.cursor
        if first is not None and cursor is not None:
            yield [tuple(first)]  # it has been read ahead, and no other
            while part := cursor.fetchmany(_PART):
                yield part


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


def _plain(subject: Subject, value: Any) -> Value | None:  # noqa: ANN401
    if value is None or isinstance(value, str):
        return value
    return bool(value) if subject.kind is Kind.TRUTH else float(value)
