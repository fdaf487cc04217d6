"""Reads pages of a list in any order: by cursor at a cost that does not grow, or by offset.

Rows without a value come last in either direction. Databases put nulls at different
ends of an index, and no single index gives "nulls last" both ways; so rows with the
first column of the order and rows without it are read one after the other, and each
of the two parts can use an index.

A cursor is the place of the last row in the order, not a number of rows: rows that come
in meanwhile neither repeat others nor hide them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import (
    Any,  # parameters of some type
    Self,  # parameters of some type
)

from sqlalchemy import ColumnElement, Select, and_, false, func, or_, select
from sqlalchemy.orm import Session

from service.schemas.query.terms import ID, Condition, Kind, ListQuery, OrderKey, Subject, Value
from service.storage.database.database import is_postgres
from service.storage.searching.narrowing import (
    MANY,
    MOST,
    ROW,
    Narrowed,
    bound,
    conditions_of,
    entries,
    label_of_order,
    members,
    met,
    met_by_few,
    tests,
)
from service.storage.searching.sources import Expression, Source


@dataclass(frozen=True, slots=True)
class SortedColumn:
    """A column of an order, as SQL. Rows without a value come last in either direction."""

    subject: Subject
    expression: Expression
    descending: bool
    may_be_null: bool

    @property
    def present(self) -> Self:
        """The column among rows that have a value in it."""
        return replace(self, may_be_null=False)

    def later(self, value: Value | None) -> ColumnElement[bool]:
        """Return the condition for what comes after a value."""
        if value is None:
            return false()
        given = bound(self.subject.kind, value)
        beyond: ColumnElement[bool] = self.expression < given if self.descending else self.expression > given
        return or_(beyond, self.expression.is_(None)) if self.may_be_null else beyond

    def not_before(self, value: Value) -> ColumnElement[bool]:
        """Return the condition that lets an index begin at a value."""
        given = bound(self.subject.kind, value)
        least: ColumnElement[bool] = self.expression <= given if self.descending else self.expression >= given
        return least

    def not_after(self, value: Value) -> ColumnElement[bool]:
        """Return the condition that lets an index end at a value."""
        given = bound(self.subject.kind, value)
        most: ColumnElement[bool] = self.expression >= given if self.descending else self.expression <= given
        return most

    def equal(self, value: Value | None) -> ColumnElement[bool]:
        """Return the condition for the same value."""
        if value is None:
            return self.expression.is_(None)
        same: ColumnElement[bool] = self.expression == bound(self.subject.kind, value)
        return same

    def sorting(self) -> list[ColumnElement[Any]]:
        """Return what the statement sorts by."""
        direction = self.expression.desc() if self.descending else self.expression.asc()
        return [self.expression.is_(None), direction] if self.may_be_null else [direction]


def sorting_of(order: Sequence[SortedColumn]) -> list[ColumnElement[Any]]:
    """Return what a statement in this order sorts by."""
    return [each for column in order for each in column.sorting()]


def beyond(order: Sequence[SortedColumn], after: Sequence[Value | None]) -> list[ColumnElement[bool]]:
    """Return the conditions for the rows that come after a row with the values ``after``."""
    equal = [column.equal(value) for column, value in zip(order, after, strict=True)]
    ways = [
        and_(*islice(equal, place), column.later(value))
        for place, (column, value) in enumerate(zip(order, after, strict=True))
    ]
    first, value = order[0], after[0]
    bounds = [] if value is None or first.may_be_null else [first.not_before(value)]
    return [*bounds, or_(*ways)]


def order_of(session: Session, source: Source, keys: Sequence[OrderKey]) -> list[SortedColumn]:
    """Return the columns of an order."""
    is_on_postgres = is_postgres(session.connection())
    columns = []
    for key in keys:
        subject, expression = key.subject, source.expression(key.subject)
        if is_on_postgres and subject.kind in (Kind.WORD, Kind.TEXT):
            # By code points as SQLite does, whatever the language of the database.
            expression = expression.collate("C")
        columns.append(SortedColumn(subject, expression, key.descending, source.may_be_null(subject)))
    return columns


FURTHER = 30
"""How many times as many entries are counted, if fewer do not find a way."""

_Row = tuple[Any, ...]
"""An id, and the values of the order's columns."""


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


@dataclass(frozen=True, slots=True)
class _Search:
    """Rows in some order that are looked for."""

    session: Session
    source: Source
    conditions: tuple[Condition, ...]
    keys: tuple[OrderKey, ...]
    after: tuple[Value | None, ...] | None
    wanted: int
    offset: int
    missing: tuple[OrderKey, ...] = ()
    """Keys before these of which the rows have no value."""


