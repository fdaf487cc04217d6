"""Arithmetic on numbers of twice the digits that carry a bound of their error.

The bounds are those of :mod:`compiled.doubled.arithmetic`, with room: a sum, product, quotient or root is off
by less than ``OPERATION_ERROR`` of itself, a function by less than ``FUNCTION_ERROR`` of itself and of its
argument, which is reduced. Bounds are rounded to nearest: whoever uses one doubles it.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.arithmetic import UNDERFLOW
from workers.solvers.compiled.doubled.arithmetic import (
    add,
    divide,
    exponential,
    logarithm,
    multiply,
    root,
    sine_and_cosine,
)
from workers.solvers.compiled.evaluation.interpreter import (
    CompiledArithmetic,
    Constant,
    get_triple,
    interpreter_of,
    put_triple,
)
from workers.solvers.compiled.evaluation.program import ABS, COS, EXP, LOG, SIGN, SIN
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
Known = tuple[float, float, float]
"""A double, the rest, and how far the number may be from their sum: inf or NaN where it is not known."""

OPERATION_ERROR: Final = 2.0**-100
FUNCTION_ERROR: Final = 2.0**-94
_LARGEST_ANGLE: Final = 1e5
_CONSTANT_ERROR: Final = 2.0**-104
"""Relative error of a constant whose low part is rounded too."""

UNKNOWN: Known = (0.0, 0.0, math.inf)


@kernel
def constant(high: float, low: float) -> Known:
    """Return a constant by its double and the double of the rest."""
    is_exact = low == 0.0 and (high == 0.0 or abs(high) > UNDERFLOW)
    return high, low, 0.0 if is_exact else _CONSTANT_ERROR * abs(high) + UNDERFLOW


@kernel
def plus(x: Known, y: Known) -> Known:
    """Return x + y."""
    high, low = add((x[0], x[1]), (y[0], y[1]))
    return high, low, x[2] + y[2] + OPERATION_ERROR * abs(high)


@kernel
def minus(x: Known, y: Known) -> Known:
    """Return x − y."""
    return plus(x, (-y[0], -y[1], y[2]))


@kernel
def times(x: Known, y: Known) -> Known:
    """Return x y."""
    high, low = multiply((x[0], x[1]), (y[0], y[1]))
    error = abs(x[0]) * y[2] + abs(y[0]) * x[2] + x[2] * y[2]
    return high, low, error + OPERATION_ERROR * abs(high) + UNDERFLOW


@kernel
def over(x: Known, y: Known) -> Known:
    """Return x/y; x'/y' − x/y = ((x' − x) − (y' − y) x/y)/y'."""
    least = abs(y[0]) - y[2]
    if not least > 0.0:
        return UNKNOWN
    high, low = divide((x[0], x[1]), (y[0], y[1]))
    return high, low, (x[2] + abs(high) * y[2]) / least + OPERATION_ERROR * abs(high) + UNDERFLOW


@kernel
def square_root(x: Known) -> Known:
    """Return √x of what is certainly positive."""
    if not x[0] - x[2] > UNDERFLOW:
        return UNKNOWN
    high, low = root((x[0], x[1]))
    return high, low, x[2] / high + OPERATION_ERROR * high


@kernel
def exponential_of(x: Known) -> Known:
    """Return e^x."""
    high, low = exponential((x[0], x[1]))
    if not x[2] < 0.5:
        return UNKNOWN
    return high, low, high * (2.0 * x[2] + FUNCTION_ERROR * (1.0 + abs(x[0]))) + UNDERFLOW


@kernel
def logarithm_of(x: Known) -> Known:
    """Return log x of what is certainly positive."""
    least = x[0] - x[2]
    if not least > UNDERFLOW:
        return UNKNOWN
    high, low = logarithm((x[0], x[1]))
    return high, low, x[2] / least + FUNCTION_ERROR * (1.0 + abs(high))


@kernel
def power(x: Known, exponent: Known) -> Known:
    """Return x^exponent, no whole one, of what is certainly positive."""
    if exponent[2] == 0.0 and exponent[1] == 0.0 and abs(exponent[0]) == 0.5:
        found = square_root(x)
        return over((1.0, 0.0, 0.0), found) if exponent[0] < 0.0 else found
    return exponential_of(times(exponent, logarithm_of(x)))


@kernel
def function(operation: int, x: Known) -> Known:
    """Return a function of x, numbered as in :mod:`.program`."""
    if operation == EXP:
        return exponential_of(x)
    if operation == LOG:
        return logarithm_of(x)
    if operation in (ABS, SIGN):
        if not abs(x[0]) > x[2]:
            return UNKNOWN
        sign = 1.0 if x[0] > 0.0 else -1.0
        return (sign * x[0], sign * x[1], x[2]) if operation == ABS else (sign, 0.0, 0.0)
    if not abs(x[0]) <= _LARGEST_ANGLE:
        return UNKNOWN
    s, c = sine_and_cosine((x[0], x[1]))
    error = x[2] + FUNCTION_ERROR * (1.0 + abs(x[0]))
    if operation == SIN:
        return s[0], s[1], error
    if operation == COS:
        return c[0], c[1], error
    return over((s[0], s[1], error), (c[0], c[1], error))


@kernel
def _number(of: Constant) -> Known:
    constants, lows, slot, more = of
    if slot < 0:
        return float(more), 0.0, 0.0
    known = constant(constants[slot], lows[slot])
    return known if more == 0 else plus(known, (float(more), 0.0, 0.0))


@kernel
def _opposite(x: Known) -> Known:
    return -x[0], -x[1], x[2]


run_known = interpreter_of(
    CompiledArithmetic(get_triple, put_triple, _number, plus, times, over, _opposite, power, function),
    __name__,
    "run_known",
)


@kernel
def nearest(x: Known) -> float:
    """Return the double nearest to a number, NaN if its error leaves two of them.

    The number itself and all others within twice the error round to it: also the middle of a ball of more
    digits that encloses it.
    """
    error = 2.0 * x[2]
    high = x[0] + x[1]
    rest = x[1] - (high - x[0])
    return high if high + (rest - error) == high == high + (rest + error) else math.nan
