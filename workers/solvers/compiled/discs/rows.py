r"""Arithmetic of discs with real centres, compiled: bounds of functions on whole stretches and around them.

A row, one register of a program, stands for a function on each of several stretches, the lanes: beside
the power ``e`` of a positive scale s that the row has everywhere, it is within ``r`` of ``c``. On a disc of
the complex plane this holds at every point, and ``c`` is the value at the centre. The scale is a disc too, or
all of 0 < s ≤ 2c where it reaches down to 0. What is not analytic on a disc has NaN, which passes no
comparison. Radii are rounded outwards.

So g1, g2, g3 and D are bounded on discs around places of the loop, and on intervals that begin at a pole.
"""

import math

import numpy as np

from workers.solvers.compiled.discs.arithmetic import (
    FUNCTION_ERROR,
    OPERATION_ERROR,
    UNDERFLOW,
    Disc,
    disc_of,
    exactly,
    function_of,
    plus,
    raised,
    times,
)
from workers.solvers.compiled.evaluation.interpreter import (
    COPY,
    Constant,
    RowArithmetic,
    double_of,
    interpreter,
    power,
)
from workers.solvers.compiled.evaluation.program import ABS, LOG, NEGATE, SIGN
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Discs, Formula, Loop
from workers.solvers.compiled.workspace import LANES, DiscWorkspace

SCALE = -1
"""The row of s itself: the last one."""
POWERS = 6
"""Rows before it that keep powers of s."""
SUMMAND, ARGUMENT, INVERSE = -POWERS - 2, -POWERS - 3, -POWERS - 4
"""Rows before those, for scratch."""
SCRATCH_ROWS = 1 + POWERS + 3
"""Rows beside the registers."""
SAME_POWER = 1e-12
"""Powers that are rounded sums of the same fractions differ by less."""
EQUATOR_ERROR = 2.0**-47
"""Relative error of Z and G, which are solved for in doubles."""


@kernel
def new_discs(registers: int) -> Discs:
    """Return so many rows, and those that the arithmetic has for itself."""
    count = registers + SCRATCH_ROWS
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
    value, wide = disc_of(constant)
    for m in range(LANES):
        c[to, m], r[to, m] = value, wide
    e[to] = 0.0 if constant.slot >= 0 or value != 0.0 else math.nan


@inlined
def _put(discs: Discs, to: int, i: int, sign: float) -> None:
    """Put a row, or the opposite of it, into another."""
    c, r, e = discs
    for m in range(LANES):
        c[to, m], r[to, m] = sign * c[i, m], r[i, m]
    e[to] = e[i]


@inlined
def multiply(discs: Discs, to: int, i: int, j: int, _count: int) -> None:
    """Put the product of two rows into a third."""
    c, r, e = discs
    # Two loops: of one that fills two rows from four the compiler does not find that it goes side by side.
    for m in range(LANES):
        x, y, rx, ry = c[i, m], c[j, m], r[i, m], r[j, m]
        wide = abs(x) * ry + (abs(y) + ry) * rx
        r[to, m] = wide * (1.0 + OPERATION_ERROR) + abs(x * y) * OPERATION_ERROR + UNDERFLOW
    for m in range(LANES):
        c[to, m] = c[i, m] * c[j, m]
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
            r[free, m] = (2.0 * x + rx) * rx * (1.0 + OPERATION_ERROR) + x * x * OPERATION_ERROR + UNDERFLOW
        e[free] = 2.0
        return free
    is_whole = exponent == math.floor(exponent)
    for m in range(count):
        x, rx = c[SCALE, m], r[SCALE, m]
        z = power(x, exponent)
        wide = power(x + rx, exponent) - z if exponent >= 1.0 else z - power(max(x - rx, 0.0), exponent)
        rounding = FUNCTION_ERROR + exponent * OPERATION_ERROR
        if not (is_whole and exponent <= 64.0):
            rounding += exponent * OPERATION_ERROR * abs(math.log(x))
        wide += (z + wide) * rounding + UNDERFLOW
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
        if math.isnan(e[i]):
            _put(discs, to, j, sign)
        else:
            _put(discs, to, i, 1.0)
        return
    low = min(e[i], e[j])
    if e[i] - low > SAME_POWER:
        i = _beside(discs, SUMMAND, i, low, count)
    if e[j] - low > SAME_POWER:
        j = _beside(discs, SUMMAND, j, low, count)
    for m in range(LANES):
        wide, z = r[i, m] + r[j, m], c[i, m] + sign * c[j, m]
        r[to, m] = wide * (1.0 + OPERATION_ERROR) + abs(z) * OPERATION_ERROR + UNDERFLOW
    for m in range(LANES):
        c[to, m] = c[i, m] + sign * c[j, m]
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
        _put(discs, to, i, 1.0)
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
        wide = rx / (size * (size - rx)) * (1.0 + OPERATION_ERROR) + abs(z) * OPERATION_ERROR + UNDERFLOW
        # Far from being halved by the rounding of size − rx.
        c[to, m], r[to, m] = z, (wide if size > rx * (1.0 + 2.0**-40) else math.nan)
    e[to] = -e[i]


