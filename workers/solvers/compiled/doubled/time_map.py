"""Builds a time map whose rate keeps all digits of doubles, and whose period keeps twice as many."""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.compiled.doubled.arithmetic import Twice, add, scale, sine_and_cosine, subtract
from workers.solvers.compiled.doubled.curve import ANGLE, ROWS, DoubledCurve, curve_of, ends_of
from workers.solvers.compiled.doubled.harmonics import (
    MOST_PLACES,
    PLACES_TOGETHER,
    find_harmonics,
    rates_doubled,
    time_of,
)
from workers.solvers.compiled.evaluation.curve import place
from workers.solvers.compiled.evaluation.low_degree import is_of_low_degree
from workers.solvers.compiled.evaluation.program import REST_OF_PI
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula, Found, Loop, Panel, Records
from workers.solvers.compiled.time_map.error import add_roundings
from workers.solvers.compiled.time_map.panels import build_panels
from workers.solvers.compiled.time_map.sampling import extent
from workers.solvers.compiled.time_map.series import at, distance, larger, time_at
from workers.solvers.compiled.windows.arcs import POINT
from workers.solvers.compiled.workspace import Workspace

FloatArray = NDArray[np.float64]

COMPARED_SHARES = (0.23, 0.71)
"""Shares of the lengths of panels, in turn, at which their series are compared with the formula."""
DEPARTURE_FACTOR, SERIES_ULPS = 4.0, 4.0
"""Times what is seen there; and roundings of a series at a place, in 2^-52."""
START_ULPS = 8.0
"""Roundings of the phase at the start, in 2^-52."""
LARGEST_ERROR, LARGEST_PERIOD_ERROR = 1e-9, 1e-20
"""The largest error of a variable within one period, and of the period relative to it, that is claimed."""
SYMMETRIC_SINE = 2.0**-80
"""Sine or cosine of the middle of an arc that is symmetric about a pole or the equator."""


@kernel
def map_time_doubled(
    formula: Formula, loop: Loop, tolerance: float, panels: Records, workspace: Workspace, found: Found
) -> None:
    """Build the time map, set period and origin, and say what is known.

    The number of panels is 0 where that is not as good as doubles allow, in a rotation, and where V is no sum
    of low powers: of another, a few places do not tell what is between them.
    """
    if loop.rotates or not is_of_low_degree(formula):
        return
    pairs = np.empty((ROWS, PLACES_TOGETHER + 16))
    curve = curve_of(loop)
    middle = math.atan2(loop.s_middle, loop.c_middle)
    lower, upper = middle - loop.half_width, middle + loop.half_width
    low_end, high_end, off = ends_of(formula, loop, curve, lower, upper, pairs, workspace.places)
    if not off < math.inf:
        return
    ends = (low_end, high_end)
    _set_ends(loop, curve, ends)
    series, times = np.empty(MOST_PLACES), np.empty((2, MOST_PLACES))
    length, mean, error, left = find_harmonics(
        formula, loop, curve, ends, off, pairs, workspace.places, series, times
    )
    if length == 0:
        return
    known = Formula(
        formula.code,
        formula.result,
        formula.turn,
        formula.constants,
        formula.lows,
        formula.registers,
        formula.discs,
        series[:length],
    )
    squares = np.empty((0, 1))
    number, total = build_panels(known, loop, tolerance, panels, workspace, 0, panels[:0], squares)
    if number == 0:
        return
    loop.period_hi, loop.period_lo = 2.0 * mean[0], 2.0 * mean[1]
    worst = _worst_seen(formula, loop, curve, ends, panels, number) + SERIES_ULPS * EPSILON
    astray = np.empty(number)
    _set_starts(times, length, mean, worst, left, panels, number, astray)
    is_symmetric = loop.s_middle == 0.0 or loop.c_middle == 0.0
    is_between = loop.start != 0.0 and loop.start != 1.0 and not (is_symmetric and loop.start == 0.5)
    if is_between:
        loop.start = _start_between(loop, ends)
        loop.origin, loop.origin_lo = time_at(panels, number, loop.start)
    else:
        # An end, or the middle: not by way of a panel, whose time is off there.
        loop.origin, loop.origin_lo = time_of(times, length, mean, loop.start)
    loop.backwards = loop.sense < 0.0
    found.rate_error = worst
    found.speed, found.largest, found.moved = extent(loop, panels, number, workspace.moments, astray)
    found.period, found.period_error = loop.period_hi, 2.0 * error
    found.time_error = left
    if is_between:
        # Of the time at the start, which is that of all.
        found.time_error += START_ULPS * EPSILON * _rate_at(panels, number, loop.start) + _largest_of(astray)
    # The series are all of one function: their lengths are its mean, up to roundings.
    is_one = abs((total - mean[0]) - mean[1]) <= 2.0 * worst * mean[0]
    is_exact = found.period_error <= LARGEST_PERIOD_ERROR * found.period
    within = found.time_error * found.speed + found.moved + worst * found.largest
    if is_one and is_exact and within <= LARGEST_ERROR:
        found.panels = number


