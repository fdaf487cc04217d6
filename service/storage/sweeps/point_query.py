"""The query for points of a sweep: conditions, sort order, and how they are evaluated."""

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.schemas.query.conditions import Condition, Kind, OrderKey, Subject

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
WordArray = NDArray[np.object_]

INDEX, OUTCOME = "index", "outcome"
"""Columns that every sweep has, beside its axes and its kept numbers."""

BY_INDEX = OrderKey(Subject("fact", INDEX, Kind.NUMBER))

_COMPARE: Mapping[str, Callable[[Any, Any], Any]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "=": operator.eq,
    "!=": operator.ne,
}


def admits(condition: Condition, values: FloatArray) -> BoolArray:
    """Tell for each number whether the condition holds; a point without it meets only ``is null``."""
    has_number = np.isfinite(values)
    match condition.operator:
        case "is null":
            return ~has_number
        case "is not null":
            return has_number
        case "in":
            return has_number & np.isin(values, [float(value) for value in condition.values])
    met: BoolArray = has_number & _COMPARE[condition.operator](values, float(condition.values[0]))
    return met


def admits_words(condition: Condition, words: WordArray) -> BoolArray:
    """Tell for each outcome whether the condition holds; every point has one."""
    match condition.operator:
        case "is null" | "is not null":
            return np.full(len(words), condition.operator == "is not null")
        case "in":
            accepted = condition.values
        case _:
            accepted = condition.values[:1]
    found: BoolArray = np.isin(words.astype(np.str_), [str(value) for value in accepted])
    return ~found if condition.operator == "!=" else found


def may_admit(condition: Condition, bounds: tuple[float, float] | None) -> bool:
    """Tell whether the condition may hold for a point of a chunk.

    ``bounds`` are the smallest and the largest number that any of its points has;
    None if none has one.
    """
    if condition.operator == "is null":
        return True
    if bounds is None:
        return False
    low, high = bounds
    match condition.operator:
        case "<" | "<=":
            return bool(admits(condition, np.array([low]))[0])
        case ">" | ">=":
            return bool(admits(condition, np.array([high]))[0])
        case "=" | "in":
            return any(low <= float(value) <= high for value in condition.values)
        case "!=":
            return not low == high == condition.values[0]
    return True


@dataclass(frozen=True, slots=True)
class PointQuery:
    """The points asked for; every condition must hold."""

    conditions: tuple[Condition, ...] = ()
    order: tuple[OrderKey, ...] = ()
    """The columns to sort by; by index if there are none. Points without the number come last either way."""
    limit: int | None = None
    offset: int = 0
    after: tuple[float | None, ...] | None = None
    """The numbers of the order's columns, index included, at the point before the page."""

    @property
    def keys(self) -> tuple[OrderKey, ...]:
        """The columns of the order; the last one is the index."""
        for index, key in enumerate(self.order):
            if key.subject.name == INDEX:
                return self.order[: index + 1]
        return (*self.order, BY_INDEX)

    @property
    def is_by_index(self) -> bool:
        """True if the points come as they are stored."""
        return self.keys == (BY_INDEX,)

    @property
    def is_unconditional(self) -> bool:
        """True if no condition excludes any point."""
        return not self.conditions
