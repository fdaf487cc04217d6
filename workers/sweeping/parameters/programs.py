"""Evaluates the constants of a formula's program at every point, without recompiling the formula.

A potential affine in its parameters compiles to one program whose constants are
affine in them too, with exact coefficients: they are read off from a few
formulas compiled at numbers that make nothing vanish, and held against one more. Where a constant becomes
0, 1 or -1, or meets another one, the compiler would write a shorter program;
such points are compiled one by one.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import as_fmpq
from service.dynamics.formula.tape import Tape, with_inputs
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import Part, with_values
from workers.solvers.compiled.evaluation.program import (
    Program,
    has_number,
    make_program,
    numbers_of,
    rests_of,
)
from workers.sweeping.parameters.family import Path

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

_PROBE, _STEP = Fraction(1_000_003, 7919), Fraction(104_729, 611_953)
"""Ratios of primes, far from any number that a formula would fold."""


@dataclass(frozen=True, slots=True)
class Affine:
    """A constant ``at_zero`` + Σ ``slopes``_k p_k."""

    at_zero: Fraction
    slopes: tuple[Fraction, ...]

    @property
    def is_constant(self) -> bool:
        """Tell whether no parameter is in it."""
        return not any(self.slopes)

    @property
    def sign_and_place(self) -> tuple[int, int] | None:
        """Return (±1, k) if this is ± the parameter k, whose double is known."""
        at = [k for k, slope in enumerate(self.slopes) if slope]
        if len(at) == 1 and not self.at_zero and abs(self.slopes[at[0]]) == 1:
            return int(self.slopes[at[0]]), at[0]
        return None

    def rests(self, parameters: Sequence[Sequence[fmpq]], doubles: Sequence[float]) -> list[float]:
        """Return what the ``doubles`` of the constants at each row of parameters leave out."""
        at_zero = as_fmpq(self.at_zero)
        slopes = [(k, as_fmpq(slope)) for k, slope in enumerate(self.slopes)]
        result = list[float]()
        for row, known in zip(parameters, doubles, strict=True):
            left = sum((slope * row[k] for k, slope in slopes if slope), at_zero)
            left -= fmpq(*known.as_integer_ratio())
            result.append(nearest_double(int(left.p), int(left.q)))
        return result

    def doubles(self, parameters: Sequence[Sequence[fmpq]]) -> list[float]:
        """Return the constant at each row of parameters, rounded once."""
        slopes = [(k, as_fmpq(slope)) for k, slope in enumerate(self.slopes) if slope]
        at_zero, result = as_fmpq(self.at_zero), list[float]()
        for row in parameters:
            value = sum((slope * row[k] for k, slope in slopes), at_zero)
            result.append(nearest_double(int(value.p), int(value.q)))
        return result


@dataclass(frozen=True, slots=True)
class AffineProgram:
    """One program for all parameters that leave its structure as it is."""

    program: Program
    constants: FloatArray
    """With those that no parameter is in."""
    varying: Mapping[int, Affine]
    """The others by their indices."""
    tape: Tape
    """The tape of one member."""

    def rows(self, doubles: FloatArray, exact: Sequence[Sequence[fmpq]] | None) -> FloatArray:
        """Return the constants, shape (points, constants), at ``doubles`` (points, parameters).

        ``exact`` are the same parameters exactly; None where :attr:`needs_exact` is False.
        """
        rows = np.repeat(self.constants[None, :], len(doubles), axis=0)
        for slot, affine in self.varying.items():
            known = affine.sign_and_place
            if known is not None:
                sign, k = known
                rows[:, slot] = sign * doubles[:, k]
            elif exact is not None:
                rows[:, slot] = affine.doubles(exact)
        return rows

    def rests(self, rows: FloatArray, exact: Sequence[Sequence[fmpq]]) -> FloatArray:
        """Return what :meth:`rows` leave out of the constants, of the same shape."""
        result = np.repeat(rests_of(self.tape, self.constants)[None, :], len(rows), axis=0)
        for slot, affine in self.varying.items():
            result[:, slot] = affine.rests(exact, rows[:, slot].tolist())
        return result

    def group(self, rows: FloatArray, indices: IntArray) -> "Group":
        """Return points with these constants as a group."""
        return Group(self.program, rows, indices, self.tape, tuple(self.varying))

    @property
    def needs_exact(self) -> bool:
        """Tell whether doubles of the parameters do not tell the constants."""
        return any(affine.sign_and_place is None for affine in self.varying.values())

    def are_generic(self, rows: FloatArray) -> BoolArray:
        """Say for each row whether the formula compiles to this very program there."""
        generic: BoolArray = np.asarray(np.isfinite(rows).all(axis=1))
        for slot in self.varying:
            column = rows[:, slot]
            generic &= ~np.isin(column, (0.0, 1.0, -1.0))
            for other in range(rows.shape[1]):
                if other != slot:
                    generic &= column != rows[:, other]
        return generic


def affine_program(
    body: RigidBody, document: Mapping[str, object], paths: Sequence[Path], signs: Sequence[int]
) -> AffineProgram | None:
    """Return the program of a potential that is affine in the numbers at ``paths``, which have these signs.

    None where the probes do not share one program. A family writes a sum by the signs of its terms.
    """
    start = [sign * (_PROBE + 1_009 * k * _STEP) for k, sign in enumerate(signs)]
    try:
        origin = _tape(body, document, paths, start)
        steps = [
            _tape(body, document, paths, [p + _STEP * (k == j) for j, p in enumerate(start)])
            for k in range(len(paths))
        ]
        other = [p * (1 + _STEP) for p in start]
        witness = _tape(body, document, paths, other)
    except (DynamicsError, ValueError):
        return None
    program, constants = make_program(origin)
    if any(make_program(tape)[0].key != program.key for tape in (*steps, witness)):
        return None
    numbers, moved = numbers_of(origin), [numbers_of(tape) for tape in steps]
    varying: dict[int, Affine] = {}
    for slot, (number, seen) in enumerate(zip(numbers, numbers_of(witness), strict=True)):
        if number is None:
            continue
        slopes = tuple(((each[slot] or number) - number) / _STEP for each in moved)
        at_zero = number - sum((s * p for s, p in zip(slopes, start, strict=True)), Fraction(0))
        if at_zero + sum((s * p for s, p in zip(slopes, other, strict=True)), Fraction(0)) != seen:
            return None
        affine = Affine(at_zero, slopes)
        if not affine.is_constant:
            varying[slot] = affine
    return AffineProgram(program, constants, varying, origin)


@dataclass(frozen=True, slots=True)
class Group:
    """Points that share a program."""

    program: Program
    rows: FloatArray
    """The constants of each, the doubles nearest to them."""
    indices: IntArray
    """Indices of the points in their block."""
    tape: Tape
    """The tape of one of the points; the others differ in constants only."""
    varying: tuple[int, ...]
    """The indices of those constants in a row."""
    rests: FloatArray | None = None
    """Low parts that the rows leave out of the constants; None where nobody asked for them."""

    def part(self, members: NDArray[np.bool_]) -> "Group":
        """Return those of the points that are ``members``, shape (points,)."""
        rests = None if self.rests is None else self.rests[members]
        return replace(self, rows=self.rows[members], indices=self.indices[members], rests=rests)

    def tape_of_all(self) -> Tape:
        """Return the tape that has the varying constants as further variables."""
        numbered = [index for index, at in enumerate(self.tape.instructions) if has_number(at)]
        return with_inputs(self.tape, [numbered[slot] for slot in self.varying])

    def inputs(self) -> tuple[FloatArray, ...]:
        """Return those variables, each of shape (points,)."""
        return tuple(self.rows[:, slot] for slot in self.varying)


def grouped(body: RigidBody, documents: Mapping[int, Part]) -> list[Group]:
    """Compile the potential of each point's document; what has no program is in no group."""
    members: dict[tuple[bytes, tuple[object, ...]], list[tuple[int, Tape, Program, FloatArray]]] = {}
    for index, document in documents.items():
        try:
            tape = potential_of(document, body).tape
        except (DynamicsError, ValueError):
            continue
        program, constants = make_program(tape)
        exponents = tuple(at.number for at in tape.instructions if at.operation == "power")
        members.setdefault((program.key, exponents), []).append((index, tape, program, constants))
    return [_group(each) for each in members.values()]


def _group(members: Sequence[tuple[int, Tape, Program, FloatArray]]) -> Group:
    indices, tapes, programs, rows = zip(*members, strict=True)
    columns = zip(*map(numbers_of, tapes), strict=True)
    varying = tuple(slot for slot, column in enumerate(columns) if any(n != column[0] for n in column))
    rests = np.array([rests_of(tape, row) for tape, row in zip(tapes, rows, strict=True)])
    return Group(programs[0], np.array(rows), np.array(indices, dtype=np.int64), tapes[0], varying, rests)


def _tape(
    body: RigidBody, document: Mapping[str, object], paths: Sequence[Path], numbers: Sequence[Fraction]
) -> Tape:
    values: dict[Path, object] = dict(zip(paths, map(str, numbers), strict=True))
    return potential_of(with_values(document, values), body).tape


def nearest_double(numerator: int, denominator: int) -> float:
    """Return the double nearest to a ratio, NaN where it is too large."""
    try:
        return numerator / denominator
    except OverflowError:
        return math.nan


def double_of(value: fmpq) -> float:
    """Return the double that is nearest to a ratio."""
    return nearest_double(int(value.p), int(value.q))
