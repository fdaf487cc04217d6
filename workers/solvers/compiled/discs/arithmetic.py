r"""Arithmetic of discs of the complex plane, compiled.

A number stands for all z with |z − c| ≤ r; the formulas are those of
:mod:`service.dynamics.formula.algebras.discs`. A radius is NaN where a function may not be analytic. What is
exactly 0 everywhere has c = r = 0, and stays so in products.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import (
    CompiledArithmetic,
    Constant,
    double_of,
    get_pair,
    interpreter_of,
    power,
    put_pair,
)
from workers.solvers.compiled.evaluation.program import ABS, COS, EXP, LOG, SIGN, SIN
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
Disc = tuple[float, float]
"""A centre and a radius."""

OPERATION_ERROR = 2.0**-50
"""More than the relative error of an operation."""
FUNCTION_ERROR = 2.0**-48
"""More than that of a function of the library."""
EXPONENTIAL_ERROR = 2.0**-40
"""More than that of the radius of an exponential."""
UNDERFLOW = 1e-300
"""More than operations lose to the smallest doubles."""


@kernel
def rounded(c: float, r: float, error: float) -> Disc:
    """Return the disc with its radius made larger by the rounding of both."""
    return c, (r + error * abs(c)) * (1.0 + 2.0 * error) + UNDERFLOW


@kernel
def exactly(value: float) -> Disc:
    """Return the disc about a number that was rounded."""
    return value, abs(value) * OPERATION_ERROR


@kernel
def plus(x: Disc, y: Disc) -> Disc:
    """Return the sum of two discs."""
    if y[0] == 0.0 and y[1] == 0.0:
        return x
    if x[0] == 0.0 and x[1] == 0.0:
        return y
    return rounded(x[0] + y[0], x[1] + y[1], OPERATION_ERROR)


@kernel
def opposite(x: Disc) -> Disc:
    """Return −z."""
    return -x[0], x[1]


@kernel
def minus(x: Disc, y: Disc) -> Disc:
    """Return the difference of two discs."""
    return plus(x, opposite(y))


@kernel
def times(x: Disc, y: Disc) -> Disc:
    """Return the product of two discs."""
    if (x[0] == 0.0 and x[1] == 0.0) or (y[0] == 0.0 and y[1] == 0.0):
        return 0.0, 0.0
    return rounded(x[0] * y[0], (abs(x[0]) + x[1]) * y[1] + abs(y[0]) * x[1], OPERATION_ERROR)


@kernel
def over(x: Disc, y: Disc) -> Disc:
    """Return the quotient of two discs, NaN where y may be 0."""
    size = abs(y[0])
    least = (size - y[1]) * (1.0 - OPERATION_ERROR) - OPERATION_ERROR * size
    wide = y[1] / (size * least) if least > 0.0 else math.nan
    return times(x, rounded(1.0 / y[0], wide, 4.0 * OPERATION_ERROR))


@kernel
def raised(x: Disc, exponent: Disc) -> Disc:
    """Return the power of a disc to a number that is a double, or next to one."""
    (c, r), (e, _) = x, exponent
    size = abs(c)
    is_whole = e == math.floor(e)
    value = power(c, e)
    error = FUNCTION_ERROR * (1.0 + abs(e)) * (2.0 + abs(math.log(size)))
    if is_whole and e > 0.0:
        wide = power(size + r, e) * (1.0 + error) - abs(value) * (1.0 - error)
        return rounded(value, wide, error)
    if not (is_whole or c > 0.0):
        return value, math.nan
    share = r / size * (1.0 + 4.0 * OPERATION_ERROR) + UNDERFLOW
    if not share < 1.0:
        return value, math.nan
    growth = math.log1p(share) if e > 1.0 else math.log1p(-share)
    wide = abs(value) * abs(math.expm1(e * growth)) * (1.0 + EXPONENTIAL_ERROR)
    return rounded(value, wide, error)


@kernel
def _wave(value: float, slope: float, r: float) -> Disc:
    half = math.sinh(0.5 * r)
    wide = 2.0 * abs(value) * half * half + abs(slope) * math.sinh(r)
    # Both are rounded, and so is what they were taken of.
    return rounded(value, wide + FUNCTION_ERROR * r, 4.0 * FUNCTION_ERROR)


@kernel
def function_of(operation: int, x: Disc) -> Disc:
    """Return a function, numbered as in :mod:`compiled.evaluation.program`."""
    c, r = x
    if operation == EXP:
        value = math.exp(c)
        wide = value * math.expm1(r) if r < 1.0 else math.exp(c + r) * (1.0 + EXPONENTIAL_ERROR)
        return rounded(value, wide, FUNCTION_ERROR)
    if operation == LOG:
        share = r / c * (1.0 + 4.0 * OPERATION_ERROR) + UNDERFLOW
        if not (c > 0.0 and share < 1.0):
            return math.nan, math.nan
        return rounded(math.log(c), -math.log1p(-share), FUNCTION_ERROR)
    if operation in (ABS, SIGN):
        unknown = 0.0 if abs(c) > r else math.nan
        return (abs(c), r + unknown) if operation == ABS else (1.0 if c > 0.0 else -1.0, unknown)
    sine, cosine = math.sin(c), math.cos(c)
    if operation == SIN:
        return _wave(sine, cosine, r)
    if operation == COS:
        return _wave(cosine, sine, r)
    return over(_wave(sine, cosine, r), _wave(cosine, sine, r))


@kernel
def disc_of(constant: Constant) -> Disc:
    """Return the disc of a constant; integers are exact."""
    value = double_of(constant)
    known = abs(constant.constants[constant.slot]) + abs(value) if constant.slot >= 0 else 0.0
    return value, known * OPERATION_ERROR


run_discs = interpreter_of(
    CompiledArithmetic(
        get_pair, put_pair, disc_of, plus, times, over, opposite, raised, function_of, inverts_first=True
    ),
    __name__,
    "run_discs",
)
