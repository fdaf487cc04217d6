"""Time as a function of the phase by Chebyshev series on panels, and how these are built.

A panel is halved until its series ends.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.curve import place, rates
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import MAX_PANELS, NODES, Cut, Formula, Loop, Panel, Records
from workers.solvers.compiled.workspace import Places, Workspace, two_sum

FloatArray = NDArray[np.float64]
NARROWEST_HALF_PANEL = 2.0**-44
NOISE_SHARE = 1e-7


def nodes() -> FloatArray:
    """Return cos(π (j + 1/2) / NODES): from almost 1 down to almost −1."""
    j = np.arange(NODES)
    return np.sin(np.pi * (NODES - 1 - 2 * j) / (2 * NODES))


POINTS = nodes()


@inlined
def larger(one: float, other: float) -> float:
    """Return the larger of two numbers, NaN if either is: ``max`` drops it by its place."""
    return other if other > one or np.isnan(other) else one


@inlined
def last_coefficients(series: FloatArray) -> float:
    """Return the size of what a series of NODES coefficients leaves out, judged by how its coefficients fall.

    The largest of the last two may be small by chance: on a panel that is symmetric about its anchor the odd
    ones vanish, and one number is left. So the pairs before it count too, as they fall from one to the next,
    and what is left out is not taken to be less than they lead to expect. Evidence, no bound.
    """
    last = larger(abs(series[NODES - 1]), abs(series[NODES - 2]))
    before = larger(abs(series[NODES - 3]), abs(series[NODES - 4]))
    first = larger(abs(series[NODES - 5]), abs(series[NODES - 6]))
    expected = before if before >= first else before * (before / first)
    return larger(last, expected)


@inlined
def distance(panel: Panel, x: float) -> float:
    """Return the distance to the anchor at x; exact next to an anchor at one of the ends."""
    return float(0.5 * (panel.low * (1.0 - x) + panel.high * (1.0 + x)))


@kernel
def at(panel: Panel, x: float) -> tuple[float, float]:
    """Return what :func:`series_at` does, for one place: code that is shared."""
    return series_at(panel, x)


@kernel
def time_at(panels: Records, number: int, u: float) -> tuple[float, float]:
    """Return the time at the phase u, and what it leaves out."""
    for n in range(number):
        panel = panels[n]
        w = u - 0.5 * panel.anchor
        if n == number - 1 or w <= (panel.high if panel.last == 1.0 else 0.0):
            x = ((w - panel.low) - (panel.high - w)) / (panel.high - panel.low)
            value, _ = at(panel, min(panel.last, max(panel.first, x)))
            time, rest = two_sum(panel.start, value)
            return time, rest + panel.start_lo
    return math.nan, 0.0


@inlined
def series_at(panel: Panel, x: float) -> tuple[float, float]:
    """Return t − START and dt/dx at x, by Clenshaw's recurrence for both at once."""
    twice = 2.0 * x
    b1, b2 = panel.times[NODES], 0.0
    c1, c2 = 0.0, 0.0
    for k in range(NODES - 1, 0, -1):
        b1, b2 = (panel.times[k] - b2) + twice * b1, b1
        c1, c2 = (panel.slopes[k] - c2) + twice * c1, c1
    return panel.times[0] + x * b1 - b2, panel.slopes[0] + x * c1 - c2


@inlined
def slope_at(panel: Panel, x: float) -> float:
    """Return dt/dx at x alone, with the bits that :func:`series_at` has."""
    twice = 2.0 * x
    c1, c2 = 0.0, 0.0
    for k in range(NODES - 1, 0, -1):
        c1, c2 = (panel.slopes[k] - c2) + twice * c1, c1
    return float(panel.slopes[0] + x * c1 - c2)


def cosines() -> FloatArray:
    """Return the matrix, transposed, that turns values at cos(π (j + 1/2) / NODES) into a series."""
    k, j = np.meshgrid(np.arange(NODES), np.arange(NODES), indexing="ij")
    matrix = np.cos(np.pi * (k * (2 * j + 1) % (4 * NODES)) / (2 * NODES)) * (2.0 / NODES)
    matrix[0] *= 0.5
    return np.ascontiguousarray(matrix.T)


MATRIX = cosines()


