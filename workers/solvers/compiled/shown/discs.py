r"""V and its partial derivatives on one disc of the complex plane for each variable, compiled.

A number stands for all z with |z − c| ≤ r; the formulas are those of
:mod:`service.dynamics.formula.algebras.discs`. A radius is NaN where a function may not be analytic. What is
exactly 0 everywhere has c = r = 0, and stays so in products.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import power
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Pair = tuple[float, float]

ARITHMETIC = 2.0**-50
"""More than the relative error of an operation."""
FUNCTIONS = 2.0**-46
"""More than that of a function of the library."""
EXPONENTIALS = 2.0**-40
TINY = 1e-300


@kernel
def rounded(c: float, r: float, error: float) -> Pair:
    """Return the disc with its radius made larger by the rounding of both."""
    return c, (r + error * abs(c)) * (1.0 + 2.0 * error) + TINY


@kernel
def plus(c: float, r: float, d: float, s: float) -> Pair:
    """Return the sum of two discs."""
    if d == 0.0 and s == 0.0:
        return c, r
    if c == 0.0 and r == 0.0:
        return d, s
    return rounded(c + d, r + s, ARITHMETIC)


@kernel
def times(c: float, r: float, d: float, s: float) -> Pair:
    """Return the product of two discs."""
    if (c == 0.0 and r == 0.0) or (d == 0.0 and s == 0.0):
        return 0.0, 0.0
    return rounded(c * d, (abs(c) + r) * s + abs(d) * r, ARITHMETIC)


@kernel
def inverse(c: float, r: float) -> Pair:
    """Return 1/z, NaN where z may be 0."""
    size = abs(c)
    least = (size - r) * (1.0 - ARITHMETIC) - ARITHMETIC * size
    return rounded(1.0 / c, r / (size * least) if least > 0.0 else math.nan, 4.0 * ARITHMETIC)


@kernel
def raised(c: float, r: float, exponent: float) -> Pair:
    """Return the power of a disc to a number that is a double, or next to one."""
    if exponent == 1.0:
        return c, r
    if exponent == 2.0:
        return times(c, r, c, r)
    size = abs(c)
    is_whole = exponent == math.floor(exponent)
    value = power(c, exponent)
    error = FUNCTIONS * (1.0 + abs(exponent))
    if not (is_whole and abs(exponent) <= 64.0):
        error *= 2.0 + abs(math.log(size))
    if is_whole and exponent > 0.0:
        wide = power(size + r, exponent) * (1.0 + error) - abs(value) * (1.0 - error)
        return rounded(value, wide, error)
    if not (is_whole or c > 0.0):
        return value, math.nan
    share = r / size * (1.0 + 4.0 * ARITHMETIC) + TINY
    if not share < 1.0:
        return value, math.nan
    growth = math.log1p(share) if exponent > 1.0 else math.log1p(-share)
    wide = abs(value) * abs(math.expm1(exponent * growth)) * (1.0 + EXPONENTIALS)
    return rounded(value, wide, error)


@kernel
def _logarithm(c: float, r: float) -> Pair:
    share = r / c * (1.0 + 4.0 * ARITHMETIC) + TINY
    if not (c > 0.0 and share < 1.0):
        return math.nan, math.nan
    return rounded(math.log(c), -math.log1p(-share), FUNCTIONS)


@kernel
def _exponential(c: float, r: float) -> Pair:
    value = math.exp(c)
    wide = value * math.expm1(r) if r < 1.0 else math.exp(c + r) * (1.0 + EXPONENTIALS)
    return rounded(value, wide, FUNCTIONS)


@kernel
def _wave(value: float, slope: float, r: float) -> Pair:
    half = math.sinh(0.5 * r)
    wide = 2.0 * abs(value) * half * half + abs(slope) * math.sinh(r)
    # Both are rounded, and so is what they were taken of.
    return rounded(value, wide + FUNCTIONS * r, 4.0 * FUNCTIONS)


@kernel
def _function(operation: int, c: float, r: float) -> tuple[float, float, float, float]:
    """Return a function, numbered as in :mod:`compiled.evaluation.program`, and its derivative."""
    if operation == 8:
        value, wide = _exponential(c, r)
        return value, wide, value, wide
    if operation == 9:
        value, wide = _logarithm(c, r)
        rise, steep = inverse(c, r)
        return value, wide, rise, steep
    if operation >= 13:
        unknown = 0.0 if abs(c) > r else math.nan
        sign = 1.0 if c > 0.0 else -1.0
        if operation == 13:
            return abs(c), r + unknown, sign, unknown
        return sign, unknown, 0.0, unknown
    sine, cosine = math.sin(c), math.cos(c)
    value, wide = _wave(sine, cosine, r)
    other, broad = _wave(cosine, sine, r)
    if operation == 10:
        return value, wide, other, broad
    if operation == 11:
        return other, broad, -value, wide
    rise, steep = inverse(other, broad)
    value, wide = times(value, wide, rise, steep)
    rise, steep = times(value, wide, value, wide)
    rise, steep = plus(1.0, 0.0, rise, steep)
    return value, wide, rise, steep


@kernel
def gradient_on_discs(code: IntArray, constants: FloatArray, c: FloatArray, r: FloatArray) -> None:
    """Fill in the registers, shape (3 + instructions, 4) each: V and its partial derivatives.

    The values of registers 0, 1, 2 are the discs of g1, g2, g3.
    """
    for n in range(3):
        for a in range(1, 4):
            c[n, a], r[n, a] = (1.0 if a == n + 1 else 0.0), 0.0
    for k in range(code.shape[0]):
        operation, i, j, slot, n = code[k, 0], code[k, 1], code[k, 2], code[k, 3], 3 + k
        if operation == 0:
            c[n, :], r[n, :] = 0.0, 0.0
            c[n, 0], r[n, 0] = constants[slot], abs(constants[slot]) * ARITHMETIC
        elif operation == 1 or operation == 2:
            sign = 1.0 if operation == 1 else -1.0
            for a in range(4):
                c[n, a], r[n, a] = plus(c[i, a], r[i, a], sign * c[j, a], r[j, a])
        elif operation == 3:
            for a in range(1, 4):
                first, wide = times(c[i, 0], r[i, 0], c[j, a], r[j, a])
                second, broad = times(c[i, a], r[i, a], c[j, 0], r[j, 0])
                c[n, a], r[n, a] = plus(first, wide, second, broad)
            c[n, 0], r[n, 0] = times(c[i, 0], r[i, 0], c[j, 0], r[j, 0])
        elif operation == 4:
            by, near = inverse(c[j, 0], r[j, 0])
            c[n, 0], r[n, 0] = times(c[i, 0], r[i, 0], by, near)
            for a in range(1, 4):
                less, wide = times(c[n, 0], r[n, 0], c[j, a], r[j, a])
                less, wide = plus(c[i, a], r[i, a], -less, wide)
                c[n, a], r[n, a] = times(less, wide, by, near)
        elif operation == 5:
            for a in range(4):
                c[n, a], r[n, a] = -c[i, a], r[i, a]
        elif operation == 7:
            _general_power(c, r, i, j, n)
        else:
            if operation == 6:
                exponent = constants[slot]
                c[n, 0], r[n, 0] = raised(c[i, 0], r[i, 0], exponent)
                rise, steep = raised(c[i, 0], r[i, 0], exponent - 1.0) if exponent != 1.0 else (1.0, 0.0)
                rise, steep = times(exponent, abs(exponent) * ARITHMETIC, rise, steep)
            else:
                c[n, 0], r[n, 0], rise, steep = _function(operation, c[i, 0], r[i, 0])
            for a in range(1, 4):
                c[n, a], r[n, a] = times(rise, steep, c[i, a], r[i, a])


@kernel
def _general_power(c: FloatArray, r: FloatArray, i: int, j: int, n: int) -> None:
    """x^y = exp(y log x), and its slopes x^y (y' log x + y x'/x)."""
    log, wide = _logarithm(c[i, 0], r[i, 0])
    by, near = inverse(c[i, 0], r[i, 0])
    power_of, broad = times(c[j, 0], r[j, 0], log, wide)
    c[n, 0], r[n, 0] = _exponential(power_of, broad)
    for a in range(1, 4):
        first, far = times(c[j, a], r[j, a], log, wide)
        second, away = times(c[i, a], r[i, a], by, near)
        second, away = times(c[j, 0], r[j, 0], second, away)
        first, far = plus(first, far, second, away)
        c[n, a], r[n, a] = times(c[n, 0], r[n, 0], first, far)
