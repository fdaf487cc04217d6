"""Translates conditions to SQL that means the same on SQLite and Postgres."""

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any  # SQL expressions of some type

from sqlalchemy import ColumnElement, Double, bindparam, false

from service.schemas.query.conditions import Condition, Value
from service.schemas.query.kinds import Kind
from service.storage.searching.sources import Source

_COMPARE: Mapping[str, Callable[[Any, Any], ColumnElement[bool]]] = {
    "=": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def conditions_of(source: Source, conditions: Sequence[Condition]) -> list[ColumnElement[bool]]:
    """Return the SQL of all conditions, each of which must hold, and of what every listed row meets."""
    return [*source.always, *(_condition(source, each) for each in conditions)]


def _condition(source: Source, condition: Condition) -> ColumnElement[bool]:
    expression, kind = source.expression(condition.subject), condition.subject.kind
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