@kernel
def _prepare_guess(panel: Panel, scratch: FloatArray) -> None:
    """Interpolate the inverse function and its slope at the ends and in the middle (Hermite)."""
    first, last, length = panel.first, panel.last, panel.length
    middle = 0.5 * (first + last)
    _, slope_first = at(panel, first)
    at_middle, slope_middle = at(panel, middle)
    _, slope_last = at(panel, last)
    m = at_middle / length
    z, f, slopes = scratch[0], scratch[1], scratch[2]
    z[0], z[1], z[2], z[3], z[4], z[5] = 0.0, 0.0, m, m, 1.0, 1.0
    f[0], f[1], f[2], f[3], f[4], f[5] = first, first, middle, middle, last, last
    slopes[0], slopes[1], slopes[2] = length / slope_first, length / slope_middle, length / slope_last
    panel.guess[0] = first
    panel.guess[6] = m
    for order in range(1, 6):
        for k in range(6 - order):
            if order == 1 and k % 2 == 0:
                f[k] = slopes[k // 2]
            else:
                f[k] = (f[k + 1] - f[k]) / (z[k + order] - z[k])
        panel.guess[order] = f[0]


@inlined
def _first_panels(rotates: bool, waiting: Records) -> int:
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
        top.anchor, top.low, top.high = anchor, low, high
        top.first, top.last, top.before = first, final, math.inf
        pending += 1
    return pending


@inlined
def _copy(one: Panel | Cut, to: Panel | Cut) -> None:
    """Put a panel where another was."""
    to.anchor, to.low, to.high, to.first, to.last = one.anchor, one.low, one.high, one.first, one.last


@inlined
def _split(panel: Panel, tail: float, waiting: Records, pending: int) -> None:
    """Put both parts of a panel on the stack."""
    first, final = panel.first, panel.last
    upper, lower = waiting[pending], waiting[pending + 1]
    _copy(panel, upper)
    _copy(panel, lower)
    upper.before = lower.before = tail
    if final - first < 2.0:
        outer, inner = (upper, lower) if final > 0.0 else (lower, upper)
        inner.low, inner.high = 0.5 * panel.low, 0.5 * panel.high
        outer.first, outer.last = -1.0, 1.0
        if final > 0.0:
            outer.low = 0.5 * panel.high
        else:
            outer.high = 0.5 * panel.low
        if panel.high == 0.5:
            turned = -0.5 if final > 0.0 else 0.5
            outer.anchor = 1
            outer.low += turned
            outer.high += turned
    else:
        middle = 0.5 * (panel.low + panel.high)
        upper.low, lower.high = middle, middle


@inlined
def _mirrored(values: FloatArray, begin: int, end: int) -> None:
    """Fill in the other half of the nodes, if one of them is known."""
    if end - begin < NODES:
        for j in range(begin, end):
            values[NODES - 1 - j] = values[j]


@inlined
def _by_harmonics(
    harmonics: FloatArray, panel: Panel, begin: int, end: int, places: Places, values: FloatArray
) -> None:
    """Fill in dt/du at the nodes by Clenshaw's recurrence: of its cosine series in θ = πu."""
    twice, b1, b2 = places.noise, places.rate, places.radicand
    for j in range(begin, end):
        turn = math.pi * distance(panel, POINTS[j])
        if panel.anchor == 1:
            twice[j] = -2.0 * math.sin(turn)
        else:
            root = math.sin(0.5 * turn)
            twice[j] = (2.0 - 4.0 * root * root) * (1.0 - panel.anchor)
        b1[j], b2[j] = 0.0, 0.0
    # There is an even number of them. Two at a time: numbers go through memory half as often.
    last = len(harmonics) - 1
    for j in range(begin, end):
        b1[j] = harmonics[last]
    for k in range(last - 1, 0, -2):
        upper, lower = harmonics[k], harmonics[k - 1]
        for j in range(begin, end):
            above = (upper - b2[j]) + twice[j] * b1[j]
            b1[j], b2[j] = (lower - b1[j]) + twice[j] * above, above
    for j in range(begin, end):
        values[j] = (harmonics[0] - b2[j]) + 0.5 * twice[j] * b1[j]
    _mirrored(values, begin, end)


@inlined
def _rates_at_nodes(formula: Formula, loop: Loop, panel: Panel, places: Places, values: FloatArray) -> None:
    """Fill in dt/du at the nodes, of which one half mirrors the other on half a panel."""
    begin, end = 0, NODES
    if panel.last - panel.first < 2.0:
        begin, end = (0, NODES // 2) if panel.last > 0.0 else (NODES // 2, NODES)
    if len(formula.harmonics):
        _by_harmonics(formula.harmonics, panel, begin, end, places, values)
        return
    for j in range(begin, end):
        k = j - begin
        places.below[k], places.above[k], places.sine[k], places.cosine[k], places.speed[k] = place(
            loop, panel.anchor, distance(panel, POINTS[j])
        )
    rates(formula, loop, places, end - begin)
    for j in range(begin, end):
        values[j] = places.rate[j - begin]
    _mirrored(values, begin, end)


@kernel
def place_among(cuts: Records, count: int, panel: Panel) -> int:
    """Return where a panel is among others, −1 if it is not there."""
    for k in range(count):
        if cuts[k].anchor == panel.anchor and cuts[k].low == panel.low and cuts[k].high == panel.high:
            return k
    return -1


@kernel
def build_panels(
    formula: Formula,
    loop: Loop,
    tolerance: float,
    panels: Records,
    workspace: Workspace,
    forced: int,
    kept: Records,
    squares: FloatArray,
) -> tuple[int, float]:
    """Fill the table of panels, and the series of 1/f² if there is room; cut the ``forced`` coarse ones.

    The ``kept`` panels were built before. ``proved`` is NaN for the others.
    """
    waiting = workspace.waiting
    scratch = np.empty((3, NODES + 2))
    values, series = np.empty(NODES), np.empty(NODES + 2)
    pending = _first_panels(loop.rotates, waiting)
    number, length, left_out = 0, 0.0, 0.0
    while pending:
        pending -= 1
        before = waiting[pending].before
        if number == MAX_PANELS:
            return 0, math.nan
        panel = panels[number]
        _copy(waiting[pending], panel)
        half = 0.5 * (panel.high - panel.low)
        if place_among(workspace.coarse, forced, panel) >= 0:
            if number + pending + 2 > MAX_PANELS or half <= NARROWEST_HALF_PANEL:
                return 0, math.nan
            _split(panel, math.inf, waiting, pending)
            pending += 2
            continue
        known = place_among(kept, len(kept), panel)
        if known >= 0:
            panels[number] = kept[known]
            panel.start, panel.start_lo = length, left_out
            length, rest = two_sum(length, panel.length)
            left_out += rest
            number += 1
            continue
        _rates_at_nodes(formula, loop, panel, workspace.places, values)
        series[:] = 0.0
        for j in range(NODES):
            for k in range(NODES):
                series[k] += MATRIX[j, k] * values[j]
        largest = 0.0
        for k in range(NODES):
            largest = max(largest, abs(series[k]))
        if not largest < math.inf or math.isnan(series[NODES - 1]):
            return 0, math.nan
        tail = last_coefficients(series)
        # A tail that halving does not shrink is rounding, once it is small.
        is_noise = tail > 0.25 * before and tail < NOISE_SHARE * largest
        is_open = tail * half > tolerance * (length + largest * half) and not is_noise
        if is_open and half > NARROWEST_HALF_PANEL:
            if number + pending + 2 > MAX_PANELS:
                return 0, math.nan
            _split(panel, tail, waiting, pending)
            pending += 2
            continue
        if len(squares) > 0:
            inverse_squares = squares[number]
            inverse_squares[:] = 0.0
            for j in range(NODES):
                value = 1.0 / (values[j] * values[j])
                for k in range(NODES):
                    inverse_squares[k] += MATRIX[j, k] * value
        panel.times[0] = 0.0
        for k in range(1, NODES + 1):
            before_it = 2.0 * series[0] if k == 1 else series[k - 1]
            panel.times[k] = half * (before_it - series[k + 1]) / (2.0 * k)
        for k in range(NODES):
            panel.slopes[k] = half * series[k]
        begin, _ = at(panel, panel.first)
        panel.times[0] = -begin
        end, _ = at(panel, panel.last)
        panel.start, panel.start_lo = length, left_out
        panel.length, panel.proved = end, math.nan
        _prepare_guess(panel, scratch)
        length, rest = two_sum(length, end)
        left_out += rest
        number += 1
    return number, length
