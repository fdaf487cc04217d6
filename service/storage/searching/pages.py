"""Reads pages of a list in any order: by cursor at a cost that does not grow, or by offset.

Rows without a value come last in either direction. Databases put nulls at different
ends of an index, and no single index gives "nulls last" both ways; so rows with the
first column of the order and rows without it are read one after the other, and each
of the two parts can use an index.

A cursor is the place of the last row in the order, not a number of rows: rows that come
in meanwhile neither repeat others nor hide them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any  # rows and parameters of some type

from sqlalchemy import ColumnElement, Row, Select, func, select
from sqlalchemy.orm import Session, aliased

from service.schemas.query.conditions import ID, Condition, ListQuery, Subject, Value
from service.storage.database.database import is_postgres
from service.storage.searching.conditions import conditions_of, values_meet
from service.storage.searching.narrowing import (
    FEW,
    MANY,
    MOST,
    in_order_of_labels,
    members,
    met,
    narrowed,
    tests,
)
from service.storage.searching.ordering import SortedColumn, beyond, order_of, sorting_of
from service.storage.searching.sources import Expression, Source

WINDOW, WINDOW_OF_ROWS = 20_000, 2_000
"""Rows that are tried in the order of a page before others: in an index alone, and in the table."""


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
    rows = _found(session, source, query)
    page = rows[: query.limit]
    ids = tuple(row[0] for row in page)
    return FoundPage(
        ids,
        _columns(session, source, query.columns, ids),
        tuple(page[-1][1:]) if len(rows) > query.limit else None,
        total,
    )


def count(session: Session, source: Source, conditions: Sequence[Condition]) -> int:
    """Return how many rows meet the conditions."""
    statement = select(func.count()).select_from(source.row).where(*met(session, source, conditions))
    return session.scalar(statement) or 0


@dataclass(frozen=True, slots=True)
class _Search:
    """The query for a page, and the source of its rows."""

    session: Session
    source: Source
    query: ListQuery
    order: Sequence[SortedColumn]
    conditions: Sequence[ColumnElement[bool]]
    window: int | None = None
    """Rows of the index of the order that are tried at most; None if that is not bounded."""
    is_walked: bool = False
    """Whether rows are read in the order of the page, until there are enough."""

    def rows(self) -> list[Row[Any]] | None:
        """Return the rows of the page; None if the window has not enough of them."""
        order, source, query = self.order, self.source, self.query
        values = [column.expression.label(f"value_{place}") for place, column in enumerate(order)]
        selected: list[Any] = [source.row.id.label("row"), *values]
        statement = select(*selected).where(*self.conditions)
        if not self.is_walked:
            # All are found before they are sorted: an OFFSET keeps the index of the order out of it.
            found = statement.offset(0).subquery()
            statement = select(*found.c)
            order = [
                replace(each, expression=found.c[value.name])
                for each, value in zip(order, values, strict=True)
            ]
        # One more than the page has tells whether there is another one.
        wanted = query.limit + 1
        if self.is_walked:
            return _rows(self, statement, order, query.after, wanted, query.offset)
        return _part(self, statement, order, query.after, wanted, query.offset, ())


def _found(session: Session, source: Source, query: ListQuery) -> list[Row[Any]]:
    """Return the rows of a page, one more than it has if there is another one.

    They are those that meet a condition that few rows meet, or the first ones in the order of the page; if
    these do not have enough of them, those that meet a condition that not too many meet.
    """
    asked = [*(each.subject for each in query.conditions), *(key.subject for key in query.keys)]
    is_covered = all(map(source.is_covered, asked))
    few = narrowed(session, source, query.conditions, (FEW, MANY) if is_covered else (FEW,))
    if few is None:
        rows = _walk(session, source, query, is_bounded=True).rows()
        if rows is not None:
            return rows
        few = narrowed(session, source, query.conditions, (MOST,))
        if few is None and not is_postgres(session.connection()):
            return _walk(session, source, query, is_bounded=False).rows() or []
        # Postgres has statistics of the other conditions.
        few = few or [*source.always, *conditions_of(source, query.conditions)]
    return _Search(session, source, query, order_of(session, source, query), few).rows() or []


def _walk(session: Session, source: Source, query: ListQuery, *, is_bounded: bool) -> _Search:
    """Return the search in the order of the page, in a window of it or as far as there are rows."""
    labelled, given = in_order_of_labels(source, query)
    first = query.keys[0].subject
    order = order_of(session, labelled, query)
    if given == query.conditions and not source.has_index_of(first):
        # The database chooses.
        chosen = [*source.always, *conditions_of(source, given)]
        return _Search(session, source, query, order, chosen, is_walked=True)
    about = [each for each in given if each.subject == first]
    others = [] if is_bounded else members(source, [each for each in given if each not in about])
    conditions = [
        *labelled.always,
        *conditions_of(labelled, about),
        *tests(session, labelled, given, about, others),
    ]
    window = None
    if is_bounded and given == query.conditions:
        window = WINDOW if all(source.is_covered(each.subject) for each in given) else WINDOW_OF_ROWS
    return _Search(session, labelled, query, order, conditions, window, is_walked=True)


def _labelled(expressions: Iterable[Expression]) -> list[ColumnElement[Any]]:
    return [expression.label(f"value_{place}") for place, expression in enumerate(expressions)]


def _columns(
    session: Session, source: Source, columns: Sequence[Subject], ids: Sequence[str]
) -> tuple[tuple[Value | None, ...], ...]:
    """Return the wanted columns of rows, read when it is known which rows they are."""
    if not columns:
        return ((),) * len(ids)
    selected: list[Any] = [source.row.id.label("row"), *_labelled(map(source.expression, columns))]
    statement = select(*selected).where(source.row.id.in_(ids))
    found = {row[0]: tuple(row[1:]) for row in session.execute(statement)}
    return tuple(found[each] for each in ids)


def _rows(
    search: _Search,
    statement: Select[Any],
    order: Sequence[SortedColumn],
    after: Sequence[Value | None] | None,
    wanted: int,
    offset: int,
) -> list[Row[Any]] | None:
    first = order[0]
    if not first.may_be_null:
        return _part(search, statement, order, after, wanted, offset, _about(search, first))
    known, unknown = _parts_needed(search.query, first)
    rows: list[Row[Any]] = []
    skipped = offset
    if known and not (after is not None and after[0] is None):
        with_first, in_order, inside = _with_first(search, statement, order)
        found = _part(search, with_first, in_order, after, wanted, skipped, inside)
        if found is None:
            return None
        rows, after = found, None
        if unknown and not rows and skipped:
            counted = with_first.order_by(None).with_only_columns(func.count(), maintain_column_froms=True)
            skipped -= search.session.scalar(counted) or 0
        else:
            skipped = 0
    if unknown and len(rows) < wanted:
        # Sorted by the missing column all the same, so that Postgres takes its index.
        without = statement.where(first.expression.is_(None)).order_by(first.present.sorting()[0])
        rest = None if after is None else after[1:]
        whole = replace(search, window=None)
        rows += _rows(whole, without, order[1:], rest, wanted - len(rows), max(0, skipped)) or []
    return rows


def _about(search: _Search, first: SortedColumn) -> list[ColumnElement[bool]]:
    """Return the conditions on the first column of an order, which its index can tell."""
    about = [each for each in search.query.conditions if each.subject == first.subject]
    return values_meet(first.expression, about)


def _with_first(
    search: _Search, statement: Select[Any], order: Sequence[SortedColumn]
) -> tuple[Select[Any], list[SortedColumn], list[ColumnElement[bool]]]:
    """Return the statement for rows with a value in the first column, their order, and what its index tells.

    A number without a column is read in the order of its own table.
    """
    first, *others = order
    numbers = search.source.attached(first.subject) if first.subject.place == "pointer" else None
    if numbers is None:
        is_known = first.expression.is_not(None)
        return statement.where(is_known), [first.present, *others], [is_known, *_about(search, first)]
    table = aliased(numbers)
    in_table = replace(first.present, expression=table.value.expression)
    owner = table.owner_id.expression
    inside = [table.key == search.source.key_of(first.subject), *_about(search, in_table)]
    in_order = [
        in_table,
        *(replace(each, expression=owner) if each.subject == ID else each for each in others),
    ]
    return statement.where(owner == search.source.row.id, *inside), in_order, inside


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
    inside: Sequence[ColumnElement[bool]],
) -> list[Row[Any]] | None:
    """Return rows of a statement; ``inside`` is what an index that begins with the order can tell of them."""
    first, last = order[0], None
    if search.window is not None:
        begin = [] if after is None or after[0] is None else [first.not_before(after[0])]
        window = select(first.expression).where(*inside, *begin).order_by(*sorting_of([first]))
        last = search.session.scalar(window.limit(1).offset(search.window))
    if after is not None:
        statement = statement.where(*beyond(order, after))
    if last is not None:
        statement = statement.where(first.not_after(last))
    statement = statement.order_by(*sorting_of(order)).limit(limit)
    rows = search.session.execute(statement.offset(offset) if offset else statement).all()
    return None if last is not None and len(rows) < limit else list(rows)
