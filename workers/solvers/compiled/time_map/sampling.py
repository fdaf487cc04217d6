"""Finds the phase at given times, and from it the six variables.

Times are sorted by the panel they are in, so that everything is done for many at once:
each by itself, with the digits it has alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.curve import loop_points
from workers.solvers.compiled.kernels import fused, inlined, kernel
from workers.solvers.compiled.records import Loop, Panel, Records
from workers.solvers.compiled.time_map.panels import at, distance, larger, series_at, slope_at
from workers.solvers.compiled.workspace import BLOCK, Moments, sort_by_interval, two_sum

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LAST_NEWTON_STEP = 1e-8
"""A Newton step after which the error, its square, is below rounding."""
MAX_NEWTON_STEPS = 61
SINE = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 9))
"""Coefficients of x³, x⁵, … in sin x: up to π/4 the next term is below 2^-61 of the sum."""


@kernel
def _reduce(
    loop: Loop,
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
    hi, lo, origin, origin_lo = loop.period_hi, loop.period_lo, loop.origin, loop.origin_lo
    first = -1.0 if loop.backwards else 1.0
    # A libration comes back over the panels.
    turning = math.inf if loop.rotates else 0.5 * hi
    for k in range(len(times)):
        n = float(math.floor(times[k] / hi + 0.5))
        product = n * hi
        # What the product leaves out. The difference of the time and the product is exact.
        rest = fused(n, hi, -product)
        t, r1 = two_sum(first * (times[k] - product), -first * (rest + n * lo - rests[k]))
        t, r2 = two_sum(t, origin)
        turn = 1.0 if t < 0.0 else (-1.0 if t >= hi else 0.0)
        t, r3 = two_sum(t, turn * hi)
        rest = r1 + r2 + r3 + turn * lo + origin_lo
        back, r4 = two_sum(hi, -t)
        local[k] = back if t > turning else t
        left_out[k] = (r4 + lo) - rest if t > turning else rest
        sense[k] = -first if t > turning else first


@kernel
def _find_phases(panel: Panel, moments: Moments, begin: int, end: int) -> None:
    """Fill in the phase x at which the time has passed since the panel's start, and dt/dx there.

    Newton, safeguarded. The rows of ``moments`` are at distances that the compiler knows: it goes through
    several times at once.
    """
    first, last, length = panel.first, panel.last, panel.length
    n0, n1, n2, n3 = panel.guess[0], panel.guess[1], panel.guess[2], panel.guess[3]
    n4, n5, m = panel.guess[4], panel.guess[5], panel.guess[6]
    for k in range(begin, end):
        share = moments.time[k] / length
        guess = n2 + (share - m) * (n3 + (share - m) * (n4 + n5 * (share - 1.0)))
        moments.phase[k] = min(last, max(first, n0 + share * (n1 + share * guess)))
        moments.floor[k], moments.ceiling[k], moments.is_found[k] = first, last, 0.0
    for _ in range(MAX_NEWTON_STEPS):
        left = 0
        for k in range(begin, end):
            x, is_found = moments.phase[k], moments.is_found[k]
            value, slope = series_at(panel, x)
            miss = value - moments.time[k]
            above = x if miss > 0.0 else moments.ceiling[k]
            below = moments.floor[k] if miss > 0.0 else x
            to = x - miss / slope
            is_close = 1.0 if abs(miss / slope) <= LAST_NEWTON_STEP else 0.0
            inside = to if (below < to) & (to < above) else 0.5 * (below + above)
            to = min(last, max(first, to)) if is_close != 0.0 else inside
            moments.phase[k] = x if is_found != 0.0 else to
            moments.floor[k], moments.ceiling[k] = below, above
            moments.is_found[k] = max(is_found, is_close)
            left += 1 if max(is_found, is_close) == 0.0 else 0
        if left == 0:
            break
    for k in range(begin, end):
        moments.slope[k] = slope_at(panel, moments.phase[k])


@inlined
def _sine(x: float) -> float:
    """Return sin x for |x| ≤ π/4, off by a rounding; functions of the C library take one at a time."""
    z = x * x
    series = SINE[5] + z * (SINE[6] + z * SINE[7])
    series = SINE[1] + z * (SINE[2] + z * (SINE[3] + z * (SINE[4] + z * series)))
    return x + x * z * (SINE[0] + z * series)


@kernel
def _places(loop: Loop, panel: Panel, moments: Moments, begin: int, end: int) -> None:
    """Fill in the places on one panel at phases: what :func:`.place` says, many at once.

    Of no angle more than π/4 is asked: 2 sin ½x cos ½x and 1 − 2 sin² ½x are the sine and cosine of others.
    """
    width, anchor, h = panel.high - panel.low, panel.anchor, loop.half_width
    if loop.rotates:
        for k in range(begin, end):
            sine = _sine(math.pi * distance(panel, moments.phase[k]))
            cosine = math.sqrt(1.0 - sine * sine)
            turned = -sine if anchor % 4 == 1 or anchor % 4 == 2 else sine
            other = -cosine if anchor % 4 == 2 or anchor % 4 == 3 else cosine
            moments.sine[k] = loop.direction * (other if anchor % 2 else turned)
            moments.cosine[k] = turned if anchor % 2 else other
            moments.speed[k], moments.width[k] = math.pi, width
        return
    if anchor == 1:
        s_from, c_from, sense = loop.s_middle, loop.c_middle, 1.0
        for k in range(begin, end):
            sine = _sine(math.pi * distance(panel, moments.phase[k]))
            moments.floor[k] = 0.5 * h * sine
            moments.speed[k] = math.pi * h * math.sqrt(1.0 - sine * sine)
    else:
        s_from, c_from, sense = loop.s_lower, loop.c_lower, 1.0
        if anchor == 2:
            s_from, c_from, sense = loop.s_upper, loop.c_upper, -1.0
        for k in range(begin, end):
            root = _sine(0.5 * math.pi * distance(panel, moments.phase[k]))
            moments.floor[k] = sense * h * root * root
            moments.speed[k] = 2.0 * math.pi * h * abs(root) * math.sqrt(1.0 - root * root)
    for k in range(begin, end):
        half = _sine(moments.floor[k])
        s, c = 2.0 * half * math.sqrt(1.0 - half * half), 1.0 - 2.0 * half * half
        moments.sine[k], moments.cosine[k] = s_from * c + c_from * s, c_from * c - s_from * s
        moments.width[k] = width


@kernel
def _rotate(loop: Loop, moments: Moments, count: int) -> None:
    """Fill in the primed p = −(Z/c) dv/dt and r."""
    z, alpha = loop.z, loop.alpha
    direction = loop.direction if loop.rotates else 1.0
    for k in range(count):
        speed = moments.sense[k] * moments.speed[k] * 0.5 * moments.width[k] / moments.slope[k] * direction
        sine, c = moments.sine[k], moments.c[k]
        # r = −α g1 p/g3 with g3 = Z sin v.
        r = alpha * moments.g1[k] * speed / (c * sine)
        moments.p[k], moments.r[k] = -z * speed / c, (r if sine != 0.0 else 0.0)


@kernel
def _column(loop: Loop, moments: Moments, column: int) -> tuple[FloatArray, float]:
    """Return a client's column (0 to 5, but not q), and its sign."""
    is_first = (column % 3 == 0) != loop.mirrored
    if column < 3:
        return (moments.p if is_first else moments.r), (-1.0 if loop.mirrored else 1.0)
    if column == 4:
        return moments.g2, 1.0
    return (moments.g1 if is_first else moments.g3), 1.0