def find(session: Session, source: Source, query: ListQuery) -> FoundPage:
    """Return one page."""
    total = count(session, source, query.conditions, query.count_limit) if query.is_counted else None
    # One more than the page has tells whether there is another one.
    search = _Search(
        session, source, query.conditions, query.keys, query.after, query.limit + 1, query.offset
    )
    rows = _found(search)
    page = rows[: query.limit]
    ids = tuple(row[0] for row in page)
    return FoundPage(
        ids,
        _columns(session, source, query.columns, ids),
        tuple(page[-1][1:]) if len(rows) > query.limit else None,
        total,
    )


def count(
    session: Session, source: Source, conditions: Sequence[Condition], limit: int | None = None
) -> int | None:
    """Return how many rows meet the conditions; None if they are more than a limit."""
    met_by = met(session, source, conditions)
    view, given = met_by.source, met_by.given
    if limit is None:
        return session.scalar(view.select(func.count()).where(*given)) or 0
    some = view.select(view.id).where(*given).limit(limit + 1).subquery()
    found = session.scalar(select(func.count()).select_from(some)) or 0
    return found if found <= limit else None


def _found(search: _Search) -> list[_Row]:
    """Return the rows.

    They are those that meet a condition that few rows meet, or the first ones in the order of the page; if
    these have not enough of them, the same with a greater bound.
    """
    lead, about = _led(search)
    sorted_by = [key.subject for key in search.keys]
    bound = MANY
    while bound <= MOST and (lead is None or len(about) < len(search.conditions)):
        few = met_by_few(search.session, search.source, search.conditions, sorted_by, bound)
        if few is not None:
            return _sorted(search, few)
        rows = _walked(search, window=bound)
        if rows is not None:
            return rows
        bound *= FURTHER
    return _walked(search) or []


def _sorted(search: _Search, few: Narrowed) -> list[_Row]:
    """Return the rows from those that meet the conditions, all of which are sorted."""
    source, given = few.source, few.given
    order = order_of(search.session, source, search.keys)
    # All are found before they are sorted: an OFFSET keeps the index of the order out of it.
    found = _selected(source, order).where(*given).offset(0).subquery()
    in_found = [replace(column, expression=found.c[place]) for place, column in enumerate(order, 1)]
    return _read(search, select(*found.c), in_found, sorting_of(in_found))


def _walked(search: _Search, *, window: int | None = None) -> list[_Row] | None:
    """Return the rows, read in their order, or None: they are not among the first ones of an index.

    ``window``: so many entries of it are read at most, or rows looked up in that time.
    """
    first, after = search.keys[0].subject, search.after
    if not search.source.may_be_null(first):
        return _in_order(search, window)
    about = [each.operator for each in search.conditions if each.subject == first]
    rows: list[_Row] = []
    skipped = search.offset
    if "is null" not in about and not (after is not None and after[0] is None):
        present = replace(search, conditions=(*search.conditions, Condition(first, "is not null")))
        found = _in_order(present, window)
        if found is None:
            return None
        rows, after = found, None
        if rows:
            skipped = 0
        elif skipped:
            skipped -= count(search.session, search.source, present.conditions) or 0
    if all(operator == "is null" for operator in about) and len(rows) < search.wanted:
        missing = replace(
            search,
            conditions=(*search.conditions, Condition(first, "is null")),
            keys=search.keys[1:],
            after=None if after is None else after[1:],
            wanted=search.wanted - len(rows),
            offset=max(0, skipped),
            missing=(*search.missing, search.keys[0]),
        )
        # No index has the rows without a number that has no column.
        is_searched = search.source.attached(first) is not None
        others = _found(missing) if is_searched else _walked(missing)
        rows += [(row[0], None, *row[1:]) for row in others or []]
    return rows


def _led(search: _Search) -> tuple[Subject | None, list[Condition]]:
    """Return the subject in whose index rows are read in their order, and the conditions that it tells.

    None, and all conditions, if the database chooses.
    """
    labels = label_of_order(search.conditions, search.keys)
    if labels:
        return labels[0].subject, labels
    first = search.keys[0].subject
    if not search.source.has_index_of(first):
        return None, list(search.conditions)
    missing = [key.subject for key in search.missing if search.source.is_covered(key.subject)]
    known = [first, *missing]
    return first, [each for each in search.conditions if each.subject in known]


