r"""Arithmetic of discs with real centres, compiled: bounds of functions on whole stretches and around them.

A row, one register of a program, stands for a function on each of several stretches, the lanes: beside
the power ``e`` of a positive scale s that the row has everywhere, it is within ``r`` of ``c``. On a disc of
the complex plane this holds at every point, and ``c`` is the value at the centre. The scale is a disc too, or
all of 0 < s ≤ 2c where it reaches down to 0. What is not analytic on a disc has NaN, which passes no
comparison. Radii are rounded outwards.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import (
    Constant,
    RowArithmetic,
    double_of,
    interpreter,
    power,
)
from workers.solvers.compiled.evaluation.program import ABS, EXP, LOG, SIGN, SIN, TAN
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Discs
from workers.solvers.compiled.workspace import LANES

FloatArray = NDArray[np.float64]

SCALE = -1
"""The row of s itself: the last one."""
POWERS = 6
"""Rows before it that keep powers of s."""
SUMMAND, ARGUMENT, INVERSE = -POWERS - 2, -POWERS - 3, -POWERS - 4
"""Rows before those, for scratch."""
OWN = 1 + POWERS + 3
"""Rows beside the registers."""
OUTWARDS = 2.0**-50
"""Four roundings and more, relatively."""
ROUNDED = 2.0**-52
"""More than the rounding of a constant."""
FUNCTIONS = 2.0**-48
"""Relative error of a function of the library."""
TINY = 1e-300
"""More than all that is lost where numbers are about to vanish."""
SAME_POWER = 1e-12
"""Powers that are rounded sums of the same fractions differ by less."""


@kernel
def new_discs(registers: int) -> Discs:
    """Return so many rows, and those that the arithmetic has for itself."""
    count = registers + OWN
    return Discs(np.ones((count, LANES)), np.zeros((count, LANES)), np.zeros(count))


@kernel
def forget_powers(discs: Discs) -> None:
    """Begin with another scale."""
    for k in range(POWERS):
        discs.powers[SCALE - 1 - k] = 0.0


@kernel
def number(discs: Discs, to: int, constant: Constant, _count: int) -> None:
    """Put a constant into a row; integers are exact."""
    c, r, e = discs
    value = double_of(constant)
    known = abs(constant.constants[constant.slot]) + abs(value) if constant.slot >= 0 else 0.0
    for m in range(LANES):
        c[to, m], r[to, m] = value, known * ROUNDED
    e[to] = 0.0 if constant.slot >= 0 or value != 0.0 else math.nan


@inlined
def copy(discs: Discs, to: int, i: int, _count: int) -> None:
    """Put a row into another."""
    c, r, e = discs
    for m in range(LANES):
        c[to, m], r[to, m] = c[i, m], r[i, m]
    e[to] = e[i]


@inlined
def negate(discs: Discs, to: int, i: int, _count: int) -> None:
    """Put the opposite of a row into another."""
    c, r, e = discs
    for m in range(LANES):
        c[to, m], r[to, m] = -c[i, m], r[i, m]
    e[to] = e[i]


@inlined
def multiply(discs: Discs, to: int, i: int, j: int, _count: int) -> None:
    """Put the product of two rows into a third."""
    c, r, e = discs
    for m in range(LANES):
        x, y, rx, ry = c[i, m], c[j, m], r[i, m], r[j, m]
        z = x * y
        wide = abs(x) * ry + (abs(y) + ry) * rx
        c[to, m], r[to, m] = z, wide * (1.0 + OUTWARDS) + abs(z) * OUTWARDS + TINY
    e[to] = e[i] + e[j]


@kernel
def scale_power(discs: Discs, exponent: float, count: int) -> int:
    """Return the row that has s to a positive ``exponent``."""
    c, r, e = discs
    first, last = len(e) + SCALE - 1, len(e) + SCALE - POWERS
    free = first
    while free >= last and e[free] != 0.0:
        if e[free] == exponent:
            return free
        free -= 1
    free = max(free, last)
    if exponent == 2.0:
        for m in range(LANES):
            x, rx = c[SCALE, m], r[SCALE, m]
            c[free, m] = x * x
            r[free, m] = (2.0 * x + rx) * rx * (1.0 + OUTWARDS) + x * x * OUTWARDS + TINY
        e[free] = 2.0
        return free
    is_whole = exponent == math.floor(exponent)
    for m in range(count):
        x, rx = c[SCALE, m], r[SCALE, m]
        z = power(x, exponent)
        wide = power(x + rx, exponent) - z if exponent >= 1.0 else z - power(max(x - rx, 0.0), exponent)
        rounding = FUNCTIONS + exponent * OUTWARDS
        if not (is_whole and exponent <= 64.0):
            rounding += exponent * OUTWARDS * abs(math.log(x))
        wide += (z + wide) * rounding + TINY
        # Branches meet at s = 0.
        c[free, m], r[free, m] = z, (wide if is_whole or rx <= x else math.nan)
    e[free] = exponent
    return free


@inlined
def add(discs: Discs, to: int, i: int, j: int, count: int) -> None:
    """Put the sum of two rows into a third, beside the lower of their powers."""
    _add(discs, to, i, j, 1.0, count)


@inlined
def subtract(discs: Discs, to: int, i: int, j: int, count: int) -> None:
    """Put the difference of two rows into a third, in the same way."""
    _add(discs, to, i, j, -1.0, count)


@kernel
def _add(discs: Discs, to: int, i: int, j: int, sign: float, count: int) -> None:
    c, r, e = discs
    if math.isnan(e[j]) or math.isnan(e[i]):
        k, factor = (j, sign) if math.isnan(e[i]) else (i, 1.0)
        for m in range(LANES):
            c[to, m], r[to, m] = factor * c[k, m], r[k, m]
        e[to] = e[k]
        return
    low = min(e[i], e[j])
    if e[i] - low > SAME_POWER:
        i = _beside(discs, SUMMAND, i, low, count)
    if e[j] - low > SAME_POWER:
        j = _beside(discs, SUMMAND, j, low, count)
    for m in range(LANES):
        z = c[i, m] + sign * c[j, m]
        c[to, m], r[to, m] = z, (r[i, m] + r[j, m]) * (1.0 + OUTWARDS) + abs(z) * OUTWARDS + TINY
    e[to] = low


@kernel
def _beside(discs: Discs, to: int, i: int, low: float, count: int) -> int:
    """Put a row beside a lower power of the scale; return where it is."""
    k = scale_power(discs, discs.powers[i] - low, count)
    multiply(discs, to, i, k, count)
    discs.powers[to] = low
    return to


@kernel
def collapse(discs: Discs, to: int, i: int, count: int) -> None:
    """Put a row without any power of the scale into another; NaN where a negative one diverges."""
    e = discs.powers
    if abs(e[i]) <= SAME_POWER:
        copy(discs, to, i, count)
    elif e[i] > 0.0:
        _beside(discs, to, i, 0.0, count)
    else:
        divide(discs, to, i, scale_power(discs, -e[i], count), count)
    e[to] = 0.0


@inlined
def divide(discs: Discs, to: int, i: int, j: int, count: int) -> None:
    """Put the quotient of two rows into a third."""
    _invert(discs, INVERSE, j)
    multiply(discs, to, i, INVERSE, count)


@inlined
def _invert(discs: Discs, to: int, i: int) -> None:
    c, r, e = discs
    for m in range(LANES):
        size, rx = abs(c[i, m]), r[i, m]
        z = 1.0 / c[i, m]
        wide = rx / (size * (size - rx)) * (1.0 + OUTWARDS) + abs(z) * OUTWARDS + TINY
        # Far from being halved by the rounding of size − rx.
        c[to, m], r[to, m] = z, (wide if size > rx * (1.0 + 2.0**-40) else math.nan)
    e[to] = -e[i]


@inlined
def is_even(exponent: float) -> bool:
    """Say whether s to this power has one sign on both sides of s = 0, and is analytic there."""
    return 0.5 * exponent == math.floor(0.5 * exponent)


@kernel
def raise_to(discs: Discs, to: int, i: int, constant: Constant, count: int) -> None:
    """Put the power of a row to a constant into another."""
    c, r, e = discs
    exponent = double_of(constant)
    is_whole = exponent == math.floor(exponent)
    for m in range(count):
        x, rx = c[i, m], r[i, m]
        size, z = abs(x), power(x, exponent)
        is_analytic = size > rx * (1.0 + 2.0**-40) and (is_whole or x > 0.0)
        if exponent >= 1.0:
            # Of (1 + t)^a − 1 the derivative is a (1 + t)^(a − 1), largest at t = r/|c|.
            wide = power(size + rx, exponent) - abs(z)
            is_analytic = is_analytic or is_whole
        elif exponent > 0.0:
            wide = abs(z) - power(size - rx, exponent)
        else:
            wide = power(size - rx, exponent) - abs(z)
        rounding = FUNCTIONS + (1.0 + abs(exponent)) * OUTWARDS
        if not (is_whole and abs(exponent) <= 64.0):
            rounding *= 2.0 + abs(math.log(size))
        c[to, m] = z
        r[to, m] = wide + (2.0 * abs(z) + wide) * rounding + TINY if is_analytic else math.nan
        if not (is_whole or is_even(exponent * e[i]) or r[SCALE, m] <= c[SCALE, m]):
            r[to, m] = math.nan
    e[to] = exponent * e[i]


@kernel
def function(discs: Discs, to: int, i: int, operation: int, count: int) -> None:
    """Put a function, numbered as in :mod:`compiled.evaluation.program`, into a row."""
    c, r, e = discs
    if operation in (ABS, SIGN):
        _sign_or_size(discs, to, i, operation, count)
        return
    if operation == LOG:
        _logarithm(discs, to, i, count)
        return
    collapse(discs, ARGUMENT, i, count)
    e[to] = 0.0
    for m in range(count):
        x, rx = c[ARGUMENT, m], r[ARGUMENT, m]
        if operation == EXP:
            z = math.exp(x)
            wide = z * math.expm1(rx)
            c[to, m], r[to, m] = z, wide + (z + wide) * FUNCTIONS + TINY
            continue
        sine, cosine = math.sin(x), math.cos(x)
        if operation == TAN:
            # tan(x + d) − tan x = tan d (1 + tan² x)/(1 − tan x tan d), |tan d| ≤ tan |d|.
            z, t = sine / cosine, math.tan(rx) if rx < 1.5 else math.inf
            wide = t * (1.0 + z * z) / (1.0 - abs(z) * t)
            wide = wide * (1.0 + 2.0**-30) + (1.0 + z * z) * FUNCTIONS
            c[to, m], r[to, m] = z, wide if abs(z) * t < 1.0 - 2.0**-20 else math.nan
            continue
        value, other = (sine, cosine) if operation == SIN else (cosine, sine)
        grown, odd = math.cosh(rx) - 1.0, math.sinh(rx)
        # cosh r − 1 has the rounding of 1.
        c[to, m] = value
        r[to, m] = abs(value) * grown + abs(other) * odd + (grown + odd + 1.0) * FUNCTIONS


@kernel
def _sign_or_size(discs: Discs, to: int, i: int, operation: int, count: int) -> None:
    c, r, e = discs
    for m in range(count):
        x, rx = c[i, m], r[i, m]
        is_known = abs(x) > rx and (is_even(e[i]) or r[SCALE, m] <= c[SCALE, m])
        wide = 0.0 if is_known else math.nan
        if operation == ABS:
            c[to, m], r[to, m] = abs(x), rx + wide
        else:
            c[to, m], r[to, m] = (1.0 if x > 0.0 else -1.0), wide
    e[to] = e[i] if operation == ABS else 0.0


@kernel
def _logarithm(discs: Discs, to: int, i: int, count: int) -> None:
    """Log (c s^e) is log c + e log s."""
    c, r, e = discs
    for m in range(count):
        x, rx, s, rs = c[i, m], r[i, m], c[SCALE, m], r[SCALE, m]
        z = math.log(x)
        wide = -math.log1p(-rx / x)
        if e[i] != 0.0:
            z += e[i] * math.log(s)
            wide -= abs(e[i]) * math.log1p(-rs / s)
            if not s > rs:
                wide = math.nan
        wide += (abs(z) + wide + 1.0 + abs(e[i] * math.log(s))) * FUNCTIONS
        c[to, m], r[to, m] = z, (wide if x > rx * (1.0 + 2.0**-40) else math.nan)
    e[to] = 0.0


run_rows = interpreter(
    RowArithmetic(
        number, copy, add, subtract, multiply, divide, negate, raise_to, function, inverts_first=True
    ),
    __name__,
    "run_rows",
)
