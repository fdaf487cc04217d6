"""Bounds of functions on intervals, and the rounding errors of doubles: for :mod:`.intervals`."""

from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.real import nearest_double

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Bounds = tuple[FloatArray, FloatArray]

OPERATION_ROUNDING = 2.0**-51
"""Four times the relative error of an operation in doubles."""
FUNCTION_ROUNDING = 2.0**-48
"""More than twice the relative error of a function of numpy, which claims 4 units in the last place."""
ABSOLUTE_ROUNDING = 1e-320
"""More than any error of a result that is next to 0, where doubles have a fixed spacing."""
LARGEST_DOUBLE = float(np.finfo(np.float64).max)
LARGEST_LOGARITHM = 746.0
"""Bound of |log x| for doubles x other than 0."""
LARGEST_ANGLE = 1e6


def widened(lo: FloatArray, hi: FloatArray, error: float) -> Bounds:
    """Return bounds of what was rounded to ``lo`` and ``hi`` with half this relative error."""
    below, above = 1.0 - error, 1.0 + error
    low, high = (
        np.minimum(lo * below, lo * above) - ABSOLUTE_ROUNDING,
        np.maximum(hi * below, hi * above) + ABSOLUTE_ROUNDING,
    )
    # What is beyond all doubles is rounded to infinity, and that is no lower bound of it.
    return np.minimum(low, LARGEST_DOUBLE), np.maximum(high, -LARGEST_DOUBLE)


def outwards(lo: FloatArray, hi: FloatArray) -> Bounds:
    """Return bounds of what was rounded to ``lo`` and ``hi`` as IEEE 754 says: by half a unit at most."""
    return np.nextafter(lo, -np.inf), np.nextafter(hi, np.inf)


def real_power(base: FloatArray, exponent: Fraction) -> FloatArray:
    """Return base^exponent for base ≥ 0, rounded; see :func:`power_error`."""
    if exponent == 1:
        return base
    if exponent == 2:
        return base * base
    if exponent == Fraction(1, 2):
        return np.sqrt(base)
    return np.power(base, nearest_double(exponent))


def signed_power(base: FloatArray, exponent: Fraction) -> FloatArray:
    """Return an odd power."""
    return np.copysign(real_power(np.abs(base), exponent), base)


def power_error(exponent: Fraction) -> float:
    """Return the relative error of a power, also where its exponent is no double."""
    double = nearest_double(exponent)
    if not np.isfinite(double):
        return np.inf
    if Fraction(double) == exponent:
        return FUNCTION_ROUNDING
    return FUNCTION_ROUNDING + abs(double) * OPERATION_ROUNDING * LARGEST_LOGARITHM


def _exponentials(lo: FloatArray, hi: FloatArray) -> Bounds:
    return np.exp(lo), np.exp(hi)


def _has_multiple(lo: FloatArray, hi: FloatArray, offset: float, period: float) -> BoolArray:
    """Tell where a number offset + k · period may lie between the bounds."""
    first, last = (lo - offset) / period, (hi - offset) / period
    found: BoolArray = np.floor(last + 1e-9) >= np.ceil(first - 1e-9)
    return found


def _sines(lo: FloatArray, hi: FloatArray, shift: float = 0.0) -> Bounds:
    """Return the bounds of sin; of cos with a shift of a quarter of a turn."""
    function = np.cos if shift else np.sin
    a, b = function(lo), function(hi)
    top, bottom = 0.5 * np.pi - shift, -0.5 * np.pi - shift
    is_far = ~((np.abs(lo) < LARGEST_ANGLE) & (np.abs(hi) < LARGEST_ANGLE))
    low = np.where(is_far | _has_multiple(lo, hi, bottom, 2.0 * np.pi), -1.0, np.minimum(a, b))
    high = np.where(is_far | _has_multiple(lo, hi, top, 2.0 * np.pi), 1.0, np.maximum(a, b))
    is_known = ~(np.isnan(lo) | np.isnan(hi))
    return np.where(is_known, low, np.nan), np.where(is_known, high, np.nan)


def _cosines(lo: FloatArray, hi: FloatArray) -> Bounds:
    return _sines(lo, hi, 0.5 * np.pi)


def _tangents(lo: FloatArray, hi: FloatArray) -> Bounds:
    is_known = (np.abs(lo) < LARGEST_ANGLE) & (np.abs(hi) < LARGEST_ANGLE)
    is_known &= ~_has_multiple(lo, hi, 0.5 * np.pi, np.pi)
    return np.where(is_known, np.tan(lo), np.nan), np.where(is_known, np.tan(hi), np.nan)


RANGES: dict[str, Callable[[FloatArray, FloatArray], Bounds]] = {
    "exp": _exponentials,
    "sin": _sines,
    "cos": _cosines,
    "tan": _tangents,
}
