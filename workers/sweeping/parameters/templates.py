"""Programs that points of a sweep share: one structure, whose constants and exponents are data.

What a formula compiles to depends on the numbers in it by their signs, by which of them are 0, 1 or -1, and
by which are equal. Points that agree in that share a template: it is compiled at numbers that are like
theirs, twice, and tells for each constant of the program which number of the potential it is, or how many
times that number.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import as_fmpq, as_fraction
from service.dynamics.formula.tape import Tape, with_inputs
from service.dynamics.formula.tree import MAX_EXPONENT
from service.dynamics.potentials.potential import Potential
from workers.solvers.compiled.evaluation.program import (
    Program,
    has_number,
    make_program,
    numbers_of,
    rest_of,
    rests_of,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Key = tuple[object, ...]

MOMENTS = ("A", "B", "C")
SHORTENING = 0.0, 1.0, -1.0
"""Numbers that shorten a formula."""
MOST_TEMPLATES = 64
"""Structures of a potential that one sweep has templates for; other points have one each."""


class MomentsOfPoint(NamedTuple):
    """The moments of a body, exactly."""

    A: fmpq
    B: fmpq | None
    C: fmpq

    @classmethod
    def of(cls, body: RigidBody) -> "MomentsOfPoint":
        """Return those of a body."""
        return cls(as_fmpq(body.A), None if body.B is None else as_fmpq(body.B), as_fmpq(body.C))

    def body(self) -> RigidBody:
        """Return the body; whether there is one is known already."""
        B = None if self.B is None else as_fraction(self.B)
        return RigidBody(as_fraction(self.A), B, as_fraction(self.C), allow_unphysical=True)


class Model(Protocol):
    """A potential with numbers that follow from those on the axes."""

    @property
    def order(self) -> Sequence[int] | None:
        """The indices on the axes of the values, where they are nothing but numbers on axes."""

    def values(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> list[fmpq] | None:
        """Return the numbers in the potential at those on its axes; None: left to single jobs."""

    def key(self, values: Sequence[fmpq]) -> Key:
        """Return what the structure of the potential depends on."""

    def probes(
        self, moments: MomentsOfPoint, numbers: Sequence[fmpq]
    ) -> list[tuple[list[fmpq], Tape]] | None:
        """Return two sets of other values of the same key, and the tape of each; None: there are none."""

    def potential(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> Potential:
        """Return the potential at a point itself; raises what its family raises."""


@dataclass(frozen=True, slots=True)
class Template:
    """A program and where its numbers come from."""

    program: Program
    tape: Tape
    """The tape of one point."""
    constants: FloatArray
    """Constants of the program; those that vary are replaced."""
    fixed: tuple[fmpq | None, ...]
    """The same exactly, None for π."""
    varying: Mapping[int, tuple[int, fmpq]]
    """The others by their indices: which value, and how many times."""
    rests: FloatArray
    """Rests that the constants leave out."""
    exponents: Mapping[int, int]
    """The base of each exponent, by the index of the exponent: two of one base would be one instruction."""
    distinct: tuple[int, int]
    """How many different constants, and exponents, there are."""
    is_shared: bool
    """Whether it is that of all points of a key, and not of one alone."""

    def numbers(self, values: Sequence[fmpq]) -> list[fmpq | None]:
        """Return the numbers of the tape at a point, None for π."""
        constants = list(self.fixed)
        for slot, (index, factor) in self.varying.items():
            constants[slot] = factor * values[index]
        return constants

    def row(self, numbers: Sequence[fmpq | None]) -> list[float]:
        """Return the constants of the program at a point, each rounded once."""
        row: list[float] = self.constants.tolist()
        for slot in self.varying:
            number = numbers[slot]
            assert number is not None
            row[slot] = double_of(number)
        return row

    def rows(self, values: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the constants at doubles of the values, shape (points, values), and which are surely right.

        No value is one of ``SHORTENING``. None is right where a constant is another multiple of a value
        than ±1, whose double is not known.
        """
        rows = np.repeat(self.constants[None, :], len(values), axis=0)
        for slot, (index, factor) in self.varying.items():
            rows[:, slot] = float(factor) * values[:, index]
        plain = all(abs(factor) == 1 and k not in self.exponents for k, (_, factor) in self.varying.items())
        known = np.sort(np.delete(rows, list(self.exponents), axis=1), axis=1)
        distinct = (np.diff(known, axis=1, prepend=np.nan) != 0.0).sum(axis=1)
        return rows, plain & np.isfinite(known).all(axis=1) & (distinct == self.distinct[0])

    def is_of(self, row: Sequence[float]) -> bool:
        """Tell whether numbers that differ at the probes differ here too, and none shortens the formula."""
        return (
            self.distinct == _distinct(row, self.exponents)
            and all(abs(row[slot]) <= MAX_EXPONENT for slot in self.exponents)
            and all(abs(factor) == 1 or abs(row[slot]) != 1.0 for slot, (_, factor) in self.varying.items())
            and all(math.isfinite(row[slot]) for slot in self.varying)
        )


class Constants(NamedTuple):
    """The constants of a point."""

    template: Template
    exact: list[fmpq | None]
    """As ratios, None for π."""
    row: list[float]
    """Each rounded once."""


