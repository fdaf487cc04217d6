"""Formulas in doubles: on numpy arrays of any broadcastable shapes, or on plain floats."""

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebra import OperatorAlgebra

FloatArray = NDArray[np.float64]
_FUNCTIONS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "abs": np.abs,
    "sign": np.sign,
}


class QuietedRealAlgebra(OperatorAlgebra[FloatArray]):
    """float64 arrays; NaN where undefined (also at poles). numpy's warnings must be off."""

    def constant(self, value: Fraction) -> FloatArray:
        """Return the nearest double, ±inf beyond the doubles."""
        return np.asarray(nearest_double(value))

    def pi(self) -> FloatArray:
        """Return π."""
        return np.asarray(np.pi)

    def divide(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """Return left / right, NaN where right is 0."""
        return left / np.where(right == 0.0, np.nan, right)

    def power(self, base: FloatArray, exponent: Fraction) -> FloatArray:
        """Return base^exponent; NaN for a negative base under a fraction and at poles."""
        if exponent < 0:
            base = np.where(base == 0.0, np.nan, base)
        if exponent.denominator == 2 and abs(exponent.numerator) == 1:
            root = np.sqrt(base)
            return root if exponent > 0 else 1.0 / root
        return np.power(base, float(exponent))

    def general_power(self, base: FloatArray, exponent: FloatArray) -> FloatArray:
        """Return base^exponent, NaN unless base > 0."""
        return np.power(np.where(base > 0.0, base, np.nan), exponent)

    def call(self, name: str, argument: FloatArray) -> FloatArray:
        """Return the function, log of 0 being NaN."""
        if name == "log":
            argument = np.where(argument > 0.0, argument, np.nan)
        return _FUNCTIONS[name](argument)


class RealAlgebra(QuietedRealAlgebra):
    """The same without warnings, for single operations.

    For single points :class:`~service.dynamics.formula.algebras.real.ScalarAlgebra` is faster.
    """

    add = np.errstate(all="ignore")(QuietedRealAlgebra.add)
    subtract = np.errstate(all="ignore")(QuietedRealAlgebra.subtract)
    multiply = np.errstate(all="ignore")(QuietedRealAlgebra.multiply)
    divide = np.errstate(all="ignore")(QuietedRealAlgebra.divide)
    power = np.errstate(all="ignore")(QuietedRealAlgebra.power)
    general_power = np.errstate(all="ignore")(QuietedRealAlgebra.general_power)
    call = np.errstate(all="ignore")(QuietedRealAlgebra.call)


def nearest_double(value: Fraction) -> float:
    """Return the double nearest to ``value``, ±inf where it is too large."""
    try:
        return float(value)
    except OverflowError:
        return float("inf") if value > 0 else float("-inf")


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
