"""Translates conditions to SQL that means the same on SQLite and Postgres."""

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any  # SQL expressions of some type

from sqlalchemy import ColumnElement, Double, Select, bindparam, false, select

from service.schemas.query.conditions import Condition, Value
from service.schemas.query.kinds import Kind
from service.storage.searching.sources import Expression, Source

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


def labelled(source: Source, condition: Condition) -> Select[str]:
    """Return the statement that finds the ids of the rows whose label meets a condition, in an index.

    The label may have any name but no missing value: a row without it is not among them.
    """
    labels = source.labels
    meets = _compared(labels.value.expression, condition)
    return select(labels.owner_id).where(labels.key == condition.subject.name, meets)


def _condition(source: Source, condition: Condition) -> ColumnElement[bool]:
    if condition.subject.place == "label" and condition.operator != "is null":
        # Read from the index of labels, which has few rows where few meet it.
        return source.row.id.in_(labelled(source, condition))
    return _compared(source.expression(condition.subject), condition)


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
