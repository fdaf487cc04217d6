"""A query of a list as it has been read, and the names that lists can be asked by.

These are facts, numbers of the problem by their JSON pointers, and labels. :func:`facts_of` extracts from a
document what has no column in the database. It is written once, when a row is stored, so that a condition
never has to read a number that a document holds as text such as "17/10".
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from enum import StrEnum
from functools import lru_cache
from typing import Literal, get_args
from urllib.parse import quote

from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import exact_number
from service.dynamics.numerics import SolvedBy, Tier
from service.schemas.reading.documents import LABEL_KEY, LABEL_KEYS, Fault, pointer_to
from service.schemas.replies.summary import StateName


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


FamilyName = Literal["expression", "gravity", "rational", "homogeneous", "general"]


_NO_TEXT = re.compile(r"[\x00\ud800-\udfff]")
"""Characters that no database stores."""
MOST_NUMBERS = 64
"""Numbers of a problem that can be asked for, the first ones in the order of the document."""
LONGEST_LIST = 16
"""Numbers in longer lists, such as 100 000 times, cannot be asked for."""
LONGEST_POINTER = 128


@dataclass(frozen=True, slots=True)
class Fact:
    """Something that conditions, orders and columns may name."""

    kind: Kind
    meaning: str
    words: tuple[str, ...] = ()
    """All that a WORD may be."""


def _number(meaning: str) -> Fact:
    return Fact(Kind.NUMBER, meaning)


_FAMILIES: tuple[str, ...] = get_args(FamilyName)
_FAMILY = Fact(Kind.WORD, "the potential's `type`", _FAMILIES)
_STATE = Fact(Kind.WORD, "where it is in its life", get_args(StateName))
_CREATED = Fact(Kind.INSTANT, "when it was stored")
_ATTEMPT = _number("how often a worker has taken the job")

OF_RESULTS: Mapping[str, Fact] = {
    "method": Fact(Kind.WORD, "the method that computed it", tuple(get_args(SolvedBy))),
    "tier": Fact(Kind.WORD, "the tier that computed it", tuple(get_args(Tier))),
    "period": _number("the period"),
    "energy": _number("the energy h"),
    "error": _number("the largest claimed error of any variable"),
    "drift": _number("the largest departure of an integral, if the outputs ask for invariants"),
    "trace": _number("the trace of the stability, μ + 1/μ"),
    "stability.verdict": Fact(Kind.WORD, "of the stability", ("stable", "unstable", "marginal")),
    "aperiodic": Fact(
        Kind.WORD, "why there is no period", ("separatrix", "equilibrium", "collision", "pole")
    ),
}
"""Facts that a solution has, and a job by its solution."""

OF_SOLUTIONS: Mapping[str, Fact] = {
    "id": Fact(Kind.IDENTIFIER, "of the solution"),
    "job": Fact(Kind.IDENTIFIER, "the job that computed it"),
    "digest": Fact(Kind.TEXT, "of the problem, equal for equal problems"),
    "created_at": _CREATED,
    "family": _FAMILY,
    **OF_RESULTS,
    "A": _number("the moment A"),
    "B": _number("the moment B"),
    "C": _number("the moment C"),
    "seconds": _number("seconds of computing"),
    "attempt": _ATTEMPT,
}
OF_JOBS: Mapping[str, Fact] = {
    "id": Fact(Kind.IDENTIFIER, "of the job"),
    "solution": Fact(Kind.IDENTIFIER, "its solution"),
    "digest": Fact(Kind.TEXT, "of the problem, equal for equal problems"),
    "state": _STATE,
    "created_at": _CREATED,
    "started_at": Fact(Kind.INSTANT, "when the last attempt began"),
    "finished_at": Fact(Kind.INSTANT, "when it came to its final state"),
    "seconds": _number("seconds from the start of the last attempt to the end"),
    "attempt": _ATTEMPT,
    "priority": _number("larger first"),
    "reused": Fact(Kind.TRUTH, "whether its solution was computed for an earlier job"),
    "error.code": Fact(Kind.TEXT, "why it failed"),
    "family": _FAMILY,
    **OF_RESULTS,
}
OF_SWEEPS: Mapping[str, Fact] = {
    "id": Fact(Kind.IDENTIFIER, "of the sweep"),
    "state": _STATE,
    "created_at": _CREATED,
    "started_at": Fact(Kind.INSTANT, "when a worker took its first points"),
    "finished_at": Fact(Kind.INSTANT, "when it came to its final state"),
    "seconds": _number("seconds from the start to the end"),
    "points": _number("how many there are"),
    "done": _number("how many are stored"),
    "refused": _number("how many have no solution"),
    "priority": _number("larger first"),
    "family": _FAMILY,
}


def facts_of(problem: Mapping[str, object]) -> dict[str, float | str]:
    """Return the family and the numbers of a problem document, as doubles, by :func:`stored_name`."""
    found: dict[str, float | str] = {}
    potential = problem.get("potential")
    family = potential.get("type") if isinstance(potential, Mapping) else None
    if isinstance(family, str) and family in _FAMILIES:
        found["family"] = family
    for path, number in _numbers(problem, ()):
        if len(found) > MOST_NUMBERS:
            break
        name = _name_at(path)
        if name is not None:
            found[name] = number
    return found


@lru_cache(maxsize=1024)  # most problems have their numbers at the same places
def _name_at(path: tuple[str | int, ...]) -> str | None:
    """Return under which name the number at that place is stored; None if it is not."""
    pointer = pointer_to(path)
    return None if len(pointer) > LONGEST_POINTER or _NO_TEXT.search(pointer) else stored_name(pointer)


def stored_name(pointer: str) -> str:
    """Return a JSON pointer as in a URI (RFC 6901, 6): SQLite finds no name that JSON has to escape."""
    return quote(pointer, safe="/~")


def _numbers(value: object, path: tuple[str | int, ...]) -> Iterator[tuple[tuple[str | int, ...], float]]:
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _numbers(part, (*path, str(name)))
    elif isinstance(value, list | tuple):
        if len(value) <= LONGEST_LIST:
            for index, part in enumerate(value):
                yield from _numbers(part, (*path, index))
    elif isinstance(value, int | float | str) and not isinstance(value, bool):
        number = nearest_double(value)
        if number is not None:
            yield path, number


def nearest_double(value: int | float | str) -> float | None:
    """Return the double nearest to a number of a document, None for other texts."""
    # Most texts of a problem are words: their first character tells, without an exception.
    if isinstance(value, str) and not value.lstrip()[:1].isdigit() and value.lstrip()[:1] not in "+-.":
        return None
    try:
        number = float(exact_number(value))
    except (InvalidNumberError, OverflowError):
        return None
    return number if math.isfinite(number) else None


LABEL = "label."
_NAME = re.compile(r"[A-Za-z_][A-Za-z_0-9]{0,60}\Z", re.ASCII)
_PLACES: Mapping[str, str] = {
    **{name: f"/motion/{name}" for name in ("lambda", "nu")},
    **{name: f"/body/{name}" for name in "ABC"},
}
"""Names that have one place in every problem."""
_POINTER = re.compile(r"/[^\x00\ud800-\udfff]+\Z")


@dataclass(frozen=True, slots=True)
class Vocabulary:
    """The names that queries of one list may use."""

    facts: Mapping[str, Fact]
    has_pointers: bool = False
    """Any JSON pointer into the problem, beside the facts."""
    has_labels: bool = False
    stored: Callable[[Sequence[str]], Sequence[str]] | None = None
    """Returns which of some pointers there are in rows; None where nobody looks."""

    def pointers_of(self, name: str) -> tuple[str, ...]:
        """Return the pointers that a name of people may stand for, such as /motion/lambda for lambda.

        It is the last part of the pointer, in the problem that of a parameter or of a coefficient.
        """
        if not self.has_pointers:
            return tuple(each for each in self.facts if each[:1] == "/" and each.rpartition("/")[2] == name)
        if name in _PLACES:
            return (_PLACES[name],)
        if self.stored is None or not _NAME.match(name):
            return ()
        return tuple(self.stored((f"/potential/parameters/{name}", f"/potential/{name}")))

    def accepted(self) -> str:
        """Return the phrase that names what is accepted."""
        names = list(self.facts)
        if self.has_pointers:
            names.append("pointers to numbers of the problem such as /motion/lambda, or their last names")
        if self.has_labels:
            names.append("label.KEY")
        return f"accepted are {', '.join(names)}"

    def subject(self, parameter: str, name: str, part: Excerpt) -> Subject:
        """Return what ``name`` stands for; raises :class:`QueryError` at ``part``."""
        fact = self.facts.get(name)
        if fact is not None:
            return Subject("fact", name, fact.kind)
        if self.has_pointers and name.startswith("/"):
            if len(name) > LONGEST_POINTER or not _POINTER.match(name):
                message = f"{name[:60]!r} is no JSON pointer of at most {LONGEST_POINTER} characters"
                raise QueryError(
                    parameter, "invalid_pointer", f"{message} such as /motion/lambda", part.start
                )
            return Subject("pointer", name, Kind.NUMBER)
        if self.has_labels and name.startswith(LABEL):
            key = name.removeprefix(LABEL)
            if not LABEL_KEY.match(key):
                message = f"{key[:60]!r} is no key of a label; accepted are {LABEL_KEYS}"
                raise QueryError(parameter, "invalid_label", message, part.start)
            return Subject("label", key, Kind.TEXT)
        if (meant := self._by_name(parameter, name, part)) is not None:
            return meant
        near = get_close_matches(name[:60], self.facts, n=1)
        guess = f"did you mean {near[0]!r}? " if near else ""
        message = f"there is no column {name[:60]!r} here; {guess}{self.accepted()}"
        raise QueryError(parameter, "unknown_column", message, part.start)

    def _by_name(self, parameter: str, name: str, part: Excerpt) -> Subject | None:
        """Return the subject that a name of people stands for; None if there is none."""
        found = self.pointers_of(name)
        if len(found) > 1:
            message = f"{name!r} may be {' or '.join(found)}; one of these is accepted"
            raise QueryError(parameter, "ambiguous_name", message, part.start)
        if not found:
            return None
        if self.has_pointers:
            return Subject("pointer", found[0], Kind.NUMBER)
        return Subject("fact", found[0], self.facts[found[0]].kind)
