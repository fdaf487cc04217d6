"""The functions of formulas with three derivatives, and what rounding makes of each."""

import math

from workers.solvers.compiled.kernels import kernel

Three = tuple[float, float, float]
ULPS = 4.0
"""Error of a library's function, in units of 2^-53, with a margin."""


@kernel
def derivatives_of_call(operation: int, x: float) -> tuple[Three, float, Three]:
    """Return (f, f', f''), f''' and the roundings of the first three, in 2^-53, at x.

    The functions are numbered as in :mod:`compiled.evaluation.program`.
    """
    if operation == 8:
        value = math.exp(x)
        own = ULPS * value
        return (value, value, value), value, (own, own, own)
    if operation == 9:
        value, inverse = (math.log(x), 1.0 / x) if x > 0.0 else (math.nan, math.nan)
        square = inverse * inverse
        own = ULPS * abs(value)
        return (value, inverse, -square), 2.0 * square * inverse, (own, abs(inverse), 3.0 * square)
    if operation == 10:
        sine, cosine = math.sin(x), math.cos(x)
        return (sine, cosine, -sine), -cosine, (ULPS, ULPS, ULPS)
    if operation == 11:
        sine, cosine = math.sin(x), math.cos(x)
        return (cosine, -sine, -cosine), sine, (ULPS, ULPS, ULPS)
    if operation == 12:
        value = math.tan(x)
        first = 1.0 + value * value
        second = 2.0 * value * first
        third = 2.0 * first * first + 2.0 * value * second
        own = ULPS * abs(value)
        return (value, first, second), third, (own, 4.0 * ULPS * first, 8.0 * ULPS * abs(second))
    sign = 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0
    if operation == 13:
        return (abs(x), sign, 0.0), 0.0, (0.0, 0.0, 0.0)
    return (sign, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0)
