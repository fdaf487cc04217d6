"""The phase at times, and the six variables there, compiled.

Times are sorted by the panel they are in, so that everything is done for many at once:
each by itself, with the digits it has alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.blocks import BLOCK, SPLIT, STRIDE, sort_by_interval, two_sum
from workers.solvers.spectral.compiled import kernel
from workers.solvers.spectral.curve import (
    ABOVE,
    BELOW,
    BOUND,
    COSINE,
    G1,
    G2,
    G3,
    SENSE,
    SINE,
    SPEED,
    TIME,
    VALUE,
    WIDTH,
    C,
    loop_points,
    place,
)
from workers.solvers.spectral.time_map import (
    ANCHOR,
    FIRST,
    GUESS,
    HIGH,
    LAST,
    LENGTH,
    LOW,
    START,
    START_LO,
    at,
    distance,
    series_at,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STEP = 1e-8
"""A Newton step after which the error, its square, is below rounding."""
MAX_STEPS = 61
PHASE, FLOOR, CEILING, IS_DONE = BELOW, ABOVE, C, SPEED
"""Rows of the desk that are free while phases are sought: x, its bracket, and whether it is found."""

# The same rows on the desk in one dimension.
_TIME, _PHASE, _FLOOR, _CEILING, _VALUE, _IS_DONE = (
    np.uint64(STRIDE * row) for row in (TIME, PHASE, FLOOR, CEILING, VALUE, IS_DONE)
)


@kernel
def _reduce(
    loop: FloatArray,
    times: FloatArray,
    rests: FloatArray,
    local: FloatArray,
    left_out: FloatArray,
    sense: FloatArray,
) -> None:
    """Fill in the time on the panels, by a multiple of the period less, what it leaves out, and the sense.

    The times are the sums of ``times`` and ``rests``.
    A time has the size of the period: its roundings would be the largest of all.
    """
    hi, lo, origin = loop[curve.PERIOD_HI], loop[curve.PERIOD_LO], loop[curve.ORIGIN]
    first = -1.0 if loop[curve.BACKWARDS] != 0.0 else 1.0
    b_high = SPLIT * hi - (SPLIT * hi - hi)
    b_low = hi - b_high
    # A libration comes back over the panels.
    turning = 0.5 * hi if loop[curve.ROTATES] == 0.0 else math.inf
    for k in range(len(times)):
        n = math.floor(times[k] / hi + 0.5)
        product = n * hi
        a_high = SPLIT * n - (SPLIT * n - n)
        a_low = n - a_high
        # Dekker's: what the product leaves out. The difference of the time and the product is exact.
        rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
        t, r1 = two_sum(first * (times[k] - product), -first * (rest + n * lo - rests[k]))
        t, r2 = two_sum(t, origin)
        turn = 1.0 if t < 0.0 else (-1.0 if t >= hi else 0.0)
        t, r3 = two_sum(t, turn * hi)
        rest = r1 + r2 + r3 + turn * lo + loop[curve.ORIGIN_LO]
        back, r4 = two_sum(hi, -t)
        local[k] = back if t > turning else t
        left_out[k] = (r4 + lo) - rest if t > turning else rest
        sense[k] = -first if t > turning else first


@kernel
def _find_phases(panel: FloatArray, flat: FloatArray, begin: int, end: int) -> None:
    """Fill in the PHASE at which TIME has passed since the panel's start, and dt/dx there (VALUE).

    Newton, safeguarded. ``flat`` is the desk in one dimension, its rows STRIDE apart.
    """
    first, last, length = panel[FIRST], panel[LAST], panel[LENGTH]
    n0, n1, n2, n3 = panel[GUESS], panel[GUESS + 1], panel[GUESS + 2], panel[GUESS + 3]
    n4, n5, m = panel[GUESS + 4], panel[GUESS + 5], panel[GUESS + 6]
    for k in range(begin, end):
        share = flat[_TIME + k] / length
        guess = n2 + (share - m) * (n3 + (share - m) * (n4 + n5 * (share - 1.0)))
        flat[_PHASE + k] = min(last, max(first, n0 + share * (n1 + share * guess)))
        flat[_FLOOR + k], flat[_CEILING + k], flat[_IS_DONE + k] = first, last, 0.0
    for _ in range(MAX_STEPS):
        left = 0
        for k in range(begin, end):
            x, is_found = flat[_PHASE + k], flat[_IS_DONE + k]
            value, slope = series_at(panel, x)
            miss = value - flat[_TIME + k]
            above = x if miss > 0.0 else flat[_CEILING + k]
            below = flat[_FLOOR + k] if miss > 0.0 else x
            to = x - miss / slope
            is_close = 1.0 if abs(miss / slope) <= STEP else 0.0
            inside = to if (below < to) & (to < above) else 0.5 * (below + above)
            to = min(last, max(first, to)) if is_close != 0.0 else inside
            flat[_PHASE + k] = x if is_found != 0.0 else to
            flat[_VALUE + k], flat[_FLOOR + k], flat[_CEILING + k] = slope, below, above
            flat[_IS_DONE + k] = max(is_found, is_close)
            left += 1 if is_found == 0.0 else 0
        if left == 0:
            break


@kernel
def _places(loop: FloatArray, panel: FloatArray, desk: FloatArray, begin: int, end: int) -> None:
    """Put the places of one panel on the desk, whose PHASE is there."""
    width, anchor = panel[HIGH] - panel[LOW], int(panel[ANCHOR])
    for k in range(begin, end):
        w = distance(panel, desk[PHASE, k])
        _, _, desk[SINE, k], desk[COSINE, k], desk[SPEED, k] = place(loop, anchor, w)
        desk[WIDTH, k] = width


@kernel
def _rotate(loop: FloatArray, desk: FloatArray, count: int) -> None:
    """Turn VALUE, dt/dx, into the primed p = −(Z/c) dv/dt, and BOUND into r."""
    z, alpha = loop[curve.Z], loop[curve.ALPHA]
    direction = loop[curve.DIRECTION] if loop[curve.ROTATES] != 0.0 else 1.0
    for k in range(count):
        velocity = desk[SENSE, k] * desk[SPEED, k] * 0.5 * desk[WIDTH, k] / desk[VALUE, k] * direction
        sine, c = desk[SINE, k], desk[C, k]
        # r = −α g1 p/g3 with g3 = Z sin v.
        r = alpha * desk[G1, k] * velocity / (c * sine)
        desk[VALUE, k], desk[BOUND, k] = -z * velocity / c, (r if sine != 0.0 else 0.0)


@kernel
def _row_of(loop: FloatArray, column: int) -> tuple[int, float]:
    """Return the row of the desk, and the sign, of a client's column (0 to 5)."""
    p, r = VALUE, BOUND
    if loop[curve.MIRRORED] != 0.0:
        return (r, 0, p, G3, G2, G1)[column], (-1.0 if column < 3 else 1.0)
    return (p, 0, r, G1, G2, G3)[column], 1.0


