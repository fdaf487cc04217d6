"""Reads what studies are asked: about integrals, potentials, and numbers that give what one wants.

A study is stored with ``what`` in its document, which names the kind of question.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BaseModel, Field, PlainValidator, WithJsonSchema

from service.dynamics.errors import DynamicsError, FormulaError, InvalidNumberError
from service.dynamics.exact import exact_number
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import Tree
from service.dynamics.problem import PlanarMotion, Problem
from service.schemas.atlas.documents import LARGEST, SMALLEST
from service.schemas.problem.problem import each_once, read_problem
from service.schemas.problem.trusted import trusted_problem
from service.schemas.reading.documents import (
    Document,
    Fault,
    InvalidProblemError,
    NoSuchPlaceError,
    Part,
    split_pointer,
    value_at,
    with_values,
)
from service.schemas.reading.numbers import Exact, refuse
from service.schemas.reading.parts import WireModel, read_parts
from service.schemas.study.lettered import IntegralIn, IntegralSearchIn, PotentialSearchIn, RatioIn

What = Literal["integral", "integrals", "potentials", "numbers"]
WHATS: tuple[What, ...] = get_args(What)
Wanted = Literal["period", "energy", "trace", "precession.psi1", "precession.psi3"]
MOST_UNKNOWNS = 2
_TIME: Document = {"periods": 1, "samples": 2}
"""The times of a base that has none: a search asks for no samples."""
_OUTPUTS: Mapping[Wanted, str] = {
    "trace": "stability",
    "precession.psi1": "orientation",
    "precession.psi3": "orientation",
}
"""Outputs of a problem that what is wanted belongs to."""


def _read_equals(value: object) -> str:
    """Return a formula without variables; a number is written as an exact ratio."""
    if isinstance(value, bool) or not isinstance(value, int | float | str | Fraction):
        raise refuse(
            "invalid_type", 'a number, or a formula without variables such as "2*pi*3/7", is expected'
        )
    try:
        return str(exact_number(value))
    except InvalidNumberError:
        text = str(value)
    try:
        tape = compile_tape(constant_tree(text), ())
    except FormulaError as error:
        raise refuse(error.code, error.message) from error
    if not tape.evaluate(BallAlgebra(), ()).is_finite():
        raise refuse("out_of_range", "a formula with a finite value is expected")
    return text


def constant_tree(text: str) -> Tree:
    """Return the tree of a formula without variables; raises FormulaError."""
    return bind(parse(text), {}, variables=())


Equals = Annotated[
    str,
    PlainValidator(_read_equals),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "examples": ["7", "2*pi*3/7"]}]}),
]


def _forward(ends: list[Fraction]) -> list[Fraction]:
    if not ends[0] < ends[1]:
        raise refuse("out_of_range", "the second number must be larger than the first", below="1")
    return ends


class UnknownIn(WireModel):
    """A number of the problem that is looked for."""

    pointer: str = Field(
        description="JSON pointer to it, such as /motion/lambda or /potential/parameters/a.", max_length=200
    )
    interval: Annotated[list[Exact], Field(min_length=2, max_length=2), AfterValidator(_forward)] = Field(
        description="Smallest and largest value.", examples=[["1/2", 2]]
    )


class WantedIn(WireModel):
    """A number of the motion that is to have a value."""

    of: Wanted = Field(
        description="`period` of all six variables, `energy`, `trace` of the transverse multipliers (2 and -2"
        " are changes of stability), precession in a period in radians."
    )
    equals: Equals = Field(description="A number, or a formula without variables.")


class SearchIn(WireModel):
    """A problem, one or two of its numbers, and what these shall give: what ``POST /v1/searches`` takes."""

    base: dict[str, object] = Field(
        description="A problem with a planar motion; the numbers at the pointers are replaced, and may be"
        " left out. Without times it has one period."
    )
    unknowns: Annotated[list[UnknownIn], Field(min_length=1, max_length=MOST_UNKNOWNS)] = Field(
        description="The numbers that are looked for."
    )
    wanted: Annotated[list[WantedIn], Field(min_length=1, max_length=MOST_UNKNOWNS)] = Field(
        description="As many conditions as there are unknowns."
    )


@dataclass(frozen=True, slots=True)
class Unknown:
    """A number that is looked for."""

    path: tuple[str, ...]
    pointer: str
    lower: Fraction
    upper: Fraction

    @property
    def middle(self) -> Fraction:
        """The middle of the interval."""
        return (self.lower + self.upper) / 2


@dataclass(frozen=True, slots=True)
class WantedNumber:
    """A number of the motion, and its value to be."""

    of: Wanted
    equals: Tree


@dataclass(frozen=True, slots=True)
class Search:
    """A valid search."""

    base: Document
    unknowns: tuple[Unknown, ...]
    wanted: tuple[WantedNumber, ...]

    def document_at(self, values: Sequence[Fraction]) -> Document:
        """Return the problem document with these numbers in place of the unknowns."""
        return with_values(
            self.base, {each.path: str(value) for each, value in zip(self.unknowns, values, strict=True)}
        )

    def problem_at(self, values: Sequence[Fraction]) -> Problem:
        """Return the problem with these numbers; raises what its constructors raise."""
        return trusted_problem(self.document_at(values))


def read_search(document: object) -> Search:
    """Return the search that a document states.

    Raises
    ------
    InvalidProblemError
        Lists every fault.
    """
    parts, faults = read_parts(document, SearchIn, {})
    unknowns, wanted, base = (parts.get(name) for name in ("unknowns", "wanted", "base"))
    if isinstance(unknowns, list) and isinstance(wanted, list) and len(unknowns) != len(wanted):
        message = f"{len(wanted)} conditions for {len(unknowns)} unknowns; accepted are equally many"
        faults.append(Fault("/wanted", "unequal_lengths", message))
    if isinstance(unknowns, list) and isinstance(base, dict):
        search = _search(base, unknowns, wanted if isinstance(wanted, list) else [])
        faults += _pointer_faults(search)
        if not faults:
            faults += _base_faults(search)
        if not faults:
            return search
    raise InvalidProblemError(each_once(faults))


def trusted_search(document: Part) -> Search:
    """Return what a valid document asks."""
    asked = SearchIn.model_validate({name: document[name] for name in SearchIn.model_fields})
    return _search(asked.base, asked.unknowns, asked.wanted)


def _search(base: Document, unknowns: Sequence[UnknownIn], wanted: Sequence[WantedIn]) -> Search:
    found = []
    for each in unknowns:
        try:
            path = split_pointer(each.pointer)
        except NoSuchPlaceError:
            path = ()
        found.append(Unknown(path, each.pointer, *each.interval))
    outputs = [_OUTPUTS[each.of] for each in wanted if each.of in _OUTPUTS]
    whole = {"time": _TIME, **base, "outputs": list(dict.fromkeys(["period", *outputs]))}
    for unknown in found:
        whole = _with_place(whole, unknown.path)
    conditions = tuple(WantedNumber(each.of, constant_tree(each.equals)) for each in wanted)
    return Search(whole, tuple(found), conditions)


def _with_place(document: Document, path: Sequence[str]) -> Document:
    """Return a document that has a number at the path, if the object is there that is to hold it."""
    try:
        holder = value_at(document, path[:-1])
    except NoSuchPlaceError:
        return document
    if not path or not isinstance(holder, dict) or path[-1] in holder:
        return document
    return with_values(document, {tuple(path[:-1]): {**holder, path[-1]: 1}})


def _pointer_faults(search: Search) -> Iterator[Fault]:
    seen = set[tuple[str, ...]]()
    for place, each in enumerate(search.unknowns):
        where = f"/unknowns/{place}/pointer"
        try:
            split_pointer(each.pointer)
            found = value_at(search.base, each.path)
        except NoSuchPlaceError as error:
            yield Fault(where, "unknown_pointer", f"{error}; accepted is a pointer to a number of the base")
            continue
        if isinstance(found, bool | dict | list) or found is None:
            yield Fault(where, "not_a_number", "there is no number; accepted is a pointer to a number")
        elif each.path[0] not in ("body", "potential", "motion"):
            accepted = "accepted are numbers of the body, the potential and the motion"
            yield Fault(where, "unknown_pointer", f"{each.pointer[:40]} changes no motion; {accepted}")
        elif each.path in seen:
            yield Fault(where, "pointer_taken", "another unknown has this pointer; accepted are two numbers")
        seen.add(each.path)


def _base_faults(search: Search) -> Iterator[Fault]:
    """Yield what is wrong with the problem at the middle and at the ends of the intervals."""
    middle = [each.middle for each in search.unknowns]
    try:
        problem = read_problem(search.document_at(middle))
    except InvalidProblemError as error:
        yield from (replace(fault, pointer=f"/base{fault.pointer}") for fault in error.faults)
        return
    if not isinstance(problem.motion, PlanarMotion):
        message = "accepted is a planar motion"
        yield Fault("/base/motion/type", "search_needs_planar_motion", message)
        return
    for place, each in enumerate(search.unknowns):
        for end, value in enumerate((each.lower, each.upper)):
            try:
                read_problem(search.document_at([*middle[:place], value, *middle[place + 1 :]]))
            except InvalidProblemError as error:
                fault = error.faults[0]
                yield Fault(f"/unknowns/{place}/interval/{end}", fault.code, fault.message)
            else:
                if each.path == ("motion", "lambda") and not SMALLEST <= value <= LARGEST:
                    message = f"{float(value):g}; accepted are 1e-9 to 1e9"
                    yield Fault(f"/unknowns/{place}/interval/{end}", "out_of_range", message)


def _reader(model: type[BaseModel]) -> Callable[[object], object]:
    """Return the function that reads a document by its model alone."""

    def read(document: object) -> object:
        parts, faults = read_parts(document, model, {})
        body = parts.get("body")
        if isinstance(body, RatioIn) and body.A == body.C:
            faults.append(Fault("/body", "equal_moments", "A = C: accepted are A ≠ C"))
        if faults:
            raise InvalidProblemError(each_once(faults))
        return parts

    return read


MODELS: Mapping[What, type[BaseModel]] = {
    "integral": IntegralIn,
    "integrals": IntegralSearchIn,
    "potentials": PotentialSearchIn,
    "numbers": SearchIn,
}
"""The documents of questions, without ``what``."""
_READERS: Mapping[What, Callable[[object], object]] = {
    what: read_search if what == "numbers" else _reader(model) for what, model in MODELS.items()
}


def read_study(document: object) -> object:
    """Check a document with ``what``: that of a file, or of a job.

    Raises
    ------
    InvalidProblemError
        Lists every fault.
    """
    for what in WHATS:
        match document:
            case {"what": name, **rest} if name == what:
                return read_question(what, rest)
    message = f'an object with "what" is expected; accepted are {", ".join(WHATS)}'
    raise InvalidProblemError([Fault("/what", "invalid_value", message)])


def read_question(what: What, document: object) -> object:
    """Check what is asked; raises as :func:`read_study`."""
    try:
        return _READERS[what](document)
    except DynamicsError as error:
        raise InvalidProblemError([Fault(error.pointer, error.code, error.message)]) from error
