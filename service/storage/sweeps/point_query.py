"""The query for points of a sweep: conditions, sort order, and how they are evaluated."""

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

INDEX, OUTCOME = "index", "outcome"
"""Columns that every sweep has, beside its axes and its kept numbers."""

Operator = Literal["<", "<=", ">", ">=", "="]
_COMPARE: Mapping[Operator, Callable[[FloatArray, float], BoolArray]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "=": operator.eq,
}


@dataclass(frozen=True, slots=True)
class Condition:
    """A column compared with a number; a point without a number in it never matches."""

    column: str
    operator: Operator
    number: float

    def admits(self, values: FloatArray) -> BoolArray:
        """Tell for each of the values whether the condition holds."""
        return np.isfinite(values) & _COMPARE[self.operator](values, self.number)

    def may_admit(self, low: float, high: float) -> bool:
        """Tell whether the condition may hold for any value between ``low`` and ``high``."""
        match self.operator:
            case "<" | "<=":
                return bool(self.admits(np.array([low]))[0])
            case ">" | ">=":
                return bool(self.admits(np.array([high]))[0])
        return low <= self.number <= high


@dataclass(frozen=True, slots=True)
class PointQuery:
    """The points asked for; every condition must hold."""

    conditions: tuple[Condition, ...] = ()
    outcomes: tuple[str, ...] = ()
    """Accepted outcomes of a point."""
    order: str | None = None
    """The column to sort by; by index if None. Points without the number come last either way."""
    descending: bool = False
    limit: int | None = None
    offset: int = 0

    @property
    def is_unconditional(self) -> bool:
        """True if no condition excludes any point."""
        return not self.conditions and not self.outcomes
