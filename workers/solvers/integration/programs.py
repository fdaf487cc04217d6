"""A potential's gradient as operations on power series, for compiled code."""

import operator
from collections.abc import Sequence
from math import cos, exp, log, nan, pow, sin, tan

import numpy as np

from service.dynamics.potentials.potential import Potential
from workers.solvers.compiled.general import series
from workers.solvers.compiled.general.records import Gradient
from workers.solvers.integration.errors import UnsupportedFormulaError
from workers.solvers.integration.interface import Rounding
from workers.solvers.integration.straight_line import Operation, gradient_line

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
    line = gradient_line(potential, rounding, longest_product=None)
    writer = _Writer()
    places = [3, 4, 5, *(writer.constant(value) for value in line.constants)]
    for operation, left, right in line.operations:
        operands = [places[left]] if right < 0 else [places[left], places[right]]
        places.append(writer.result(operation, operands))
    return writer.program([places[result] for result in line.results])


class _Writer:
    """Writes operations; those on constants alone are carried out."""

    def __init__(self) -> None:
        self._constants: list[float] = []
        self._rows: list[tuple[int, int, int, int]] = []
        self._count = series.STATE
        self._waves: dict[int, tuple[int, int]] = {}

    def constant(self, value: float) -> int:
        self._constants.append(value)
        return _CONSTANT - len(self._constants) + 1

    def result(self, operation: Operation, operands: Sequence[int]) -> int:
        """Return the place of what an operation gives."""
        if all(place <= _CONSTANT for place in operands):
            try:
                return self.constant(operation(*(self._constants[_CONSTANT - place] for place in operands)))
            except (ArithmeticError, ValueError):
                return self.constant(nan)
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
