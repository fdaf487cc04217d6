"""A query of a list as it has been read, and the pieces of text that it is read from."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from service.schemas.reading.documents import Fault


class Kind(StrEnum):
    """The kinds of values of facts, which decide what they may be compared with."""

    NUMBER = "number"
    INSTANT = "instant"
    WORD = "word"
    """One of a closed list."""
    TEXT = "text"
    IDENTIFIER = "id"
    TRUTH = "truth"

    @property
    def has_order(self) -> bool:
        """Whether < and > mean something."""
        return self in (Kind.NUMBER, Kind.INSTANT)


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


ID = Subject("fact", "id", Kind.IDENTIFIER)


@dataclass(frozen=True, slots=True)
class ListQuery:
    """The rows asked for; every condition must hold."""

    conditions: tuple[Condition, ...] = ()
    order: tuple[OrderKey, ...] = (OrderKey(ID, descending=True),)
    """The id is added as the last column, in the direction of the one before."""
    columns: tuple[Subject, ...] = ()
    """Values that are wanted beside the ids."""
    limit: int = 50
    offset: int = 0
    after: tuple[Value | None, ...] | None = None
    """The values of the order's columns, id included, in the row before the page."""
    is_counted: bool = True
    """Whether the number of all such rows is wanted."""
    count_limit: int | None = None
    """It is wanted only if it is at most so large."""
    is_estimated: bool = False
    """Whether it is only asked what of it takes long."""

    @property
    def keys(self) -> tuple[OrderKey, ...]:
        """The columns of the order; the last one is the id."""
        for place, key in enumerate(self.order):
            if key.subject == ID:
                return self.order[: place + 1]
        return (*self.order, OrderKey(ID, self.order[-1].descending))


def equals(name: str, kind: Kind, value: Value | None) -> tuple[Condition, ...]:
    """Return the condition that a fact has a value; none if the value is None."""
    return () if value is None else (Condition(Subject("fact", name, kind), "=", (value,)),)


def in_state(state: str | None) -> tuple[Condition, ...]:
    """Return the condition for a state; none for any state."""
    return equals("state", Kind.WORD, state)


QUOTE = '"'


@dataclass(frozen=True, slots=True)
class Excerpt:
    """Some of the text of a parameter."""

    text: str
    start: int
    """Its first character in the parameter, from 0."""

    def stripped(self) -> "Excerpt":
        """Return the part without spaces around it."""
        left = self.text.lstrip()
        return Excerpt(left.rstrip(), self.start + len(self.text) - len(left))

    def after(self, count: int) -> "Excerpt":
        """Return what follows the first ``count`` characters, without spaces around it."""
        return Excerpt(self.text[count:], self.start + count).stripped()


class QueryError(Exception):
    """A fault of a query."""

    def __init__(self, parameter: str, code: str, message: str, position: int) -> None:
        super().__init__(message)
        self.fault = Fault(f"?{parameter}", code, f"at character {position + 1}: {message}", position)


def split(part: Excerpt) -> Iterator[Excerpt]:
    """Yield the parts between commas that are in no quotation and no parenthesis."""
    depth, is_quoted, begin = 0, False, 0
    for place, character in enumerate(part.text):
        if character == QUOTE:
            is_quoted = not is_quoted
        elif is_quoted:
            continue
        elif character == "(":
            depth += 1
        elif character == ")":
            depth = max(0, depth - 1)
        elif character == "," and not depth:
            yield Excerpt(part.text[begin:place], part.start + begin).stripped()
            begin = place + 1
    yield Excerpt(part.text[begin:], part.start + begin).stripped()


def unquoted(part: Excerpt) -> tuple[str, bool]:
    """Return a text without the quotation marks around it, and whether there were any; raises ValueError.

    Inside them a doubled mark stands for one, as in CSV.
    """
    if not part.text.startswith(QUOTE):
        if QUOTE in part.text:
            raise ValueError
        return part.text, False
    inside = part.text[1:-1]
    if len(part.text) < 2 or not part.text.endswith(QUOTE) or QUOTE in inside.replace(2 * QUOTE, ""):
        raise ValueError
    return inside.replace(2 * QUOTE, QUOTE), True
