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
from itertools import islice
from typing import Any  # rows and parameters of some type

from sqlalchemy import ColumnElement, Row, Select, and_, false, func, or_, select
from sqlalchemy.orm import Session

from service.schemas.query.conditions import Condition, Value
from service.schemas.query.kinds import Kind
from service.schemas.query.list_query import ListQuery
from service.storage.database.database import is_postgres
from service.storage.searching.conditions import bound, conditions_of
from service.storage.searching.narrowing import in_order_of_labels, narrowed
from service.storage.searching.sources import Expression, Source


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
class _Key:
    """A column of the order, as SQL."""

    expression: Expression
    kind: Kind
    descending: bool
    may_be_null: bool

    def later(self, value: Value | None) -> ColumnElement[bool]:
        """Return the condition for what comes after a value."""
        if value is None:
            return false()
        given = bound(self.kind, value)
        beyond: ColumnElement[bool] = self.expression < given if self.descending else self.expression > given
        return or_(beyond, self.expression.is_(None)) if self.may_be_null else beyond

    def not_before(self, value: Value) -> ColumnElement[bool]:
        """Return the condition that lets an index begin at a value."""
        given = bound(self.kind, value)
        least: ColumnElement[bool] = self.expression <= given if self.descending else self.expression >= given
        return least

    def equal(self, value: Value | None) -> ColumnElement[bool]:
        """Return the condition for the same value."""
        if value is None:
            return self.expression.is_(None)
        same: ColumnElement[bool] = self.expression == bound(self.kind, value)
        return same

    def sorting(self) -> list[ColumnElement[Any]]:
        """Return what the statement sorts by."""
        direction = self.expression.desc() if self.descending else self.expression.asc()
        return [self.expression.is_(None), direction] if self.may_be_null else [direction]


def find(session: Session, source: Source, query: ListQuery) -> FoundPage:
    """Return one page."""
    total = count(session, source, query.conditions) if query.is_counted else None
    given, few = query.conditions, narrowed(session, source, query)
    if not few:
        source, given = in_order_of_labels(source, query)
    conditions = [*conditions_of(source, given), *few]
    keys = _keys(session, source, query)
    columns = [source.expression(subject) for subject in query.columns]
    selected: list[Any] = [source.row.id, *(key.expression for key in keys), *columns]
    statement = select(*selected).where(*conditions)
    # One more than the page has tells whether there is another one.
    rows = _rows(session, statement, keys, query)
    page = rows[: query.limit]
    return FoundPage(
        tuple(row[0] for row in page),
        tuple(tuple(row[1 + len(keys) :]) for row in page),
        tuple(page[-1][1 : 1 + len(keys)]) if len(rows) > query.limit else None,
        total,
    )


def count(session: Session, source: Source, conditions: Sequence[Condition]) -> int:
    """Return how many rows meet the conditions."""
    statement = select(func.count()).select_from(source.row).where(*conditions_of(source, conditions))
    return session.scalar(statement) or 0


def _rows(session: Session, statement: Select[Any], keys: Sequence[_Key], query: ListQuery) -> list[Row[Any]]:
    wanted, after, first = query.limit + 1, query.after, keys[0]
    if not first.may_be_null:
        return _part(session, statement, keys, after, wanted, query.offset)
    known, unknown = _parts_needed(query)
    rows: list[Row[Any]] = []
    skipped = query.offset
    if known and not (after is not None and after[0] is None):
        with_first = statement.where(first.expression.is_not(None))
        in_order = [_Key(first.expression, first.kind, first.descending, False), *keys[1:]]
        rows = _part(session, with_first, in_order, after, wanted, skipped)
        after = None
        if unknown and not rows and skipped:
            counted = with_first.with_only_columns(func.count(), maintain_column_froms=True)
            skipped -= session.scalar(counted) or 0
        else:
            skipped = 0
    if unknown and len(rows) < wanted:
        without = statement.where(first.expression.is_(None))
        # Sorted by the missing column all the same, so that Postgres takes its index.
        without = without.order_by(_Key(first.expression, first.kind, first.descending, False).sorting()[0])
        rest = None if after is None else after[1:]
        rows += _part(session, without, keys[1:], rest, wanted - len(rows), max(0, skipped))
    return rows


def _parts_needed(query: ListQuery) -> tuple[bool, bool]:
    """Tell whether rows with the first column of the order, and rows without it, can meet the conditions."""
    about = [each.operator for each in query.conditions if each.subject == query.keys[0].subject]
    return "is null" not in about, all(operator == "is null" for operator in about)


def _part(
    session: Session,
    statement: Select[Any],
    keys: Sequence[_Key],
    after: Sequence[Value | None] | None,
    limit: int,
    offset: int,
) -> list[Row[Any]]:
    if after is not None:
        statement = statement.where(*_beyond(keys, after))
    sorting = [each for key in keys for each in key.sorting()]
    statement = statement.order_by(*sorting).limit(limit)
    return list(session.execute(statement.offset(offset) if offset else statement).all())


def _beyond(keys: Sequence[_Key], after: Sequence[Value | None]) -> list[ColumnElement[bool]]:
    """Return the conditions for the rows that come after a row with the values ``after``."""
    equal = [key.equal(value) for key, value in zip(keys, after, strict=True)]
    ways = [
        and_(*islice(equal, place), key.later(value))
        for place, (key, value) in enumerate(zip(keys, after, strict=True))
    ]
    first, value = keys[0], after[0]
    bounds = [] if value is None or first.may_be_null else [first.not_before(value)]
    return [*bounds, or_(*ways)]


def _keys(session: Session, source: Source, query: ListQuery) -> list[_Key]:
    is_on_postgres = is_postgres(session.connection())
    keys = []
    for key in query.keys:
        subject, expression = key.subject, source.expression(key.subject)
        if is_on_postgres and subject.kind in (Kind.WORD, Kind.TEXT):
            # By code points as SQLite does, whatever the language of the database.
            expression = expression.collate("C")
        is_nullable = subject.place != "fact" or subject.name not in source.never_null
        keys.append(_Key(expression, subject.kind, key.descending, is_nullable))
    return keys
