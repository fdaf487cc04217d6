"""Time as a function of the phase: Chebyshev series on panels, compiled."""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.blocks import two_sum
from workers.solvers.spectral.compiled import inlined, kernel
from workers.solvers.spectral.curve import ABOVE, BELOW, COSINE, SINE, SPEED, VALUE, place, rates

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NODES = 16
MAX_PANELS = 192
NARROWEST = 2.0**-44
NOISE = 1e-7

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
START_LO = GUESS + 7
"""What START leaves out."""
COLUMNS = START_LO + 1
BEFORE = START
"""Of a panel that waits: the tail before it was halved."""


def cosines() -> FloatArray:
    """Return the matrix, transposed, that turns values at cos(π (j + 1/2) / NODES) into a series."""
    k, j = np.meshgrid(np.arange(NODES), np.arange(NODES), indexing="ij")
    matrix = np.cos(np.pi * (k * (2 * j + 1) % (4 * NODES)) / (2 * NODES)) * (2.0 / NODES)
    matrix[0] *= 0.5
    return np.ascontiguousarray(matrix.T)


def nodes() -> FloatArray:
    """Return cos(π (j + 1/2) / NODES): from almost 1 down to almost −1."""
    j = np.arange(NODES)
    return np.sin(np.pi * (NODES - 1 - 2 * j) / (2 * NODES))


@inlined
def distance(panel: FloatArray, x: float) -> float:
    """Return the distance to the anchor at x; exact next to an anchor at one of the ends."""
    return float(0.5 * (panel[LOW] * (1.0 - x) + panel[HIGH] * (1.0 + x)))


@kernel
def at(panel: FloatArray, x: float) -> tuple[float, float]:
    """Return what :func:`series_at` does, for one place: code that is shared."""
    return series_at(panel, x)