class Templates:
    """The templates of a potential, made when a point asks for one."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self._shared: dict[Key, Template | None] = {}

    def at(
        self, moments: MomentsOfPoint, numbers: Sequence[fmpq], values: Sequence[fmpq]
    ) -> Constants | None:
        """Return the constants of the point with these numbers; None where its formula cannot be compiled.

        ``values`` are what the model makes of the numbers.
        """
        shared = self.shared(moments, numbers, values)
        if shared is not None:
            return shared
        try:
            own = _template(self.model.potential(moments, numbers).tape, {}, is_shared=False)
        except (DynamicsError, ValueError):
            return None
        return Constants(own, list(own.fixed), own.constants.tolist())

    def shared(
        self, moments: MomentsOfPoint, numbers: Sequence[fmpq], values: Sequence[fmpq]
    ) -> Constants | None:
        """Return the constants of the point by the template of all like it; None if they share none."""
        key = self.model.key(values)
        if key not in self._shared and len(self._shared) < MOST_TEMPLATES:
            self._shared[key] = self._new(moments, numbers)
        template = self._shared.get(key)
        if template is None:
            return None
        exact = template.numbers(values)
        row = template.row(exact)
        return Constants(template, exact, row) if template.is_of(row) else None

    def _new(self, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> Template | None:
        """Return the template of all points like this one; None if it is not found."""
        try:
            probes = self.model.probes(moments, numbers)
        except (DynamicsError, ValueError):
            return None
        if probes is None:
            return None
        (values, tape), (others, other) = probes
        if make_program(other)[0].key != make_program(tape)[0].key:
            return None
        varying: dict[int, tuple[int, fmpq]] = {}
        for slot, (number, seen) in enumerate(zip(numbers_of(tape), numbers_of(other), strict=True)):
            if number is None or seen is None or number == seen:
                continue
            source = _source(as_fmpq(number), as_fmpq(seen), values, others)
            if source is None:
                return None
            varying[slot] = source
        return _template(tape, varying, is_shared=True)


def kind_of(value: fmpq) -> object:
    """Return what the structure of a formula depends on in one of its numbers."""
    return int(value.p) if value.q == 1 and abs(value) <= 1 else 2 if value > 0 else -2


def _template(tape: Tape, varying: Mapping[int, tuple[int, fmpq]], *, is_shared: bool) -> Template:
    """Return the template of a tape whose other numbers are fixed."""
    program, constants = make_program(tape)
    fixed = tuple(None if number is None else as_fmpq(number) for number in numbers_of(tape))
    numbered = [at for at in tape.instructions if has_number(at)]
    exponents = {slot: at.left for slot, at in enumerate(numbered) if at.operation == "power"}
    distinct = _distinct(constants.tolist(), exponents)
    rests = rests_of(tape, constants)
    return Template(program, tape, constants, fixed, varying, rests, exponents, distinct, is_shared)


def _distinct(row: Sequence[float], exponents: Mapping[int, int]) -> tuple[int, int]:
    powers = {(base, row[slot]) for slot, base in exponents.items()}
    if len(exponents) == len(row):
        return 0, len(powers)
    return len({number for slot, number in enumerate(row) if slot not in exponents}), len(powers)


def _source(
    number: fmpq, seen: fmpq, values: Sequence[fmpq], others: Sequence[fmpq]
) -> tuple[int, fmpq] | None:
    """Return which value a number is at both probes, and how many times; once or −1 times if it can be."""
    found: tuple[int, fmpq] | None = None
    for index, (value, other) in enumerate(zip(values, others, strict=True)):
        if value and other and number / value == seen / other:
            factor = number / value
            if abs(factor) == 1:
                return index, factor
            found = found or (index, factor)
    return found


@dataclass(frozen=True, slots=True)
class Group:
    """Points that share a program."""

    template: Template
    rows: FloatArray
    """The constants of each, the doubles nearest to them, shape (points, constants)."""
    indices: IntArray
    """Indices of the points in their block."""
    rests: FloatArray | None = None
    """Low parts that the rows leave out of the constants; None where nobody asked for them."""

    @property
    def program(self) -> Program:
        """The program."""
        return self.template.program

    def part(self, members: BoolArray) -> "Group":
        """Return those of the points that are ``members``, shape (points,)."""
        rests = None if self.rests is None else self.rests[members]
        return replace(self, rows=self.rows[members], indices=self.indices[members], rests=rests)

    def tape_of_all(self) -> Tape:
        """Return the tape that has the varying constants as further variables."""
        tape = self.template.tape
        numbered = [index for index, at in enumerate(tape.instructions) if has_number(at)]
        return with_inputs(tape, [numbered[slot] for slot in self.template.varying])

    def inputs(self) -> tuple[FloatArray, ...]:
        """Return those variables, each of shape (points,)."""
        return tuple(self.rows[:, slot] for slot in self.template.varying)


def grouped(constants: Mapping[int, Constants], *, has_rests: bool = False) -> list[Group]:
    """Return points by their templates; their constants are told by their indices."""
    members: dict[int, list[int]] = {}
    for index, each in constants.items():
        members.setdefault(id(each.template), []).append(index)
    groups = list[Group]()
    for indices in members.values():
        known = [constants[index] for index in indices]
        rows = np.array([each.row for each in known]).reshape(len(known), -1)
        rests = np.array([_rests(each) for each in known]).reshape(rows.shape) if has_rests else None
        groups.append(Group(known[0].template, rows, np.array(indices, dtype=np.int64), rests))
    return groups


def _rests(constants: Constants) -> FloatArray:
    """Return what the doubles of a point's constants leave out."""
    rests = constants.template.rests.copy()
    for slot in constants.template.varying:
        number = constants.exact[slot]
        rests[slot] = rest_of(None if number is None else as_fraction(number), constants.row[slot])
    return rests


def double_of(value: fmpq) -> float:
    """Return the double that is nearest to a ratio, NaN where it is too large."""
    try:
        return int(value.p) / int(value.q)
    except OverflowError:
        return math.nan