def _index_of(
    search: _Search, lead: Subject | None, about: Sequence[Condition]
) -> tuple[Source, list[ColumnElement[bool]]]:
    """Return where the index that rows are read in is, and the SQL of what it tells."""
    source = search.source
    view = source if lead is None or source.attached(lead) is None else source.through(lead)
    return view, conditions_of(view, about)


def _tried_in_rows(search: _Search, lead: Subject, about: Sequence[Condition]) -> list[Condition]:
    """Return the conditions that the index that rows are read in has nothing of."""
    view, _ = _index_of(search, lead, about)
    return [each for each in search.conditions if each not in about and not view.is_covered(each.subject)]


def _collected(
    search: _Search, lead: Subject, about: Sequence[Condition], window: int | None
) -> list[list[Condition]]:
    """Return those of these conditions whose rows are collected from tables of their own, in a window few."""
    found = members(search.source, _tried_in_rows(search, lead, about))
    if window is None:
        return found
    return [each for each in found if entries(search.session, search.source, each, window) <= window]


def _in_order(search: _Search, window: int | None) -> list[_Row] | None:
    """Return rows that all have a value in the first column of their order."""
    session, source, conditions, keys = search.session, search.source, search.conditions, search.keys
    lead, about = _led(search)
    others = [] if lead is None else _collected(search, lead, about, window)
    view = source
    if lead is not None and source.attached(lead) is not None:
        collected = [each for about_one in others for each in about_one]
        asked = [each.subject for each in conditions if each not in collected]
        view = source.through(lead, [*asked, *(key.subject for key in keys)])
    given = [*view.always, *conditions_of(view, about), *tests(session, view, conditions, about, others)]
    order = order_of(session, view, keys)
    order[0] = order[0].present
    # Sorted by the missing columns all the same, so that Postgres takes their index.
    missing = [key for key in search.missing if view.is_covered(key.subject)]
    led_by = [each.present for each in order_of(session, view, missing)]
    statement = _selected(view, order).where(*given)
    last = None
    if window is not None and lead is not None and len(about) < len(conditions):
        last = _end_of_window(search, lead, about, others, window)
        if last is not None:
            statement = statement.where(order[0].not_after(last))
    rows = _read(search, statement, order, [*sorting_of(led_by), *sorting_of(order)])
    return None if last is not None and len(rows) < search.wanted else rows


def _end_of_window(
    search: _Search,
    lead: Subject,
    about: Sequence[Condition],
    others: Sequence[Sequence[Condition]],
    window: int,
) -> Value | None:
    """Return the value at which a window of the index of the order ends, None if it reaches to the end."""
    index, led = _index_of(search, lead, about)
    first = order_of(search.session, index, search.keys[:1])[0].present
    begin = [first.not_before(search.after[0])] if search.after and search.after[0] is not None else []
    collected = [each for about_one in others for each in about_one]
    has_all = lead != ID and all(each in collected for each in _tried_in_rows(search, lead, about))
    size = window if has_all else window // ROW
    statement = index.select(first.expression).where(*index.always, *led, *begin)
    found: Value | None = search.session.scalar(
        statement.order_by(*sorting_of([first])).limit(1).offset(size)
    )
    return found


def _selected(source: Source, order: Sequence[SortedColumn]) -> Select[Any]:
    values = [column.expression.label(f"value_{place}") for place, column in enumerate(order)]
    return source.select(source.id.label("row"), *values)


def _read(
    search: _Search,
    statement: Select[Any],
    order: Sequence[SortedColumn],
    sorting: Sequence[ColumnElement[Any]],
) -> list[_Row]:
    if search.after is not None:
        statement = statement.where(*beyond(order, search.after))
    statement = statement.order_by(*sorting).limit(search.wanted)
    if search.offset:
        statement = statement.offset(search.offset)
    return [tuple(row) for row in search.session.execute(statement)]


def _columns(
    session: Session, source: Source, columns: Sequence[Subject], ids: Sequence[str]
) -> tuple[tuple[Value | None, ...], ...]:
    """Return the wanted columns of rows, read when it is known which rows they are."""
    if not columns:
        return ((),) * len(ids)
    values = [source.expression(each).label(f"value_{place}") for place, each in enumerate(columns)]
    statement = source.select(source.id.label("row"), *values).where(source.id.in_(ids))
    found = {row[0]: tuple(row[1:]) for row in session.execute(statement)}
    return tuple(found[each] for each in ids)
