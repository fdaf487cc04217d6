"""A potential's gradient as operations on power series, for compiled code."""

import operator
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import cos, exp, isfinite, log, nan, pow, sin, tan

import numpy as np

from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import Potential
from workers.solvers.compiled.general import series
from workers.solvers.compiled.general.records import Gradient
from workers.solvers.integration.errors import UnsupportedFormulaError
from workers.solvers.integration.interface import Rounding
from workers.solvers.integration.straight_line import (
    Operation,
    StraightLine,
    gradient_line,
    gradient_line_of,
)

_SIMPLE = {
    operator.add: series.ADD,
    operator.sub: series.SUBTRACT,
    operator.neg: series.NEGATE,
    pow: series.POWER,
    exp: series.EXP,
    log: series.LOG,
}
_NONE = -1
_CONSTANT = -2
"""Constants are counted down from here, and variables and results up from 0, until all are known."""


def gradient_program(potential: Potential, rounding: Rounding) -> Gradient:
    """Return the gradient with constants made doubles by ``rounding``.

    Raises
    ------
    UnsupportedFormulaError
        The formula has a function without a Taylor series everywhere.
    """
    return _written(gradient_line(potential, rounding, longest_product=None))[0]


@dataclass(frozen=True, slots=True)
class SharedGradient:
    """The gradient of potentials that differ in numbers alone: one program, and what its constants are."""

    gradient: Gradient
    """The gradient of one of them."""
    sources: tuple[float | int, ...]
    """Sources of the constants at the program's beginning: a constant, or the index of a number of the
    tape."""
    folded: tuple[tuple[Operation, tuple[int, ...]], ...]
    """The constants after these, each by an operation on constants."""
    rounding: Rounding

    def constants(self, numbers: Sequence[Fraction | None]) -> list[float] | None:
        """Return the constants for the numbers of a tape, None for π; None where its program may be another.

        A program is another one where numbers that differ elsewhere are equal, or one of them is 1.
        """
        found = list[float]()
        for source in self.sources:
            if isinstance(source, float):
                found.append(source)
                continue
            number = numbers[source]
            if number is None:
                return None
            found.append(self.rounding(number))
        if len(set(found)) != len(found) or not all(map(isfinite, found)):
            return None
        for operation, operands in self.folded:
            found.append(_carried_out(operation, [found[place] for place in operands]))
        return found


def shared_gradient(tapes: tuple[Tape, Tape], rounding: Rounding) -> SharedGradient | None:
    """Return what two tapes of one structure have in common, and all that differ from them like that.

    None where a constant that differs is no number of the tapes, or where the programs differ.

    Raises
    ------
    UnsupportedFormulaError
        See :func:`gradient_program`.
    """
    first, second = (gradient_line_of(tape, rounding, longest_product=None) for tape in tapes)
    if (first.operations, first.results) != (second.operations, second.results):
        return None
    numbers = [
        [None if number is None else rounding(number) for number in _constants_of(tape)] for tape in tapes
    ]
    pairs = list(zip(*numbers, strict=True))
    sources = list[float | int]()
    for pair in zip(first.constants, second.constants, strict=True):
        if pair[0] == pair[1]:
            sources.append(pair[0])
        elif pair in pairs:
            sources.append(pairs.index(pair))
        else:
            return None
    gradient, folded = _written(first)
    return SharedGradient(gradient, tuple(sources), folded, rounding)


def _constants_of(tape: Tape) -> list[Fraction | None]:
    """Return the constants of a tape; None for π, and for what is an exponent."""
    return [
        each.number if each.operation == "constant" else None
        for each in tape.instructions
        if each.operation == "pi" or each.number is not None
    ]


def _written(line: StraightLine) -> tuple[Gradient, tuple[tuple[Operation, tuple[int, ...]], ...]]:
    """Return the program of a line, and the operations that were carried out on constants."""
    writer = _Writer()
    places = [3, 4, 5, *(writer.constant(value) for value in line.constants)]
    for operation, left, right in line.operations:
        operands = [places[left]] if right < 0 else [places[left], places[right]]
        places.append(writer.result(operation, operands))
    return writer.program([places[result] for result in line.results]), tuple(writer.folded)


def _carried_out(operation: Operation, operands: Sequence[float]) -> float:
    try:
        return operation(*operands)
    except (ArithmeticError, ValueError):
        return nan


class _Writer:
    """Writes operations; those on constants alone are carried out."""

    def __init__(self) -> None:
        self._constants: list[float] = []
        self._rows: list[tuple[int, int, int, int]] = []
        self._count = series.STATE
        self._waves: dict[int, tuple[int, int]] = {}
        self.folded = list[tuple[Operation, tuple[int, ...]]]()
        """Operations that were carried out on constants, by the indices of these."""

    def constant(self, value: float) -> int:
        self._constants.append(value)
        return _CONSTANT - len(self._constants) + 1

    def result(self, operation: Operation, operands: Sequence[int]) -> int:
        """Return the place of what an operation gives."""
        if all(place <= _CONSTANT for place in operands):
            known = tuple(_CONSTANT - place for place in operands)
            self.folded.append((operation, known))
            return self.constant(_carried_out(operation, [self._constants[place] for place in known]))
        left, right = operands if len(operands) > 1 else (operands[0], _NONE)
        if operation in _SIMPLE:
            return self._row(_SIMPLE[operation], left, right)
        if operation is operator.mul:
            left, right = (right, left) if right <= _CONSTANT else (left, right)
            return self._row(series.SCALE if left <= _CONSTANT else series.MULTIPLY, left, right)
        if operation is operator.truediv:
            return self._row(series.SHARE if right <= _CONSTANT else series.DIVIDE, left, right)
        if operation not in (sin, cos, tan):
            raise UnsupportedFormulaError(
                "a Taylor integrator has no abs and no sign; the Runge-Kutta integrator takes them",
                pointer="/potential",
            )
        if left not in self._waves:
            self._waves[left] = self._row(series.SINE, left, self._count + 1), self._count
            self._count += 1
        sine, cosine = self._waves[left]
        if operation is tan:
            return self._row(series.DIVIDE, sine, cosine)
        return sine if operation is sin else cosine

    def program(self, results: Sequence[int]) -> Gradient:
        """Return what was written, without what the results do not need."""
        needed, kept = set(results), list[tuple[int, int, int, int]]()
        for row in reversed(self._rows):
            operation, to, left, right = row
            if to in needed or (operation == series.SINE and right in needed):
                needed |= {left, right}
                kept.insert(0, row)
        first = series.STATE + len(self._constants)

        def register(place: int) -> int:
            if place <= _CONSTANT:
                return series.STATE + _CONSTANT - place
            return place if place < series.STATE else first + place - series.STATE

        code = [(operation, *map(register, row)) for operation, *row in kept]
        are_constant = [place <= _CONSTANT for place in results]
        return Gradient(
            np.array(code, dtype=np.int64).reshape(-1, 4),
            np.array(self._constants, dtype=np.float64),
            np.array([*map(register, results), *are_constant], dtype=np.int64),
            first + self._count - series.STATE,
        )

    def _row(self, operation: int, left: int, right: int) -> int:
        to = self._count
        self._rows.append((operation, to, left, right))
        self._count += 1
        return to
