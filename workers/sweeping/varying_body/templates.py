"""Potentials whose moments or exponents vary, as one program whose constants and exponents are data.

What a formula compiles to depends on the numbers in it by their signs, by which of them are 0, 1 or -1, and
by which are equal. Points that agree in that share a template: it is compiled at numbers that are like
theirs, twice, and tells for each constant of the program which number of the potential it is.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import as_fmpq, as_fraction
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.tree import MAX_EXPONENT
from service.dynamics.potentials.potential import Potential
from workers.solvers.compiled.evaluation.program import Program, make_program, numbers_of
from workers.sweeping.parameters.programs import nearest_double

FloatArray = NDArray[np.float64]
Key = tuple[object, ...]
MOMENTS = ("A", "B", "C")
MOST_TEMPLATES = 64
"""Structures of a potential that one sweep has templates for; other points are left to single jobs."""


class MomentsOfPoint(NamedTuple):
    """The moments of a body, exactly."""

    A: fmpq
    B: fmpq | None
    C: fmpq

    def body(self) -> RigidBody:
        """Return the body; whether there is one is known already."""
        B = None if self.B is None else as_fraction(self.B)
        return RigidBody(as_fraction(self.A), B, as_fraction(self.C), allow_unphysical=True)


class Model(Protocol):
    """A potential with numbers that follow from those on the axes."""

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
    varying: Mapping[int, tuple[int, int]]
    """The others by their indices: which value, and its sign."""
    exponents: Mapping[int, int]
    """The base of each exponent, by the index of the exponent: two of one base would be one instruction."""
    distinct: tuple[int, int]
    """How many different constants, and exponents, there are."""

    def numbers(self, values: Sequence[fmpq]) -> list[fmpq | None]:
        """Return the numbers of the tape at a point, None for π."""
        constants = list(self.fixed)
        for slot, (index, sign) in self.varying.items():
            constants[slot] = values[index] if sign > 0 else -values[index]
        return constants

    def row(self, numbers: Sequence[fmpq | None]) -> list[float]:
        """Return the constants of the program at a point, each rounded once."""
        row: list[float] = self.constants.tolist()
        for slot in self.varying:
            number = numbers[slot]
            assert number is not None
            row[slot] = nearest_double(int(number.p), int(number.q))
        return row

    def is_of(self, row: Sequence[float]) -> bool:
        """Tell whether numbers that differ at the probes differ here too."""
        return self.distinct == _distinct(row, self.exponents) and all(
            abs(row[slot]) <= MAX_EXPONENT for slot in self.exponents
        )


def shared_template(model: Model, moments: MomentsOfPoint, numbers: Sequence[fmpq]) -> Template | None:
    """Return the template of all points like this one; None if it is not found."""
    try:
        probes = model.probes(moments, numbers)
    except (DynamicsError, ValueError):
        return None
    if probes is None:
        return None
    (values, tape), (others, other) = probes
    program, constants = make_program(tape)
    if make_program(other)[0].key != program.key:
        return None
    varying: dict[int, tuple[int, int]] = {}
    fixed = [None if number is None else as_fmpq(number) for number in numbers_of(tape)]
    for slot, (number, seen) in enumerate(zip(fixed, numbers_of(other), strict=True)):
        if number is None or seen is None or number == as_fmpq(seen):
            continue
        source = _source(number, as_fmpq(seen), values, others)
        if source is None:
            return None
        varying[slot] = source
    return _template(program, tape, constants, fixed, varying)


def own_template(tape: Tape) -> Template:
    """Return the template of one point."""
    program, constants = make_program(tape)
    fixed = [None if number is None else as_fmpq(number) for number in numbers_of(tape)]
    return _template(program, tape, constants, fixed, {})


def kind_of(value: fmpq) -> object:
    """Return what the structure of a formula depends on in one of its numbers."""
    return int(value.p) if value.q == 1 and abs(value) <= 1 else 2 if value > 0 else -2


def _template(
    program: Program,
    tape: Tape,
    constants: FloatArray,
    fixed: Sequence[fmpq | None],
    varying: Mapping[int, tuple[int, int]],
) -> Template:
    numbered = [at for at in tape.instructions if at.operation == "pi" or at.number is not None]
    exponents = {slot: at.left for slot, at in enumerate(numbered) if at.operation == "power"}
    distinct = _distinct(constants.tolist(), exponents)
    return Template(program, tape, constants, tuple(fixed), varying, exponents, distinct)


def _distinct(row: Sequence[float], exponents: Mapping[int, int]) -> tuple[int, int]:
    powers = {(base, row[slot]) for slot, base in exponents.items()}
    if len(exponents) == len(row):
        return 0, len(powers)
    return len({number for slot, number in enumerate(row) if slot not in exponents}), len(powers)


def _source(
    number: fmpq, seen: fmpq, values: Sequence[fmpq], others: Sequence[fmpq]
) -> tuple[int, int] | None:
    """Return the value that a number is, or is the opposite of, at both probes."""
    for index, (value, other) in enumerate(zip(values, others, strict=True)):
        for sign in (1, -1):
            if number == sign * value and seen == sign * other:
                return index, sign
    return None
