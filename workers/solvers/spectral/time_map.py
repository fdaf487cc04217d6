"""Time as a function of the phase: Chebyshev series on panels, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.compiled import kernel
from workers.solvers.spectral.curve import place, radicand_with_bound, rate

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NODES = 16
MAX_PANELS = 192
NARROWEST = 2.0**-44
TAIL = 1.0
"""What the series leaves out of t, in its last coefficients: they may be small by chance, and what
follows them with fractional powers falls off slowly."""
NOISE = 1e-7
EPSILON = 2.0**-52

ANCHOR, LOW, HIGH, FIRST, LAST, START = range(6)
"""Columns of the table of panels: u = ANCHOR/2 + w, where −1 ≤ x ≤ 1 is LOW ≤ w ≤ HIGH, of which
FIRST ≤ x ≤ LAST is the panel; START is the time at FIRST. The series follow: NODES of dt/dx, NODES + 1
of t − START. About a rest point dt/du is even: the panel is half of one symmetric about it, so that no
node is next to it, where rounding is divided by the distance."""
SLOPES = START + 1
TIMES = SLOPES + NODES
LENGTH = TIMES + NODES + 1
GUESS = LENGTH + 1
"""x as a quintic of the share of LENGTH that has passed: its Newton form, the middle node last."""
COLUMNS = GUESS + 7


def cosines() -> FloatArray:
    """Return the matrix that turns values at cos(π (j + 1/2) / NODES) into a Chebyshev series."""
    k, j = np.meshgrid(np.arange(NODES), np.arange(NODES), indexing="ij")
    matrix = np.cos(np.pi * (k * (2 * j + 1) % (4 * NODES)) / (2 * NODES)) * (2.0 / NODES)
    matrix[0] *= 0.5
    return matrix


def nodes() -> FloatArray:
    """Return cos(π (j + 1/2) / NODES): from almost 1 down to almost −1."""
    j = np.arange(NODES)
    return np.sin(np.pi * (NODES - 1 - 2 * j) / (2 * NODES))


@kernel
def distance(panel: FloatArray, x: float) -> float:
    """Return the distance to the anchor at x; exact next to an anchor at one of the ends."""
    return float(0.5 * (panel[LOW] * (1.0 - x) + panel[HIGH] * (1.0 + x)))


@kernel
def _noise(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    panel: FloatArray,
    x: float,
    at_ends: FloatArray,
    work: FloatArray,
) -> float:
    """Return the bound of the relative rounding of dt/du at a place."""
    below, above, sine, cosine, _ = place(loop, int(panel[ANCHOR]), distance(panel, x))
    if loop[curve.ROOTS_MODE] != 0.0:
        size = loop[curve.G]
        worst, k = 0.0, curve.ROOTS_MODE + 6 + 2 * int(loop[curve.ROOTS_MODE + 4])
        for _ in range(int(loop[curve.ROOTS_MODE + 5])):
            away = size * sine * sine - loop[k]
            worst = max(worst, 2.0 * abs(away) * size / (away * away + loop[k + 1] * loop[k + 1]))
            k += 2
        zeros = loop[curve.ROOTS_MODE + 4] + loop[curve.ROOTS_MODE + 5]
        return float((8.0 + zeros + worst) * 0.5 * EPSILON)
    P, bound = radicand_with_bound(code, result, constants, loop, sine, cosine, work)
    if loop[curve.ROTATES] == 0.0:
        bound += (at_ends[0] * above + at_ends[1] * below) / (below + above)
    return 0.5 * bound / abs(P) + 4.0 * EPSILON


@kernel
def _prepare_guess(panel: FloatArray) -> None:
    """Interpolate the inverse function and its slope at the ends and in the middle (Hermite)."""
    first, last, length = panel[FIRST], panel[LAST], panel[LENGTH]
    middle = 0.5 * (first + last)
    at_middle, _ = series_at(panel, middle)
    m = at_middle / length
    z = np.array([0.0, 0.0, m, m, 1.0, 1.0])
    f = np.array([first, first, middle, middle, last, last])
    slopes = np.empty(3)
    for k in range(3):
        _, slope = series_at(panel, f[2 * k])
        slopes[k] = length / slope
    panel[GUESS] = first
    panel[GUESS + 6] = m
    for order in range(1, 6):
        for k in range(6 - order):
            if order == 1 and k % 2 == 0:
                f[k] = slopes[k // 2]
            else:
                f[k] = (f[k + 1] - f[k]) / (z[k + order] - z[k])
        panel[GUESS + order] = f[0]


@kernel
def build_time_map(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    tolerance: float,
    matrix: FloatArray,
    points: FloatArray,
    panels: FloatArray,
    work: FloatArray,
) -> tuple[int, float, float]:
    """Fill the table of panels; return their number, the length of time, and the bound of its error.

    For a libration they cover 0 ≤ u ≤ 1, half a period. The number is 0 if dt/du is not resolved.
    """
    at_ends = np.zeros(2)
    if loop[curve.ROOTS_MODE] == 0.0 and loop[curve.ROTATES] == 0.0:
        _, at_ends[0] = radicand_with_bound(
            code, result, constants, loop, loop[curve.S_LOWER], loop[curve.C_LOWER], work
        )
        _, at_ends[1] = radicand_with_bound(
            code, result, constants, loop, loop[curve.S_UPPER], loop[curve.C_UPPER], work
        )
    waiting = np.empty((MAX_PANELS, 6))
    values, series = np.empty(NODES), np.empty(NODES + 2)
    rotates = loop[curve.ROTATES] != 0.0
    # The stack's top is the panel with the smallest u.
    last = 4 if rotates else 2
    pending = 0
    for anchor in range(last, -1, -1):
        low, high, first, final = -0.25, 0.25, -1.0, 1.0
        if not rotates:
            # Two panels at first: the middle is an anchor only where they are split.
            low, high, first, final = -0.5, 0.5, (0.0 if anchor == 0 else -1.0), (1.0 if anchor == 0 else 0.0)
            if anchor == 1:
                continue
        elif anchor == 0:
            low = 0.0
        elif anchor == last:
            high = 0.0
        waiting[pending] = np.array([float(anchor), low, high, first, final, math.inf])
        pending += 1
    number, length, error = 0, 0.0, 0.0
    panel = np.empty(COLUMNS)
    while pending:
        pending -= 1
        before = waiting[pending, 5]
        panel[:5] = waiting[pending, :5]
        first, final = panel[FIRST], panel[LAST]
        is_half = final - first < 2.0
        half = 0.5 * (panel[HIGH] - panel[LOW])
        largest = 0.0
        for j in range(NODES):
            if first <= points[j] <= final:
                values[j] = rate(
                    code, result, constants, loop, int(panel[ANCHOR]), distance(panel, points[j]), work
                )
                if is_half:
                    values[NODES - 1 - j] = values[j]
        for k in range(NODES):
            total = 0.0
            for j in range(NODES):
                total += matrix[k, j] * values[j]
            series[k] = total
            largest = max(largest, abs(total))
        series[NODES], series[NODES + 1] = 0.0, 0.0
        if not largest < math.inf or math.isnan(total):
            return 0, math.nan, math.inf
        tail = max(abs(series[NODES - 1]), abs(series[NODES - 2]))
        # A tail that halving does not shrink is rounding, once it is small.
        is_noise = tail > 0.25 * before and tail < NOISE * largest
        if tail * half > tolerance * (length + largest * half) and not is_noise and half > NARROWEST:
            if number + pending + 2 > MAX_PANELS:
                return 0, math.nan, math.inf
            upper, lower = pending, pending + 1
            waiting[upper, :5], waiting[lower, :5] = panel[:5], panel[:5]
            waiting[upper, 5], waiting[lower, 5] = tail, tail
            if is_half:
                outer, inner = (upper, lower) if final > 0.0 else (lower, upper)
                waiting[inner, 1], waiting[inner, 2] = 0.5 * panel[LOW], 0.5 * panel[HIGH]
                waiting[outer, 3], waiting[outer, 4] = -1.0, 1.0
                if final > 0.0:
                    waiting[outer, 1] = 0.5 * panel[HIGH]
                else:
                    waiting[outer, 2] = 0.5 * panel[LOW]
                if panel[HIGH] == 0.5:
                    turned = -0.5 if final > 0.0 else 0.5
                    waiting[outer, 0] = 1.0
                    waiting[outer, 1] += turned
                    waiting[outer, 2] += turned
            else:
                middle = 0.5 * (panel[LOW] + panel[HIGH])
                waiting[upper, 1], waiting[lower, 2] = middle, middle
            pending += 2
            continue
        if number == MAX_PANELS:
            return 0, math.nan, math.inf
        panel[TIMES] = 0.0
        for k in range(1, NODES + 1):
            before_it = 2.0 * series[0] if k == 1 else series[k - 1]
            panel[TIMES + k] = half * (before_it - series[k + 1]) / (2.0 * k)
        for k in range(NODES):
            panel[SLOPES + k] = half * series[k]
        begin, _ = series_at(panel, first)
        panel[TIMES] = -begin
        end, _ = series_at(panel, final)
        rough = 0.0
        for k in range(3):
            x = first + (final - first) * (0.09 + 0.4 * k)
            rough += _noise(code, result, constants, loop, panel, x, at_ends, work) / 3.0
        # T_k integrates to at most 1/(k − 1) of itself: a factor 4 is kept.
        error += rough * end + TAIL * tail * half
        panel[START] = length
        panel[LENGTH] = end
        _prepare_guess(panel)
        length += end
        panels[number] = panel
        number += 1
    return number, length, error


@kernel
def time_at(panels: FloatArray, number: int, u: float) -> float:
    """Return the time at the phase u."""
    for n in range(number):
        panel = panels[n]
        w = u - 0.5 * panel[ANCHOR]
        if n == number - 1 or w <= (panel[HIGH] if panel[LAST] == 1.0 else 0.0):
            x = ((w - panel[LOW]) - (panel[HIGH] - w)) / (panel[HIGH] - panel[LOW])
            value, _ = series_at(panel, min(panel[LAST], max(panel[FIRST], x)))
            return float(panel[START] + value)
    return math.nan


@kernel
def series_at(panel: FloatArray, x: float) -> tuple[float, float]:
    """Return t − START and dt/dx at x, by Clenshaw's recurrence for both at once."""
    twice = 2.0 * x
    b1, b2 = panel[TIMES + NODES], 0.0
    c1, c2 = 0.0, 0.0
    for k in range(NODES - 1, 0, -1):
        b1, b2 = (panel[TIMES + k] - b2) + twice * b1, b1
        c1, c2 = (panel[SLOPES + k] - c2) + twice * c1, c1
    return panel[TIMES] + x * b1 - b2, panel[SLOPES] + x * c1 - c2


@kernel
def largest_noise(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    panels: FloatArray,
    number: int,
    work: FloatArray,
) -> float:
    """Return the largest relative error of dt/du on any panel, of rounding and of the series."""
    nothing = np.zeros(2)
    worst = 0.0
    for n in range(number):
        panel = panels[n]
        x = panel[FIRST] + 0.37 * (panel[LAST] - panel[FIRST])
        _, smallest = series_at(panel, x)
        tail = max(abs(panel[SLOPES + NODES - 1]), abs(panel[SLOPES + NODES - 2]))
        noise = _noise(code, result, constants, loop, panel, x, nothing, work)
        worst = max(worst, noise + 2.0 * tail / smallest)
    return worst
