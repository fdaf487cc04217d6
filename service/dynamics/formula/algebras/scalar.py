"""Formulas on plain floats, one point at a time, without numpy's overhead."""

import math
from collections.abc import Callable
from fractions import Fraction

from service.dynamics.formula.algebra import OperatorAlgebra
from service.dynamics.formula.algebras.real import nearest_double


def _sign(argument: float) -> float:
    return math.copysign(1.0, argument) if argument > 0.0 or argument < 0.0 else argument


FUNCTIONS: dict[str, Callable[[float], float]] = {
    "exp": math.exp,
    "log": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "abs": abs,
    "sign": _sign,
}


class ScalarAlgebra(OperatorAlgebra[float]):
    """Python floats; NaN where undefined, ±inf on overflow, as in RealAlgebra."""

    def constant(self, value: Fraction) -> float:
        """Return the nearest double."""
        return nearest_double(value)

    def pi(self) -> float:
        """Return π."""
        return math.pi

    def divide(self, left: float, right: float) -> float:
        """Return left / right, NaN where right is 0."""
        return left / right if right else math.nan

    def power(self, base: float, exponent: Fraction) -> float:
        """Return base^exponent; NaN for a negative base under a fraction and at poles."""
        whole = exponent.denominator == 1
        if (base == 0.0 and exponent < 0) or (base < 0.0 and not whole):
            return math.nan
        try:
            return base**exponent.numerator if whole else math.pow(base, float(exponent))
        except OverflowError:
            odd = whole and exponent.numerator % 2 == 1
            return -math.inf if base < 0.0 and odd else math.inf

    def general_power(self, base: float, exponent: float) -> float:
        """Return base^exponent, NaN unless base > 0."""
        if not base > 0.0:
            return math.nan
        try:
            return math.pow(base, exponent)
        except OverflowError:
            return math.inf

    def call(self, name: str, argument: float) -> float:
        """Return the function, NaN where it is undefined."""
        try:
            return FUNCTIONS[name](argument)
        except ValueError:
            return math.nan
        except OverflowError:
            return math.inf
