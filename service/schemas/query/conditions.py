"""A query that has been read: subjects, conditions and orders."""

from dataclasses import dataclass
from typing import Literal

from service.schemas.query.kinds import Kind

Operator = Literal["=", "!=", "<", "<=", ">", ">=", "in", "is null", "is not null"]
Value = float | str | bool
"""An instant is its seconds since 1970."""


@dataclass(frozen=True, slots=True)
class Subject:
    """The subject of a condition: a fact, a number of the problem, or a label."""

    place: Literal["fact", "pointer", "label"]
    name: str
    """Name of the fact, the pointer, or the label's key."""
    kind: Kind

    @property
    def text(self) -> str:
        """As it is written in a query."""
        return f"label.{self.name}" if self.place == "label" else self.name


@dataclass(frozen=True, slots=True)
class Condition:
    """One condition; what has no value meets only ``is null``, and ``!=`` not either."""

    subject: Subject
    operator: Operator
    values: tuple[Value, ...] = ()
    """One to compare with; of ``in`` at least one; of ``is null`` none."""


@dataclass(frozen=True, slots=True)
class OrderKey:
    """One column of an order; rows without a value come last in either direction."""

    subject: Subject
    descending: bool = False