@kernel
def _passes_zero(discs: Discs, power: float, m: int) -> bool:
    """Say whether s^power has no branch, nor another sign, on the scale's disc of a lane."""
    return bool(0.5 * power == math.floor(0.5 * power) or discs.radii[SCALE, m] <= discs.centres[SCALE, m])


@kernel
def raise_to(discs: Discs, to: int, i: int, constant: Constant, count: int) -> None:
    """Put the power of a row to a constant into another."""
    c, r, e = discs
    exponent = double_of(constant)
    is_whole = exponent == math.floor(exponent)
    for m in range(count):
        found: Disc = raised((c[i, m], r[i, m]), (exponent, 0.0))
        is_known = is_whole or _passes_zero(discs, exponent * e[i], m)
        c[to, m], r[to, m] = found[0], found[1] if is_known else math.nan
    e[to] = exponent * e[i]


@kernel
def function(discs: Discs, to: int, i: int, operation: int, count: int) -> None:
    """Put a row, its opposite or a function, as :mod:`compiled.evaluation.interpreter` says, into a row."""
    if operation in (COPY, NEGATE):
        _put(discs, to, i, 1.0 if operation == COPY else -1.0)
        return
    c, r, e = discs
    exponent, at, is_size = e[i], i, operation in (ABS, SIGN)
    if not is_size and operation != LOG:
        collapse(discs, ARGUMENT, i, count)
        at = ARGUMENT
    for m in range(count):
        found: Disc = function_of(operation, (c[at, m], r[at, m]))
        if operation == LOG and exponent != 0.0:
            # That of c s^e is log c + e log s.
            found = plus(found, times(exactly(exponent), function_of(LOG, (c[SCALE, m], r[SCALE, m]))))
        is_known = not is_size or _passes_zero(discs, exponent, m)
        c[to, m], r[to, m] = found[0], found[1] if is_known else math.nan
    e[to] = exponent if operation == ABS else 0.0


run_rows = interpreter(
    RowArithmetic(number, add, subtract, multiply, divide, raise_to, function, inverts_first=True),
    __name__,
    "run_rows",
)


@kernel
def put_disc(discs: DiscWorkspace, lane: int, sine: float, cosine: float, radius: float) -> None:
    """Put in the disc of this radius around the v that has this sine and cosine."""
    even, odd = 2.0 * math.sinh(0.5 * radius) ** 2, math.sinh(radius)
    s, c = abs(sine), abs(cosine)
    discs.s_centre[lane], discs.c_centre[lane] = s, cosine
    discs.s_radius[lane] = (s * even + c * odd) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR * s
    discs.c_radius[lane] = (c * even + s * odd) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR
    # 2 cos² v = 1 + cos 2v
    even, odd = 4.0 * even + 2.0 * even * even, 2.0 * odd * (1.0 + even)
    discs.t_radius[lane] = (abs(0.5 - s * s) * even + s * c * odd) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR
    discs.sign[lane] = -1.0 if sine < 0.0 else 1.0