@kernel
def _set_starts(
    times: FloatArray,
    length: int,
    mean: Twice,
    worst: float,
    left: float,
    panels: Records,
    number: int,
    astray: FloatArray,
) -> None:
    """Set the times at which panels start to those of the whole series; fill in what times on each are off.

    So errors of rates do not add up: within a panel a time is off by what it has passed there. A panel that
    starts at no multiple of the series' angles goes on from the one before.
    """
    for n in range(number):
        panel = panels[n]
        u = 0.5 * panel.anchor + (0.0 if panel.first == 0.0 else panel.low)
        parts, before = 2 * MOST_PLACES * u, 0.0
        if parts == math.floor(parts):
            panel.start, panel.start_lo = time_of(times, length, mean, u)
        else:
            one = panels[n - 1]
            panel.start, panel.start_lo = add((one.start, one.start_lo), (one.length, 0.0))
            before = astray[n - 1] - left
        astray[n] = before + worst * panel.length + left
    add_roundings(panels, number, astray)


@kernel
def _largest_of(values: FloatArray) -> float:
    largest = 0.0
    for value in values:
        largest = larger(largest, value)
    return largest


@kernel
def _start_between(loop: Loop, ends: tuple[Twice, Twice]) -> float:
    """Return u at a start between the ends, which doubles had not known as well."""
    quarter = (0.5 * math.pi, 0.5 * REST_OF_PI)
    at = (loop.place, 0.0)
    if loop.kind != POINT:
        # On the equator.
        at = scale(quarter, math.floor(loop.place / quarter[0] + 0.5))
    near, far = subtract(at, ends[0])[0], subtract(ends[1], at)[0]
    if not (near > 0.0 and far > 0.0):
        return math.nan
    return 2.0 / math.pi * math.atan2(math.sqrt(near), math.sqrt(far))


@kernel
def _set_ends(loop: Loop, curve: DoubledCurve, ends: tuple[Twice, Twice]) -> None:
    """Round what the loop is made of, once."""
    loop.z, loop.g = curve.z[0], curve.g[0]
    loop.half_width = 0.5 * subtract(ends[1], ends[0])[0]
    sine, cosine = sine_and_cosine(ends[0])
    loop.s_lower, loop.c_lower = sine[0], cosine[0]
    sine, cosine = sine_and_cosine(ends[1])
    loop.s_upper, loop.c_upper = sine[0], cosine[0]
    sine, cosine = sine_and_cosine(scale(add(ends[0], ends[1]), 0.5))
    loop.s_middle, loop.c_middle = sine[0], cosine[0]
    if abs(cosine[0]) < SYMMETRIC_SINE:
        loop.s_middle, loop.c_middle = math.copysign(1.0, sine[0]), 0.0
    elif abs(sine[0]) < SYMMETRIC_SINE:
        loop.s_middle, loop.c_middle = 0.0, math.copysign(1.0, cosine[0])


@kernel
def _x_of(panel: Panel, n: int) -> float:
    return float(panel.first + (panel.last - panel.first) * COMPARED_SHARES[n % 2])


@kernel
def _worst_seen(
    formula: Formula, loop: Loop, curve: DoubledCurve, ends: tuple[Twice, Twice], panels: Records, number: int
) -> float:
    """Return what is to be counted of the largest departure of the series from the rate of the formula."""
    pairs, rates = np.empty((ROWS, PLACES_TOGETHER + 16)), np.empty((PLACES_TOGETHER, 2))
    worst = 0.0
    for begin in range(0, number, PLACES_TOGETHER):
        count = min(PLACES_TOGETHER, number - begin)
        for m in range(count):
            panel = panels[begin + m]
            x = _x_of(panel, begin + m)
            below, above, _, _, _ = place(loop, panel.anchor, distance(panel, x))
            is_low = below < above
            v = add(ends[0], (below, 0.0)) if is_low else subtract(ends[1], (above, 0.0))
            pairs[ANGLE, m], pairs[ANGLE + 1, m] = v
        rates_doubled(formula, loop, curve, ends, pairs, count, rates)
        for m in range(count):
            panel = panels[begin + m]
            _, slope = at(panel, _x_of(panel, begin + m))
            seen = abs(slope / (0.5 * (panel.high - panel.low)) / rates[m, 0] - 1.0)
            if not seen <= worst:
                worst = seen
    return DEPARTURE_FACTOR * worst


@kernel
def _rate_at(panels: Records, number: int, u: float) -> float:
    """Return dt/du at u, from the panel that holds it."""
    begin, end = max(u - 2.0**-20, 0.0), min(u + 2.0**-20, 1.0)
    before, _ = time_at(panels, number, begin)
    after, _ = time_at(panels, number, end)
    return float((after - before) / (end - begin))
