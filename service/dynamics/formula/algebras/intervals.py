r"""Intervals of doubles rounded outwards, for bounds that hold on whole stretches of a curve.

An element is the set of c · s₁^e₁ · s₂^e₂ · … with lo ≤ c ≤ hi, where the scales s_k are
between the bounds the algebra was made with. Exponents are exact, hence what is a power of a
scale loses nothing by being known on a stretch only, and a sum near s = 0 is known by the
term that leads there, down to 0 itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebra import DerivedOperations
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


def _tangents(lo: FloatArray, hi: FloatArray) -> Bounds:
    is_known = (np.abs(lo) < LARGEST_ANGLE) & (np.abs(hi) < LARGEST_ANGLE)
    is_known &= ~_has_multiple(lo, hi, 0.5 * np.pi, np.pi)
    return np.where(is_known, np.tan(lo), np.nan), np.where(is_known, np.tan(hi), np.nan)


RANGES: dict[str, Callable[[FloatArray, FloatArray], Bounds]] = {
    "exp": lambda lo, hi: (np.exp(lo), np.exp(hi)),
    "sin": _sines,
    "cos": lambda lo, hi: _sines(lo, hi, 0.5 * np.pi),
    "tan": _tangents,
}
Exponents = tuple[Fraction, ...]


@dataclass(frozen=True, slots=True)
class Interval:
    """lo ≤ c ≤ hi, beside the scales to the powers ``exponents``; nothing is known where either is NaN."""

    lo: FloatArray
    hi: FloatArray
    exponents: tuple[Fraction, ...]
    sign: int = 0
    """1 if c ≥ 0 everywhere and 0 at a limit only, -1 if -c is so, 0 if that is not known."""


class IntervalAlgebra(DerivedOperations[Interval]):
    """Arrays of intervals. Where a value may be undefined it is NaN, which no comparison takes for a bound.

    numpy's warnings must be off.

    Parameters
    ----------
    scales
        Bounds of each scale, arrays that broadcast with the elements: 0 ≤ lo ≤ hi. At 0 its
        powers are limits: an element then holds for all values above 0.
    """

    def __init__(self, scales: Sequence[Bounds]) -> None:
        self._scales = tuple(scales)
        self._none = (Fraction(0),) * len(self._scales)
        self._powers: dict[tuple[int, Fraction], Bounds] = {}
        self._sums: dict[tuple[int, int], tuple[Exponents, Exponents, Exponents]] = {}

    def interval(
        self, lo: FloatArray, hi: FloatArray, exponents: tuple[Fraction, ...] | None = None
    ) -> Interval:
        """Return the element of these bounds."""
        sign = 1 if bool(np.all(lo >= 0.0)) else -1 if bool(np.all(hi <= 0.0)) else 0
        return Interval(lo, hi, self._none if exponents is None else exponents, sign)

    def about(self, doubles: FloatArray) -> Interval:
        """Return what numbers are that were rounded to ``doubles``."""
        return self.interval(*outwards(doubles, doubles))

    def bounds(self, element: Interval) -> Bounds:
        """Return bounds of the value with all its powers."""
        collapsed = self._collapsed(element)
        return collapsed.lo, collapsed.hi

    def constant(self, value: Fraction) -> Interval:
        """Return the number: exact if it is a double."""
        double = np.asarray(nearest_double(value))
        if np.isfinite(double) and Fraction(float(double)) == value:
            return self.interval(double, double)
        return self.about(double)

    def pi(self) -> Interval:
        """Return π."""
        return self.about(np.asarray(np.pi))

    def add(self, left: Interval, right: Interval) -> Interval:
        """Return left + right, beside the lower power of each scale."""
        left, right = self._together(left, right)
        lo, hi = outwards(left.lo + right.lo, left.hi + right.hi)
        sign = left.sign if left.sign == right.sign else 0
        return _kept(lo, hi, left.exponents, sign)

    def multiply(self, left: Interval, right: Interval) -> Interval:
        """Return left · right."""
        exponents = self._sum(left.exponents, right.exponents)
        return _kept(*outwards(*_product(left, right)), exponents, left.sign * right.sign)

    def divide(self, left: Interval, right: Interval) -> Interval:
        """Return left / right, NaN where right may change its sign."""
        return self.multiply(left, self._inverse(right))

    def negate(self, operand: Interval) -> Interval:
        """Return -operand."""
        return Interval(-operand.hi, -operand.lo, operand.exponents, -operand.sign)

    def power(self, base: Interval, exponent: Fraction) -> Interval:
        """Return base^exponent; with a fraction the base must be ≥ 0."""
        if exponent < 0:
            return self._inverse(self.power(_without_zero(base), -exponent))
        exponents = tuple(each * exponent for each in base.exponents)
        is_even = exponent.denominator == 1 and exponent.numerator % 2 == 0
        if exponent.denominator == 1 and not is_even:
            lo, hi = signed_power(base.lo, exponent), signed_power(base.hi, exponent)
            return _kept(*widened(lo, hi, power_error(exponent)), exponents, base.sign)
        size = self._size(base) if is_even else base
        if not is_even and base.sign <= 0:
            size = Interval(np.where(base.lo >= 0.0, base.lo, np.nan), base.hi, base.exponents, 0)
        lo, hi = real_power(size.lo, exponent), real_power(size.hi, exponent)
        lo, hi = widened(lo, hi, power_error(exponent))
        return Interval(np.maximum(lo, 0.0), hi, exponents, size.sign)

    def call(self, name: str, argument: Interval) -> Interval:
        """Return the function."""
        if name == "abs":
            return self._size(argument)
        if name == "sign":
            return self.interval(np.sign(argument.lo), np.sign(argument.hi))
        if name == "log":
            return self._logarithm(argument)
        collapsed = self._collapsed(argument)
        lo, hi = RANGES[name](collapsed.lo, collapsed.hi)
        return _kept(*widened(lo, hi, FUNCTION_ROUNDING), self._none, 1 if name == "exp" else 0)

    def _sum(self, left: Exponents, right: Exponents) -> Exponents:
        """Return the exponents of a product, each sum made once: fractions are slow."""
        if right is self._none:
            return left
        if left is self._none:
            return right
        # Known by identity, which holds as long as both are kept here.
        known = self._sums.get((id(left), id(right)))
        if known is None:
            found = tuple([x + y for x, y in zip(left, right, strict=True)])
            found = next((one for *_, one in self._sums.values() if one == found), found)
            known = self._sums[id(left), id(right)] = (
                left,
                right,
                self._none if found == self._none else found,
            )
        return known[2]

    def _together(self, left: Interval, right: Interval) -> tuple[Interval, Interval]:
        """Return both beside the same powers."""
        if left.exponents is right.exponents or left.exponents == right.exponents:
            return left, right
        common = tuple(map(min, left.exponents, right.exponents))
        return self._beside(left, common), self._beside(right, common)

    def _beside(self, element: Interval, exponents: tuple[Fraction, ...]) -> Interval:
        """Return the element with its further powers taken into the bounds."""
        for k, (own, wanted) in enumerate(zip(element.exponents, exponents, strict=True)):
            if own is not wanted and own != wanted:
                factor = Interval(*self._scale_power(k, own - wanted), element.exponents, 1)
                lo, hi = outwards(*_product(element, factor))
                element = _kept(lo, hi, element.exponents, element.sign)
        return Interval(element.lo, element.hi, exponents, element.sign)

    def _collapsed(self, element: Interval) -> Interval:
        return (
            element
            if element.exponents is self._none or element.exponents == self._none
            else self._beside(element, self._none)
        )

    def _scale_power(self, k: int, exponent: Fraction) -> Bounds:
        known = self._powers.get((k, exponent))
        if known is None:
            lo, hi = self._scales[k]
            if exponent < 0:
                lo, hi = hi, lo
            error = power_error(exponent)
            lo, hi = widened(real_power(lo, exponent), real_power(hi, exponent), error)
            known = self._powers[k, exponent] = np.maximum(lo, 0.0), hi
        return known

    def _inverse(self, x: Interval) -> Interval:
        exponents = tuple(-each for each in x.exponents)
        x = _without_zero(x)
        lo, hi = 1.0 / x.hi, 1.0 / x.lo
        if x.sign > 0:
            # At the edge itself, 0, the limit is taken.
            hi = np.where(x.lo == 0.0, np.inf, hi)
        elif x.sign < 0:
            lo = np.where(x.hi == 0.0, -np.inf, lo)
        return _kept(*outwards(lo, hi), exponents, x.sign)

    def _size(self, x: Interval) -> Interval:
        if x.sign > 0:
            return x
        if x.sign < 0:
            return self.negate(x)
        lo = np.maximum(np.maximum(x.lo, -x.hi), 0.0)
        # It may be 0 inside, where 1/x has no value and no limit either.
        return Interval(lo, np.maximum(-x.lo, x.hi), x.exponents, 1 if bool(np.all(lo > 0.0)) else 0)

    def _logarithm(self, x: Interval) -> Interval:
        lo = np.log(np.where((x.lo > 0.0) | ((x.lo == 0.0) & (x.sign > 0)), x.lo, np.nan))
        found = _kept(*widened(lo, np.log(x.hi), FUNCTION_ROUNDING), self._none, 0)
        for k, exponent in enumerate(x.exponents):
            if exponent:
                low, high = self._scales[k]
                logarithm = _kept(*widened(np.log(low), np.log(high), FUNCTION_ROUNDING), self._none, 0)
                found = self.add(found, self.multiply(self.constant(exponent), logarithm))
        return found


def _kept(lo: FloatArray, hi: FloatArray, exponents: tuple[Fraction, ...], sign: int) -> Interval:
    """Return the element, with bounds cut off at 0 according to its known sign."""
    if sign > 0:
        lo = np.maximum(lo, 0.0)
    elif sign < 0:
        hi = np.minimum(hi, 0.0)
    return Interval(lo, hi, exponents, sign)


def _without_zero(x: Interval) -> Interval:
    """Return the element, NaN where there may be a 0 inside; the edge is taken for a limit."""
    if x.sign:
        return x
    lo = np.where((x.lo > 0.0) | (x.hi < 0.0), x.lo, np.nan)
    return Interval(lo, x.hi, x.exponents, 0)


def _product(x: Interval, y: Interval) -> Bounds:
    """Return the bounds of the product, not rounded outwards."""
    if x.sign < 0 and y.sign:
        lo, hi = _product(Interval(-x.hi, -x.lo, x.exponents, 1), y)
        return -hi, -lo
    if x.sign > 0 and y.sign > 0:
        return x.lo * y.lo, x.hi * y.hi
    if x.sign > 0 and y.sign < 0:
        return x.hi * y.lo, x.lo * y.hi
    if y.sign and not x.sign:
        return _product(y, x)
    if x.sign > 0:
        return np.minimum(x.lo * y.lo, x.hi * y.lo), np.maximum(x.lo * y.hi, x.hi * y.hi)
    if x.sign < 0:
        return np.minimum(x.lo * y.hi, x.hi * y.hi), np.maximum(x.lo * y.lo, x.hi * y.lo)
    a, b, c, d = x.lo * y.lo, x.lo * y.hi, x.hi * y.lo, x.hi * y.hi
    return np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d))
