"""Reads pages of a list in any order: by cursor at a cost that does not grow, or by offset.

Rows without a value come last in either direction. Databases put nulls at different
ends of an index, and no single index gives "nulls last" both ways; so rows with the
first column of the order and rows without it are read one after the other, and each
of the two parts can use an index.

A cursor is the place of the last row in the order, not a number of rows: rows that come
in meanwhile neither repeat others nor hide them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any  # rows and parameters of some type

from sqlalchemy import ColumnElement, Row, Select, func, select
from sqlalchemy.orm import Session

from service.schemas.query.conditions import Condition, Value
from service.schemas.query.list_query import ListQuery
from service.storage.searching.conditions import conditions_of
from service.storage.searching.narrowing import in_order_of_labels, narrowed
from service.storage.searching.ordering import SortedColumn, beyond, order_of, sorting_of
from service.storage.searching.sources import Source
from service.storage.searching.walking import walk_of, walked


@dataclass(frozen=True, slots=True)
class FoundPage:
    """One page of a list."""

    ids: tuple[str, ...]
    values: tuple[tuple[Value | None, ...], ...]
    """The wanted columns of each row."""
    next: tuple[Value | None, ...] | None
    """Where the following page begins; None if there is none."""
    total: int | None
    """How many rows there are in all, if that was wanted."""


def find(session: Session, source: Source, query: ListQuery) -> FoundPage:
    """Return one page."""
    total = count(session, source, query.conditions) if query.is_counted else None
    given, few = query.conditions, narrowed(session, source, query)
    if not few:
        source, given = in_order_of_labels(source, query)
    conditions = [*conditions_of(source, given), *few]
    order = order_of(session, source, query)
    columns = [source.expression(subject) for subject in query.columns]
    selected: list[Any] = [source.row.id, *(column.expression for column in order), *columns]
    statement = select(*selected).where(*conditions)
    is_like_index = len(order) <= 2 and all(each.subject == order[0].subject for each in given)
    search = _Search(session, source, query, may_walk=not few and not is_like_index)
    # One more than the page has tells whether there is another one.
    rows = _rows(search, statement, order, query.after, query.limit + 1, query.offset)
    page = rows[: query.limit]
    return FoundPage(
        tuple(row[0] for row in page),
        tuple(tuple(row[1 + len(order) :]) for row in page),
        tuple(page[-1][1 : 1 + len(order)]) if len(rows) > query.limit else None,
        total,
    )


def count(session: Session, source: Source, conditions: Sequence[Condition]) -> int:
    """Return how many rows meet the conditions."""
    statement = select(func.count()).select_from(source.row).where(*conditions_of(source, conditions))
    return session.scalar(statement) or 0


@dataclass(frozen=True, slots=True)
class _Search:
    """The query for a page, and the source of its rows."""

    session: Session
    source: Source
    query: ListQuery
    may_walk: bool
    """Whether the index of the order does not by itself lead to the page, and nothing better is known."""


def _rows(
    search: _Search,
    statement: Select[Any],
    order: Sequence[SortedColumn],
    after: Sequence[Value | None] | None,
    wanted: int,
    offset: int,
    inside: Sequence[ColumnElement[Any]] = (),
) -> list[Row[Any]]:
    """Return rows of a statement; ``inside`` is what an index that begins with the order can tell of them."""
    first = order[0]
    if not first.may_be_null:
        return _part(search, statement, order, after, wanted, offset, inside)
    known, unknown = _parts_needed(search.query, first)
    rows: list[Row[Any]] = []
    skipped = offset
    if known and not (after is not None and after[0] is None):
        is_known = first.expression.is_not(None)
        with_first = statement.where(is_known)
        rows = _part(search, with_first, [first.present, *order[1:]], after, wanted, skipped, [is_known])
        after = None
        if unknown and not rows and skipped:
            counted = with_first.order_by(None).with_only_columns(func.count(), maintain_column_froms=True)
            skipped -= search.session.scalar(counted) or 0
        else:
            skipped = 0
    if unknown and len(rows) < wanted:
        is_unknown = first.expression.is_(None)
        # Sorted by the missing column all the same, so that Postgres takes its index.
        without = statement.where(is_unknown).order_by(first.present.sorting()[0])
        rest = None if after is None else after[1:]
        # The index of a column has the rows without it in the order of the id.
        inside = [is_unknown] if len(order) == 2 else []
        rows += _rows(search, without, order[1:], rest, wanted - len(rows), max(0, skipped), inside)
    return rows


def _parts_needed(query: ListQuery, first: SortedColumn) -> tuple[bool, bool]:
    """Tell whether rows with the first column of an order, and rows without it, can meet the conditions."""
    about = [each.operator for each in query.conditions if each.subject == first.subject]
    return "is null" not in about, all(operator == "is null" for operator in about)


def _part(
    search: _Search,
    statement: Select[Any],
    order: Sequence[SortedColumn],
    after: Sequence[Value | None] | None,
    limit: int,
    offset: int,
    inside: Sequence[ColumnElement[Any]],
) -> list[Row[Any]]:
    if after is not None:
        statement = statement.where(*beyond(order, after))
    if search.may_walk:
        about_first = [each for each in search.query.conditions if each.subject == order[0].subject]
        known = [*inside, *conditions_of(search.source, about_first)]
        walk = walk_of(search.session, search.source, order, known)
        if walk is not None:
            rows = walked(search.session, walk, statement, after, limit + offset)
            if rows is not None:
                return rows[offset:]
    statement = statement.order_by(*sorting_of(order)).limit(limit)
    return list(search.session.execute(statement.offset(offset) if offset else statement).all())