@kernel
def put_pole(discs: DiscWorkspace, lane: int, sine: float, hemisphere: float, half: float) -> None:
    """Put in the disc of the real v with 0 < |sin v| ≤ ``sine``, on one hemisphere and half of the loop."""
    least = math.sqrt((1.0 - sine) * (1.0 + sine)) * (1.0 - FUNCTION_ERROR)
    discs.s_centre[lane] = discs.s_radius[lane] = 0.5 * sine
    discs.c_centre[lane], discs.c_radius[lane] = hemisphere * 0.5 * (1.0 + least), 0.5 * (1.0 - least)
    # Of the disc around a quarter of the square of the sine.
    discs.t_radius[lane] = 0.75 * sine * sine * (1.0 + FUNCTION_ERROR)
    discs.sign[lane] = half


@kernel
def put_squares(loop: Loop, discs: DiscWorkspace, count: int) -> None:
    """Fill in c² on the discs."""
    first, third = loop.g * loop.g, loop.z * loop.z
    for m in range(count):
        s, sr, tr = discs.s_centre[m], discs.s_radius[m], discs.t_radius[m]
        ratio, ratio_r = _equator_ratio(loop.alpha, s, sr, tr)
        square = third + first * ratio
        discs.square[m], discs.square_radius[m] = square, first * ratio_r + 4.0 * EQUATOR_ERROR * square


@kernel
def derivatives_on_discs(formula: Formula, loop: Loop, discs: DiscWorkspace, count: int) -> int:
    """Return the row of D on the discs, which is beside a power of s = |sin v|; fill in c²."""
    c, r, e = formula.discs
    alpha, size, z, sign = loop.alpha, loop.g, loop.z, loop.sign1
    put_squares(loop, discs, count)
    first, second, third = (2, 1, 0) if loop.mirrored else (0, 1, 2)
    for m in range(count):
        s, sr, k, kr = discs.s_centre[m], discs.s_radius[m], discs.c_centre[m], discs.c_radius[m]
        c[SCALE, m], r[SCALE, m] = s, sr
        c[first, m], r[first, m] = sign * size, size * EQUATOR_ERROR
        c[third, m], r[third, m] = discs.sign[m] * z, z * EQUATOR_ERROR
        square, square_r = discs.square[m], discs.square_radius[m]
        root = math.sqrt(square)
        # √ of a disc: the nearest point to 0 moves most.
        root_r = (
            root - math.sqrt(square - square_r) + FUNCTION_ERROR * root if square > square_r else math.nan
        )
        c[second, m] = root * k
        r[second, m] = (root * kr + root_r * (abs(k) + kr)) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR * abs(
            root * k
        )
    e[SCALE], e[first], e[second], e[third] = 1.0, alpha, 0.0, 1.0
    forget_powers(formula.discs)
    run_rows(formula.turn.code, formula.constants, formula.lows, formula.discs, count)
    D: int = formula.turn.results[0]
    return D


@kernel
def _equator_ratio(alpha: float, s: float, sr: float, square_r: float) -> tuple[float, float]:
    """Return (1 − s^2α)/cos² v on a disc."""
    square = s * s
    if alpha == 2.0:
        return 1.0 + square, square_r
    exponent = 2.0 * alpha
    is_analytic = sr <= s or exponent == 2.0 * math.floor(0.5 * exponent)
    if not is_analytic:
        return math.nan, math.nan
    # With t = cos² v the ratio is α ∫ (1 − tξ)^(α−1) dξ over 0 ≤ ξ ≤ 1: it varies most at real t.
    t = 1.0 - square
    edge = t - square_r if alpha >= 2.0 else t + square_r
    if edge < 0.98:
        value = _ratio(alpha, t)
        return value, abs(_ratio(alpha, edge) - value) * (1.0 + FUNCTION_ERROR) + 4.0 * FUNCTION_ERROR * value
    top = power(s, exponent)
    top_r = (power(s + sr, exponent) - top) * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR
    left = t - square_r
    if not left > 0.0:
        return math.nan, math.nan
    value = (1.0 - top) / t
    return value, (top_r + value * square_r) / left * (1.0 + FUNCTION_ERROR) + FUNCTION_ERROR * value


@kernel
def _ratio(alpha: float, t: float) -> float:
    return -math.expm1(alpha * math.log1p(-t)) / t if abs(t) > 1e-300 else alpha