@kernel
def sample(
    loop: Loop,
    panels: Records,
    number: int,
    times: FloatArray,
    rests: FloatArray,
    columns: IntArray,
    moments: Moments,
    out: FloatArray,
) -> None:
    """Fill ``out`` (times, columns) with the columns asked, numbered 0 to 5 for p, q, r, g1, g2, g3.

    The times are the sums of ``times`` and ``rests``.
    """
    size = min(BLOCK, len(times))
    local, left_out, sense = np.empty(size), np.empty(size), np.empty(size)
    home, order = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    starts, begins = np.empty(number), np.empty(number + 1, dtype=np.uint64)
    for n in range(number):
        starts[n] = panels[n].start
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
            panel = panels[n]
            for k in range(begin, end):
                here = local[order[k]] - panel.start
                moments.time[k] = here + (left_out[order[k]] - panel.start_lo)
                moments.sense[k] = sense[order[k]]
            _find_phases(panel, moments, begin, end)
            _places(loop, panel, moments, begin, end)
        loop_points(loop, moments, count)
        if wants_omega:
            _rotate(loop, moments, count)
        for j in range(len(columns)):
            if columns[j] == 1:
                out[start : start + count, j] = 0.0
                continue
            row, sign = _column(loop, moments, columns[j])
            for k in range(count):
                out[start + order[k], j] = sign * row[k]


@kernel
def sample_one(
    loops: Records,
    panels: Records,
    times: FloatArray,
    rests: FloatArray,
    columns: IntArray,
    workspaces: Records,
    out: FloatArray,
) -> None:
    """Sample the motion of the only loop there is; as :func:`sample`, called from Python."""
    sample(loops[0], panels, len(panels), times, rests, columns, workspaces[0].moments, out)


@kernel
def extent(
    loop: Loop, panels: Records, number: int, moments: Moments, astray: FloatArray
) -> tuple[float, float, float]:
    """Return the largest time derivative of any variable, the largest |p| or |r|, and what times are worth.

    That is the largest product of a panel's largest derivative and its ``astray``, the error of times there.
    Derivatives are differences between neighbouring places, a factor added for what is between them.
    """
    steepest, largest, moved, last, off = 0.0, 0.0, 0.0, math.nan, 0.0
    previous, now = np.empty(5), np.empty(5)
    for n in range(number):
        panel = panels[n]
        count = 8 + (n == number - 1)
        # Of all panels since the last place: the step to the first of one lies in the one before it.
        off = larger(off, astray[n])
        for k in range(count):
            moments.phase[k] = panel.first + 0.125 * k * (panel.last - panel.first)
            moments.sense[k] = 1.0
        for k in range(count):
            value, moments.slope[k] = at(panel, moments.phase[k])
            moments.time[k] = panel.start + value
        _places(loop, panel, moments, 0, count)
        loop_points(loop, moments, count)
        _rotate(loop, moments, count)
        for k in range(count):
            step = moments.time[k] - last
            if step <= 1e-9 * loop.period_hi:
                continue
            now[0], now[1] = moments.p[k], moments.r[k]
            now[2], now[3], now[4] = moments.g1[k], moments.g2[k], moments.g3[k]
            largest = max(largest, abs(now[0]), abs(now[1]))
            if step > 0.0:
                here = 0.0
                for i in range(5):
                    here = max(here, abs(now[i] - previous[i]) / step)
                steepest = max(steepest, here)
                moved, off = larger(moved, here * off), astray[n]
            previous[:] = now
            last = moments.time[k]
    return 1.25 * steepest, largest, 1.25 * moved
