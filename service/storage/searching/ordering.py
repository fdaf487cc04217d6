"""The columns of an order as SQL, and the conditions for what comes after a place in it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, Self  # parameters of some type

from sqlalchemy import ColumnElement, and_, false, or_
from sqlalchemy.orm import Session

from service.schemas.query.conditions import Kind, OrderKey, Subject, Value
from service.storage.database.database import is_postgres
from service.storage.searching.conditions import bound
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
