"""A potential's gradient as operations on numbers and on power series, from its derived program.

The program of a structure is recorded once (:mod:`service.dynamics.formula.derived`). Here its numbers are
put in: whole powers become products, and operations on constants are carried out. Which operations are left
depends on the structure and on whole exponents alone, so potentials that differ in other numbers share them.
"""

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from service.dynamics.formula import derived
from service.dynamics.formula.algebras.real import FUNCTIONS
from service.dynamics.formula.derived import Exact
from service.dynamics.formula.tape import Tape
from workers.solvers.compiled.evaluation.program import numbers_of
from workers.solvers.compiled.general import steps
from workers.solvers.compiled.records import Gradient
from workers.solvers.errors import UnsupportedFormulaError
from workers.solvers.integration.interface import Rounding

_OPERATIONS: dict[str, Callable[..., float]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "negate": operator.neg,
    "power": math.pow,
    **FUNCTIONS,
}
_SERIES = {
    "add": steps.ADD,
    "subtract": steps.SUBTRACT,
    "multiply": steps.MULTIPLY,
    "divide": steps.DIVIDE,
    "negate": steps.NEGATE,
    "power": steps.POWER,
    "exp": steps.EXP,
    "log": steps.LOG,
}
_VARIABLES = 3
_NONE = -1  # the second operand that an operation of one argument lacks
_ONE = Exact(-1, 1)


GradientFunction = Callable[[float, float, float], tuple[float, float, float]]


class _Step(NamedTuple):
    """An operation on places: constants are counted down from -1, g1, g2, g3 and results up from 0."""

    name: str
    operands: tuple[int, ...]


class Line:
    """The gradient of a potential as operations, one after the other."""

    def __init__(self, tape: Tape) -> None:
        """Record the operations of a potential with this tape."""
        self.steps = list[_Step]()
        self.sources = list[Exact | _Step]()
        """The constants: numbers of the tape, or operations on constants before."""
        self.whole = dict[int, Fraction]()
        """Numbers of the tape that are whole exponents, by their places."""
        self.fractional = set[Exact]()
        """Exponents that are not whole."""
        self._numbers = numbers_of(tape)
        self._places = dict[Exact | _Step, int]()
        program = derived.derived(tape, derived.slopes)
        places = list(range(_VARIABLES))
        for (operation, left, right, _, name), exact in zip(
            program.instructions, program.numbers, strict=True
        ):
            operands = [places[register] for register in (left, right) if register >= 0]
            if operation == "power":
                assert exact is not None
                places.append(self._power(operands[0], exact))
            elif exact is not None:
                places.append(self._constant(exact))
            elif operation == "general_power":
                logarithm = self._put("log", operands[0])
                places.append(self._put("exp", self._put("multiply", operands[1], logarithm)))
            else:
                places.append(self._put(name or operation, *operands))
        self.results = tuple(places[register] for register in program.results)

    def constants(self, numbers: Sequence[Fraction | None], rounding: Rounding) -> list[float]:
        """Return the constants for the numbers of a tape of this structure, None for π; NaN: undefined."""
        found = list[float]()
        for source in self.sources:
            if isinstance(source, _Step):
                found.append(_carried_out(source.name, [found[-1 - place] for place in source.operands]))
                continue
            number = Fraction(0) if source.place < 0 else numbers[source.place]
            found.append(math.pi if number is None else rounding(number + source.more))
        return found

    def is_of(self, numbers: Sequence[Fraction | None]) -> bool:
        """Tell whether a tape of this structure with these numbers has these operations."""
        return all(numbers[place] == exponent for place, exponent in self.whole.items()) and not any(
            _exponent(exact, numbers).denominator == 1 for exact in self.fractional
        )

    def _constant(self, exact: Exact | _Step) -> int:
        place = self._places.get(exact)
        if place is None:
            self.sources.append(exact)
            place = self._places[exact] = -len(self.sources)
        return place

    def _put(self, name: str, *operands: int) -> int:
        step = _Step(name, operands)
        if all(place < 0 for place in operands):
            return self._constant(step)
        place = self._places.get(step)
        if place is None:
            place = self._places[step] = _VARIABLES + len(self.steps)
            self.steps.append(step)
        return place

    def _power(self, base: int, exact: Exact) -> int:
        exponent = _exponent(exact, self._numbers)
        if exponent.denominator != 1:
            self.fractional.add(exact)
            return self._put("power", base, self._constant(exact))
        if exact.place >= 0:
            self.whole[exact.place] = exponent - exact.more
        if exponent == 0:
            return self._constant(_ONE)
        product = base
        for bit in f"{abs(exponent.numerator):b}"[1:]:
            product = self._put("multiply", product, product)
            product = self._put("multiply", product, base) if bit == "1" else product
        return product if exponent > 0 else self._put("divide", self._constant(_ONE), product)