@kernel
def sample(
    loop: FloatArray,
    panels: FloatArray,
    number: int,
    times: FloatArray,
    rests: FloatArray,
    columns: IntArray,
    out: FloatArray,
) -> None:
    """Fill ``out`` (times, columns) with the columns asked, numbered 0 to 5 for p, q, r, g1, g2, g3.

    The times are the sums of ``times`` and ``rests``.
    """
    size = min(BLOCK, len(times))
    flat, local = np.empty(curve.ROWS * STRIDE), np.empty(size)
    left_out, sense = np.empty(size), np.empty(size)
    desk = flat.reshape((curve.ROWS, STRIDE))
    home, order = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    starts, begins = panels[:number, START].copy(), np.empty(number + 1, dtype=np.uint64)
    wants_omega = False
    for column in columns:
        wants_omega = wants_omega or column == 0 or column == 2
    for start in range(0, len(times), BLOCK):
        count = min(BLOCK, len(times) - start)
        stop = start + count
        _reduce(loop, times[start:stop], rests[start:stop], local, left_out, sense)
        sort_by_interval(starts, local[:count], home, begins, order)
        for n in range(number):
            begin, end = begins[n], begins[n + 1]
            if begin == end:
                continue
            for k in range(begin, end):
                here = local[order[k]] - panels[n, START]
                desk[TIME, k] = here + (left_out[order[k]] - panels[n, START_LO])
                desk[SENSE, k] = sense[order[k]]
            _find_phases(panels[n], flat, begin, end)
            _places(loop, panels[n], desk, begin, end)
        loop_points(loop, desk, count)
        if wants_omega:
            _rotate(loop, desk, count)
        for j in range(len(columns)):
            row, sign = _row_of(loop, columns[j])
            for k in range(count):
                out[start + order[k], j] = 0.0 if columns[j] == 1 else sign * desk[row, k]


@kernel
def extent(loop: FloatArray, panels: FloatArray, number: int) -> tuple[float, float]:
    """Return the largest time derivative of any variable, and the largest |p| or |r|, over all panels.

    Derivatives are differences between neighbouring places, a factor added for what is between them.
    """
    steepest, largest, last = 0.0, 0.0, math.nan
    previous, now = np.empty(5), np.empty(5)
    desk = np.empty((curve.ROWS, 9))
    rows = np.array([VALUE, BOUND, G1, G2, G3])
    desk[SENSE] = 1.0
    for n in range(number):
        panel = panels[n]
        count = 8 + (n == number - 1)
        for k in range(count):
            desk[PHASE, k] = panel[FIRST] + 0.125 * k * (panel[LAST] - panel[FIRST])
        for k in range(count):
            value, desk[VALUE, k] = at(panel, desk[PHASE, k])
            desk[TIME, k] = panel[START] + value
        _places(loop, panel, desk, 0, count)
        loop_points(loop, desk, count)
        _rotate(loop, desk, count)
        for k in range(count):
            step = desk[TIME, k] - last
            if step <= 1e-9 * loop[curve.PERIOD_HI]:
                continue
            for i in range(5):
                now[i] = desk[rows[i], k]
            largest = max(largest, abs(now[0]), abs(now[1]))
            if step > 0.0:
                for i in range(5):
                    steepest = max(steepest, abs(now[i] - previous[i]) / step)
            previous[:] = now
            last = desk[TIME, k]
    return 1.25 * steepest, largest
