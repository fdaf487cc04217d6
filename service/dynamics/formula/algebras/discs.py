r"""Discs of the complex plane with real centres, rounded outwards: bounds around stretches of the real line.

An element is the set of complex numbers z with |z − c| ≤ r, and the operations for functions that are
analytic on the discs they are given. With t = r/|c|, all from power series with their signs dropped:

.. math::
    (c, r) + (c', r') = (c + c', r + r'), \qquad (c, r)(c', r') = (cc', |c|r' + |c'|r + rr'), \\
    \frac{(c, r)}{(c', r')} = \Bigl(\frac{c}{c'}, \frac{r + |c/c'|\,r'}{|c'| - r'}\Bigr), \qquad
    e^{(c, r)} = (e^c, e^c(e^r - 1)), \qquad \log(c, r) = (\log c, -\log(1-t)), \\
    (c, r)^a = (c^a, |c|^a\,|(1 \pm t)^a - 1|), \quad + \text{ for } a \ge 1, - \text{ for } a < 1, \\
    \sin(c, r) = (\sin c, |\sin c|(\cosh r - 1) + |\cos c|\sinh r) .
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebra import DerivedOperations
from service.dynamics.formula.algebras.intervals import (
    FUNCTION_ROUNDING,
    OPERATION_ROUNDING,
    power_error,
    real_power,
)
from service.dynamics.formula.algebras.real import nearest_double

FloatArray = NDArray[np.float64]

ABSOLUTE_ROUNDING = 1e-300
"""More than any error of a result next to 0. Far from the smallest doubles, which cost a hundredfold."""
EXP_RELATIVE_ROUNDING = 2.0**-41
"""More than the relative error of exp(x) with a rounded x, which is at most 746 where exp is not 0 or ∞."""


@dataclass(frozen=True, slots=True)
class Disc:
    """|z − centre| ≤ radius, two arrays that broadcast; nothing is known where either is not finite."""

    centre: FloatArray
    radius: FloatArray


class DiscAlgebra(DerivedOperations[Disc]):
    """Arrays of discs. Where a function may not be analytic the radius is NaN, which no comparison takes.

    The caller switches numpy's warnings off: doing so at each operation would take half of the time.
    """

    def bound(self, element: Disc) -> FloatArray:
        """Return what no |z| of the disc exceeds; NaN or ∞ where nothing is known."""
        size: FloatArray = (np.abs(element.centre) + element.radius) * (1.0 + OPERATION_ROUNDING)
        return size

    def constant(self, value: Fraction) -> Disc:
        """Return the number: its radius is 0 if it is a double."""
        double = np.asarray(nearest_double(value))
        if np.isfinite(double) and Fraction(float(double)) == value:
            return Disc(double, np.zeros(()))
        return _rounded(double, np.zeros(()), OPERATION_ROUNDING)

    def pi(self) -> Disc:
        """Return π."""
        return _rounded(np.asarray(np.pi), np.zeros(()), OPERATION_ROUNDING)

    def add(self, left: Disc, right: Disc) -> Disc:
        """Return left + right."""
        return _rounded(left.centre + right.centre, left.radius + right.radius, OPERATION_ROUNDING)

    def subtract(self, left: Disc, right: Disc) -> Disc:
        """Return left - right."""
        return _rounded(left.centre - right.centre, left.radius + right.radius, OPERATION_ROUNDING)

    def multiply(self, left: Disc, right: Disc) -> Disc:
        """Return left · right."""
        size = np.abs(left.centre) + left.radius
        radius = size * right.radius + np.abs(right.centre) * left.radius
        return _rounded(left.centre * right.centre, radius, OPERATION_ROUNDING)

    def divide(self, left: Disc, right: Disc) -> Disc:
        """Return left / right, NaN where right may be 0."""
        centre = left.centre / right.centre
        least = _distance_to_0(right)
        return _rounded(centre, (left.radius + np.abs(centre) * right.radius) / least, OPERATION_ROUNDING)

    def negate(self, operand: Disc) -> Disc:
        """Return -operand."""
        return Disc(-operand.centre, operand.radius)

    def power(self, base: Disc, exponent: Fraction) -> Disc:
        """Return base^exponent; with a fraction no z of the base may have a real part ≤ 0."""
        if exponent == 2:
            return self.multiply(base, base)
        size = np.abs(base.centre)
        if exponent.denominator == 1:
            centre = real_power(size, exponent) if exponent > 0 else 1.0 / real_power(size, -exponent)
            centre = np.copysign(centre, base.centre) if exponent.numerator % 2 else centre
        else:
            centre = real_power(np.where(base.centre > 0.0, size, np.nan), exponent)
        error = 4.0 * power_error(exponent)
        if exponent.denominator == 1 and exponent > 0:
            # Also where 0 is inside; what cancels is no more than the rounding that is added.
            farthest = real_power(size + base.radius, exponent) * (1.0 + error)
            return _rounded(centre, farthest - np.abs(centre) * (1.0 - error), error)
        share = _share(base)
        growth = np.log1p(share) if exponent > 1 else np.log1p(-share)
        radius = np.abs(centre) * np.abs(np.expm1(nearest_double(exponent) * growth))
        return _rounded(centre, radius * (1.0 + EXP_RELATIVE_ROUNDING), error)

    def call(self, name: str, argument: Disc) -> Disc:
        """Return the function; abs is ±z where no z has the real part 0, and sign its derivative."""
        centre, radius = argument.centre, argument.radius
        if name == "exp":
            return _exponential(centre, radius)
        if name == "log":
            share = np.where(centre > 0.0, _share(argument), np.nan)
            return _rounded(np.log(np.abs(centre)), -np.log1p(-share), FUNCTION_ROUNDING)
        if name == "tan":
            return self.divide(self.call("sin", argument), self.call("cos", argument))
        if name == "abs":
            return Disc(np.abs(centre), np.where(np.abs(centre) > radius, radius, np.nan))
        if name == "sign":
            return Disc(np.sign(centre), np.where(np.abs(centre) > radius, 0.0, np.nan))
        half, sine, cosine = np.sinh(0.5 * radius), np.sin(centre), np.cos(centre)
        value, slope = (sine, cosine) if name == "sin" else (cosine, sine)
        return _rounded(
            value,
            2.0 * np.abs(value) * half * half + np.abs(slope) * np.sinh(radius),
            4.0 * FUNCTION_ROUNDING,
        )


def _rounded(centre: FloatArray, radius: FloatArray, error: float) -> Disc:
    """Return the disc with its radius made larger by what rounding did, ``error`` relative, to both."""
    return Disc(centre, (radius + error * np.abs(centre)) * (1.0 + 2.0 * error) + ABSOLUTE_ROUNDING)


def _distance_to_0(disc: Disc) -> FloatArray:
    """Return the least |z| of the disc, NaN where that is 0."""
    least = (np.abs(disc.centre) - disc.radius) * (1.0 - OPERATION_ROUNDING)
    return np.where(least > 0.0, least, np.nan)


def _share(disc: Disc) -> FloatArray:
    """Return r/|c| rounded up, NaN unless below 1."""
    share = disc.radius / np.abs(disc.centre) * (1.0 + OPERATION_ROUNDING) + ABSOLUTE_ROUNDING
    return np.where(share < 1.0, share, np.nan)


def _exponential(centre: FloatArray, radius: FloatArray) -> Disc:
    value = np.exp(centre)
    # Where exp(c) is rounded to 0 or its radius beyond 1, the two are taken together.
    wide = np.exp(centre + radius) * (1.0 + EXP_RELATIVE_ROUNDING)
    return _rounded(value, np.where(radius < 1.0, value * np.expm1(radius), wide), FUNCTION_ROUNDING)
