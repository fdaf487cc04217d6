"""Formulas on numpy arrays of doubles of any broadcastable shapes."""

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

    For single points :class:`~service.dynamics.formula.algebras.scalar.ScalarAlgebra` is faster.
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