@kernel
def _prepare_guess(panel: FloatArray, scratch: FloatArray) -> None:
    """Interpolate the inverse function and its slope at the ends and in the middle (Hermite)."""
    first, last, length = panel[FIRST], panel[LAST], panel[LENGTH]
    middle = 0.5 * (first + last)
    _, slope_first = at(panel, first)
    at_middle, slope_middle = at(panel, middle)
    _, slope_last = at(panel, last)
    m = at_middle / length
    z, f, slopes = scratch[0], scratch[1], scratch[2]
    z[0], z[1], z[2], z[3], z[4], z[5] = 0.0, 0.0, m, m, 1.0, 1.0
    f[0], f[1], f[2], f[3], f[4], f[5] = first, first, middle, middle, last, last
    slopes[0], slopes[1], slopes[2] = length / slope_first, length / slope_middle, length / slope_last
    panel[GUESS] = first
    panel[GUESS + 6] = m
    for order in range(1, 6):
        for k in range(6 - order):
            if order == 1 and k % 2 == 0:
                f[k] = slopes[k // 2]
            else:
                f[k] = (f[k + 1] - f[k]) / (z[k + order] - z[k])
        panel[GUESS + order] = f[0]


@inlined
def _first_panels(rotates: bool, waiting: FloatArray) -> int:
    """Put the panels to begin with on the stack, the one with the smallest u on top; return how many."""
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
        top = waiting[pending]
        top[ANCHOR], top[LOW], top[HIGH], top[FIRST], top[LAST], top[BEFORE] = (
            anchor,
            low,
            high,
            first,
            final,
            math.inf,
        )
        pending += 1
    return pending


@inlined
def _split(panel: FloatArray, tail: float, waiting: FloatArray, pending: int) -> None:
    """Put both parts of a panel on the stack."""
    first, final = panel[FIRST], panel[LAST]
    upper, lower = waiting[pending], waiting[pending + 1]
    for k in range(START):
        upper[k] = lower[k] = panel[k]
    upper[BEFORE] = lower[BEFORE] = tail
    if final - first < 2.0:
        outer, inner = (upper, lower) if final > 0.0 else (lower, upper)
        inner[LOW], inner[HIGH] = 0.5 * panel[LOW], 0.5 * panel[HIGH]
        outer[FIRST], outer[LAST] = -1.0, 1.0
        if final > 0.0:
            outer[LOW] = 0.5 * panel[HIGH]
        else:
            outer[HIGH] = 0.5 * panel[LOW]
        if panel[HIGH] == 0.5:
            turned = -0.5 if final > 0.0 else 0.5
            outer[ANCHOR] = 1.0
            outer[LOW] += turned
            outer[HIGH] += turned
    else:
        middle = 0.5 * (panel[LOW] + panel[HIGH])
        upper[LOW], lower[HIGH] = middle, middle


@inlined
def _rates_at_nodes(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    points: FloatArray,
    panel: FloatArray,
    desk: FloatArray,
    work: FloatArray,
    values: FloatArray,
) -> None:
    """Fill in dt/du at the nodes, of which one half mirrors the other on half a panel."""
    begin, end = 0, NODES
    if panel[LAST] - panel[FIRST] < 2.0:
        begin, end = (0, NODES // 2) if panel[LAST] > 0.0 else (NODES // 2, NODES)
    anchor = int(panel[ANCHOR])
    for j in range(begin, end):
        k = j - begin
        desk[BELOW, k], desk[ABOVE, k], desk[SINE, k], desk[COSINE, k], desk[SPEED, k] = place(
            loop, anchor, distance(panel, points[j])
        )
    rates(code, result, constants, loop, desk, end - begin, work)
    for j in range(begin, end):
        values[j] = desk[VALUE, j - begin]
        if end - begin < NODES:
            values[NODES - 1 - j] = values[j]


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
    desk: FloatArray,
    work: FloatArray,
) -> tuple[int, float]:
    """Fill the table of panels; return their number and the length of time.

    For a libration they cover 0 ≤ u ≤ 1, half a period. The number is 0 if dt/du is not resolved.
    """
    waiting = np.empty((MAX_PANELS, 6))
    scratch = np.empty((3, NODES + 2))
    values, series = np.empty(NODES), np.empty(NODES + 2)
    pending = _first_panels(loop[curve.ROTATES] != 0.0, waiting)
    number, length, left_out = 0, 0.0, 0.0
    while pending:
        pending -= 1
        before = waiting[pending, BEFORE]
        if number == MAX_PANELS:
            return 0, math.nan
        panel = panels[number]
        panel[:START] = waiting[pending, :START]
        half = 0.5 * (panel[HIGH] - panel[LOW])
        _rates_at_nodes(code, result, constants, loop, points, panel, desk, work, values)
        series[:] = 0.0
        for j in range(NODES):
            for k in range(NODES):
                series[k] += matrix[j, k] * values[j]
        largest = 0.0
        for k in range(NODES):
            largest = max(largest, abs(series[k]))
        if not largest < math.inf or math.isnan(series[NODES - 1]):
            return 0, math.nan
        tail = max(abs(series[NODES - 1]), abs(series[NODES - 2]))
        # A tail that halving does not shrink is rounding, once it is small.
        is_noise = tail > 0.25 * before and tail < NOISE * largest
        if tail * half > tolerance * (length + largest * half) and not is_noise and half > NARROWEST:
            if number + pending + 2 > MAX_PANELS:
                return 0, math.nan
            _split(panel, tail, waiting, pending)
            pending += 2
            continue
        panel[TIMES] = 0.0
        for k in range(1, NODES + 1):
            before_it = 2.0 * series[0] if k == 1 else series[k - 1]
            panel[TIMES + k] = half * (before_it - series[k + 1]) / (2.0 * k)
        for k in range(NODES):
            panel[SLOPES + k] = half * series[k]
        begin, _ = at(panel, panel[FIRST])
        panel[TIMES] = -begin
        end, _ = at(panel, panel[LAST])
        panel[START], panel[START_LO] = length, left_out
        panel[LENGTH] = end
        _prepare_guess(panel, scratch)
        length, rest = two_sum(length, end)
        left_out += rest
        number += 1
    return number, length


@kernel
def time_at(panels: FloatArray, number: int, u: float) -> tuple[float, float]:
    """Return the time at the phase u, and what it leaves out."""
    for n in range(number):
        panel = panels[n]
        w = u - 0.5 * panel[ANCHOR]
        if n == number - 1 or w <= (panel[HIGH] if panel[LAST] == 1.0 else 0.0):
            x = ((w - panel[LOW]) - (panel[HIGH] - w)) / (panel[HIGH] - panel[LOW])
            value, _ = at(panel, min(panel[LAST], max(panel[FIRST], x)))
            time, rest = two_sum(panel[START], value)
            return time, rest + panel[START_LO]
    return math.nan, 0.0


@inlined
def series_at(panel: FloatArray, x: float) -> tuple[float, float]:
    """Return t − START and dt/dx at x, by Clenshaw's recurrence for both at once."""
    twice = 2.0 * x
    b1, b2 = panel[TIMES + NODES], 0.0
    c1, c2 = 0.0, 0.0
    for k in range(NODES - 1, 0, -1):
        b1, b2 = (panel[TIMES + k] - b2) + twice * b1, b1
        c1, c2 = (panel[SLOPES + k] - c2) + twice * c1, c1
    return panel[TIMES] + x * b1 - b2, panel[SLOPES] + x * c1 - c2
