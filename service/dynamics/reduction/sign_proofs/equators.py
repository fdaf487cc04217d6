"""Bounds Z and G where loops cross the equator, for single λ and for stretches of λ."""

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.interval_bounds import Bounds, power_error, real_power, widened
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Loops, Scaled, Shape

FloatArray = NDArray[np.float64]


def equators(alpha: Fraction | FloatArray, low: FloatArray, high: FloatArray) -> tuple[Bounds, Bounds]:
    """Return bounds of Z and G for every λ (primed) with ``low`` ≤ log λ ≤ ``high``; NaN if not found.

    α is the same for all, or there is the double nearest to that of each.
    F(u) = e^{2u} + e^{2α(u − log λ)} − 1 grows with u = log Z: its signs on both sides of a zero
    that Newton's steps found enclose it.
    """
    (z_low, g_high), (z_high, g_low) = _equator(alpha, low), _equator(alpha, high)
    return (z_low[0], z_high[1]), (g_low[0], g_high[1])


def loops_of_stretches(shape: Shape, low: FloatArray, high: FloatArray, *, is_inverse: bool) -> Loops:
    """Return the loops of all primed λ with ``low`` < k < ``high`` ≤ 1, k being λ, or 1/λ if ``is_inverse``.

    Where λ → 0, Z is like λ and G → 1; where λ → ∞, G is like λ^-α and Z → 1. The lower end may be 0.
    """
    with np.errstate(divide="ignore"):
        error = 2.0**-50 * (1.0 + np.abs(np.log(high)))
        logarithms = np.log(np.where(low > 0.0, low, high)), np.log(high)
    first, last = logarithms[0] - error - 2.0**-50 * np.abs(logarithms[0]), logarithms[1] + error
    Z, G = equators(shape.alpha, -last, -first) if is_inverse else equators(shape.alpha, first, last)
    at_end = low == 0.0
    if is_inverse:
        Z, G = (Z[0], np.where(at_end, 1.0, Z[1])), (np.where(at_end, 0.0, G[0]), G[1])
        coefficients = _powers(Z, shape.alpha)
        scaled = Scaled((low, high), Z, coefficients, Fraction(0), shape.alpha)
    else:
        Z, G = (np.where(at_end, 0.0, Z[0]), Z[1]), (G[0], np.where(at_end, 1.0, G[1]))
        coefficients = _powers(G, 1 / shape.alpha)
        scaled = Scaled((low, high), coefficients, G, Fraction(1), Fraction(0))
    return Loops(shape, Z, G, scaled=scaled)


def _powers(bounds: Bounds, exponent: Fraction) -> Bounds:
    """Return bounds of a power of a number between 0 and 1."""
    low, high = real_power(bounds[0], exponent), real_power(bounds[1], exponent)
    low, high = widened(low, high, power_error(exponent))
    return np.maximum(low, 0.0), np.minimum(high, 1.0)


def _equator(alpha: Fraction | FloatArray, logarithm: FloatArray) -> tuple[Bounds, Bounds]:
    """Return bounds of Z and of G for one λ each."""
    a = float(alpha) if isinstance(alpha, Fraction) else alpha
    with np.errstate(all="ignore"):
        u = np.minimum(0.0, logarithm)
        for _ in range(100):
            first, second = np.exp(2.0 * u), np.exp(2.0 * a * (u - logarithm))
            step = (first + second - 1.0) / (2.0 * first + 2.0 * a * second)
            u = u - step
            if np.all(~(np.abs(step) > 1e-15 * np.maximum(1.0, np.abs(u)))):
                break
        first, second = np.exp(2.0 * u), np.exp(2.0 * a * (u - logarithm))
        # Errors of the exponents: those of their parts, relative 2^-51, and one of e^x itself.
        one = 2.0**-49 * (1.0 + np.abs(u))
        two = 2.0**-49 * (1.0 + 2.0 * a * (np.abs(u) + np.abs(logarithm)))
        slope = 2.0 * first + 2.0 * a * second
        radius = 8.0 * (first * one + second * two + 2.0**-50) / slope + 2.0**-50 * np.abs(u)
        below, above = _defect(a, u - radius, logarithm, 1.0), _defect(a, u + radius, logarithm, -1.0)
        is_proved = (below < 0.0) & (above > 0.0)
        spread = radius + one
        Z = np.exp(u) * np.exp(-spread), np.minimum(np.exp(u) * np.exp(spread), 1.0)
        spread = a * radius + two
        size = np.exp(a * (u - logarithm))
        G = size * np.exp(-spread), np.minimum(size * np.exp(spread), 1.0)
    unknown = np.where(is_proved, 0.0, np.nan)
    return (Z[0] + unknown, Z[1] + unknown), (G[0] + unknown, G[1] + unknown)


def _defect(alpha: float | FloatArray, u: FloatArray, logarithm: FloatArray, side: float) -> FloatArray:
    """Return an upper (side 1) or lower (-1) bound of e^{2u} + e^{2α(u − log λ)} − 1."""
    one = 2.0**-49 * (1.0 + np.abs(u))
    two = 2.0**-49 * (1.0 + 2.0 * alpha * (np.abs(u) + np.abs(logarithm)))
    found: FloatArray = (
        np.exp(2.0 * u) * (1.0 + side * one)
        + np.exp(2.0 * alpha * (u - logarithm)) * (1.0 + side * two)
        - 1.0
        + side * 2.0**-50
    )
    return found
