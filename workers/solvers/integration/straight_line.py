"""Records the gradient of a potential as one list of float operations, for fast evaluation.

The formula is differentiated once, by jets over an algebra that writes down what
is done instead of doing it; a point then costs one pass over the list. Five to
ten times faster than jets of numbers, which decide anew at every point what is
zero: a Runge-Kutta method asks for ten thousands of gradients.
"""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import Potential
from workers.solvers.integration.interface import Rounding

Operation = Callable[..., float]

_UNARY = -1  # the second operand that an operation of one argument lacks
_LONGEST_PRODUCT = 16  # integer powers up to this one are products, correctly rounded to some ulp


@dataclass(frozen=True, slots=True)
class StraightLine:
    """Operations on registers: g1, g2, g3 and the constants first, then one result per operation."""

    constants: tuple[float, ...]
    operations: tuple[tuple[Operation, int, int], ...]
    results: tuple[int, int, int]

    def __call__(self, g1: float, g2: float, g3: float) -> tuple[float, float, float]:
        """Return (V_1, V_2, V_3), all NaN where an operation is undefined or overflows."""
        registers = [g1, g2, g3, *self.constants]
        append = registers.append
        try:
            for operation, left, right in self.operations:
                append(
                    operation(registers[left], registers[right]) if right >= 0 else operation(registers[left])
                )
        except (ArithmeticError, ValueError):
            return math.nan, math.nan, math.nan
        first, second, third = self.results
        return registers[first], registers[second], registers[third]


def gradient_line(
    potential: Potential, rounding: Rounding, *, longest_product: int | None = _LONGEST_PRODUCT
) -> StraightLine:
    """Return the gradient of ``potential`` as a straight line, its constants made doubles by ``rounding``.

    Integer powers up to ``longest_product`` are products; None: all of them.
    """
    return gradient_line_of(potential.tape, rounding, longest_product=longest_product)


def gradient_line_of(tape: Tape, rounding: Rounding, *, longest_product: int | None) -> StraightLine:
    """Return what :func:`gradient_line` does of a potential with this tape."""
    recorder = _Recorder(rounding, longest_product)
    jets = FirstOrderJets(recorder, 3)
    inputs = [recorder.variable(axis) for axis in range(3)]
    parts = jets.gradient(tape.evaluate(jets, jets.variables(inputs)))
    return recorder.line(parts)


@dataclass(frozen=True, slots=True)
class _Operand:
    """A constant, or the result of an operation; which one is a number in its own list."""

    kind: str
    number: int


class _Recorder:
    """An algebra that records; equal operations are recorded once, and 1·x and constants folded."""

    def __init__(self, rounding: Rounding, longest_product: int | None) -> None:
        self._rounding = rounding
        self._longest_product = longest_product
        self._constants: dict[float, _Operand] = {}
        self._operations: dict[tuple[Operation, _Operand, _Operand | None], _Operand] = {}

    def variable(self, axis: int) -> _Operand:
        return _Operand("variable", axis)

    def line(self, results: tuple[_Operand, ...]) -> StraightLine:
        offset = 3 + len(self._constants)

        def register(operand: _Operand | None) -> int:
            if operand is None:
                return _UNARY
            start = {"variable": 0, "constant": 3, "operation": offset}[operand.kind]
            return start + operand.number

        operations = tuple(
            (operation, register(left), register(right)) for operation, left, right in self._operations
        )
        first, second, third = map(register, results)
        return StraightLine(tuple(self._constants), operations, (first, second, third))

    def constant(self, value: Fraction) -> _Operand:
        return self._number(self._rounding(value))

    def pi(self) -> _Operand:
        return self._number(math.pi)

    def add(self, left: _Operand, right: _Operand) -> _Operand:
        return self._record(operator.add, left, right)

    def subtract(self, left: _Operand, right: _Operand) -> _Operand:
        return self._record(operator.sub, left, right)

    def multiply(self, left: _Operand, right: _Operand) -> _Operand:
        one = self._number(1.0)
        if left == one:
            return right
        if right == one:
            return left
        return self._record(operator.mul, left, right)

    def divide(self, left: _Operand, right: _Operand) -> _Operand:
        return self._record(operator.truediv, left, right)

    def negate(self, operand: _Operand) -> _Operand:
        return self._record(operator.neg, operand)

    def power(self, base: _Operand, exponent: Fraction) -> _Operand:
        longest = self._longest_product
        if exponent.denominator != 1 or (longest is not None and abs(exponent) > longest):
            return self._record(math.pow, base, self.constant(exponent))
        product = self._number(1.0)
        for bit in f"{abs(exponent.numerator):b}":
            product = self.multiply(product, product)
            product = self.multiply(product, base) if bit == "1" else product
        return product if exponent >= 0 else self.divide(self._number(1.0), product)

    def general_power(self, base: _Operand, exponent: _Operand) -> _Operand:
        return self.call("exp", self.multiply(exponent, self.call("log", base)))

    def call(self, name: str, argument: _Operand) -> _Operand:
        return self._record(_FUNCTIONS[name], argument)

    def _number(self, value: float) -> _Operand:
        return self._constants.setdefault(value, _Operand("constant", len(self._constants)))

    def _record(self, operation: Operation, left: _Operand, right: _Operand | None = None) -> _Operand:
        key = (operation, left, right)
        return self._operations.setdefault(key, _Operand("operation", len(self._operations)))


def _sign(argument: float) -> float:
    return math.copysign(1.0, argument) if argument else 0.0


_FUNCTIONS: dict[str, Operation] = {
    "exp": math.exp,
    "log": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "abs": abs,
    "sign": _sign,
}