def _exponent(exact: Exact, numbers: Sequence[Fraction | None]) -> Fraction:
    known = Fraction(0) if exact.place < 0 else numbers[exact.place]
    assert known is not None, "no exponent is π"
    return known + exact.more


def _carried_out(name: str, operands: Sequence[float]) -> float:
    try:
        return _OPERATIONS[name](*operands)
    except (ArithmeticError, ValueError):
        return math.nan


def gradient_function(tape: Tape, rounding: Rounding) -> GradientFunction:
    """Return (V_1, V_2, V_3) as a function of (g1, g2, g3), all NaN where an operation is undefined.

    It goes through the operations once: five to ten times faster than jets of numbers, and a Runge-Kutta
    method asks for ten thousands of gradients. Constants are made doubles by ``rounding``.
    """
    line = Line(tape)
    constants = line.constants(numbers_of(tape), rounding)

    def register(place: int) -> int:
        return -1 - place if place < 0 else len(constants) + place

    steps = [
        (_OPERATIONS[name], register(operands[0]), register(operands[1]) if len(operands) > 1 else _NONE)
        for name, operands in line.steps
    ]
    first, second, third = map(register, line.results)

    def gradient(g1: float, g2: float, g3: float) -> tuple[float, float, float]:
        registers = [*constants, g1, g2, g3]
        append = registers.append
        try:
            for function, left, right in steps:
                x = registers[left]
                append(function(x) if right < 0 else function(x, registers[right]))
        except (ArithmeticError, ValueError):
            return math.nan, math.nan, math.nan
        return registers[first], registers[second], registers[third]

    return gradient


@dataclass(frozen=True, slots=True)
class SharedGradient:
    """The gradient of potentials that differ in numbers alone: one program, and what its constants are."""

    line: Line
    gradient: Gradient
    """The gradient of one of them."""

    def constants(self, numbers: Sequence[Fraction | None], rounding: Rounding) -> list[float] | None:
        """Return the constants for the numbers of a tape, None for π; None where its program is another."""
        if not self.line.is_of(numbers):
            return None
        found = self.line.constants(numbers, rounding)
        return found if all(map(math.isfinite, found)) else None


def shared_gradient(tape: Tape, rounding: Rounding) -> SharedGradient:
    """Return the gradient of a tape on power series, with constants made doubles by ``rounding``.

    Raises
    ------
    UnsupportedFormulaError
        The formula has a function without a Taylor series everywhere.
    """
    line = Line(tape)
    constants = line.constants(numbers_of(tape), rounding)
    first = steps.STATE + len(constants)
    registers = list(range(steps.STATE - _VARIABLES, steps.STATE))
    code, count, waves = list[tuple[int, int, int, int]](), first, dict[int, tuple[int, int]]()

    def register(place: int) -> int:
        return steps.STATE - 1 - place if place < 0 else registers[place]

    def put(operation: int, left: int, right: int) -> int:
        nonlocal count
        code.append((operation, count, left, right))
        count += 1
        return count - 1

    for name, operands in line.steps:
        are_constant = [place < 0 for place in operands]
        left, right = register(operands[0]), register(operands[-1])
        if name in ("sin", "cos", "tan"):
            if left not in waves:
                waves[left] = put(steps.SINE, left, count + 1), count
                count += 1
            sine, cosine = waves[left]
            made = put(steps.DIVIDE, sine, cosine) if name == "tan" else sine if name == "sin" else cosine
        elif name == "multiply" and any(are_constant):
            made = put(steps.SCALE, *((left, right) if are_constant[0] else (right, left)))
        elif name == "divide" and are_constant[1]:
            made = put(steps.SHARE, left, right)
        elif name in _SERIES:
            made = put(_SERIES[name], left, right)
        else:
            raise UnsupportedFormulaError(
                "a Taylor integrator has no abs and no sign; the Runge-Kutta integrator takes them",
                pointer="/potential",
            )
        registers.append(made)
    ends = [*map(register, line.results), *(place < 0 for place in line.results)]
    return SharedGradient(
        line,
        Gradient(
            np.array(code, dtype=np.int64).reshape(-1, 4),
            np.array(constants, dtype=np.float64),
            np.array(ends, dtype=np.int64),
            count,
        ),
    )
