"""Translates conditions to SQL that means the same on SQLite and Postgres."""

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any  # SQL expressions of some type

from sqlalchemy import ColumnClause, ColumnElement, Double, Select, UnaryExpression, bindparam, false, select
from sqlalchemy.sql.operators import custom_op

from service.schemas.query.conditions import Condition, Kind, Value
from service.storage.searching.sources import Expression, Source

_COMPARE: Mapping[str, Callable[[Any, Any], ColumnElement[bool]]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def conditions_of(
    source: Source, conditions: Sequence[Condition], *, is_test: bool = False
) -> list[ColumnElement[bool]]:
    """Return the SQL of conditions, each of which must hold.

    ``is_test`` if rows that have been found otherwise are tested: SQLite then takes no index for them.
    """
    return [_condition(source, each, is_test) for each in conditions]


def found_in_index(source: Source, about: Sequence[Condition]) -> Select[str]:
    """Return the statement that finds, in one index, the ids of the rows that meet conditions on one subject.

    The subject may have a table of its own, such as a label: a row without a value is not among them.
    """
    subject = about[0].subject
    table = source.attached(subject)
    if table is None:
        return select(source.id).where(*source.always, *conditions_of(source, about))
    meet = values_meet(table.value.expression, about)
    return select(table.owner_id).where(table.key == source.key_of(subject), *meet)


def values_meet(value: Expression, about: Sequence[Condition]) -> list[ColumnElement[bool]]:
    """Return the SQL of conditions on one subject whose value is an expression."""
    return [_compared(value, condition) for condition in about]


def untouched(expression: Expression) -> Expression:
    """Return a column as SQLite reads it without choosing an index for it."""
    if not isinstance(expression, ColumnClause):
        return expression
    plain: Expression = UnaryExpression(expression, operator=custom_op("+"), type_=expression.type)
    return plain


def _condition(source: Source, condition: Condition, is_test: bool) -> ColumnElement[bool]:
    subject = condition.subject
    if is_test:
        return _compared(untouched(source.expression(subject)), condition)
    if subject.place == "label" and condition.operator != "is null" and not source.is_led_by(subject):
        # Read from the index of labels, which has few rows where few meet it.
        return source.id.in_(found_in_index(source, [condition]))
    return _compared(source.expression(subject), condition)


def _compared(expression: Expression, condition: Condition) -> ColumnElement[bool]:
    kind = condition.subject.kind
    match condition.operator:
        case "is null":
            return expression.is_(None)
        case "is not null":
            return expression.is_not(None)
        case "in":
            values = list(dict.fromkeys(condition.values))
            return expression.in_([bound(kind, value) for value in values]) if values else false()
    return _COMPARE[condition.operator](expression, bound(kind, condition.values[0]))


def bound(kind: Kind, value: Value | None) -> Any:  # noqa: ANN401
    """Return a value as the parameter that an expression of its kind is compared with."""
    # A double is never rounded to the type of an integer column: attempt<1.5 is true for 1.
    return bindparam(None, value, type_=Double()) if kind.has_order else value
