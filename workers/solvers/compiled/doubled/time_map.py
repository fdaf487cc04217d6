"""A time map whose rate keeps all digits of doubles, and whose period keeps twice as many.

Between rest points v = m − h cos θ, θ = πu, and f = dt/du is an analytic, even function of θ of period 2π, a
cosine series. With K = P/((v − v₋)(v₊ − v)) and the ends known to twice the digits, f keeps its digits next
to them. Its mean over n places θ = (j + ½)π/n is half a period up to the harmonics 2n, 4n, … of f, which are
far smaller than the last ones that n places tell. That they fall off like those before is evidence, no bound:
this is for sums of low powers (:func:`.is_of_low_degree`), which have no other features.
"""

import math

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.compiled.doubled.arithmetic import (
    ANGLE,
    BELOW,
    COSINE,
    RADICAND,
    ROWS,
    SLOPED,
    SQUARE,
    DoubledCurve,
    Twice,
    add,
    curve_of,
    divide,
    doubled,
    ends_of,
    multiply,
    quick_sum,
    quotients_doubled,
    root,
    roundings_of,
    scale,
    sine_and_cosine,
    subtract,
)
from workers.solvers.compiled.evaluation.curve import is_of_low_degree, place
from workers.solvers.compiled.evaluation.program import REST_OF_PI
from workers.solvers.compiled.kernels import fused, kernel
from workers.solvers.compiled.records import Formula, Found, Loop, Panel, Records
from workers.solvers.compiled.time_map.error import add_roundings
from workers.solvers.compiled.time_map.panels import at, build_panels, distance, larger, time_at
from workers.solvers.compiled.time_map.sampling import extent
from workers.solvers.compiled.windows.arcs import POINT
from workers.solvers.compiled.workspace import Places, Workspace, two_sum

FloatArray = NDArray[np.float64]
FEWEST_PLACES, MOST_PLACES = 48, 384
"""Places."""
PLACES_TOGETHER = 48
RESOLVED_HARMONIC = 2.0**-51
"""The last harmonics against the mean, from which on the series is that of doubles."""
LASTING_MEAN_ERROR = 2e-25
"""Error of half a period, against it, for which twice as many places are taken."""
UNRESOLVED_HARMONIC = 1e-4
"""The same, above which twice as many places are too few."""
LAST_HARMONICS = 4
"""Harmonics of which the largest counts."""
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


def _tables() -> tuple[FloatArray, FloatArray]:
    with ctx.workprec(160):
        cosines = [doubled((arb.pi() * t / (2 * MOST_PLACES)).cos()) for t in range(4 * MOST_PLACES)]
        over = [doubled(1 / (arb.pi() * max(k, 1))) for k in range(MOST_PLACES)]
    return np.array(cosines), np.array(over)


COSINES, OVER = _tables()
"""At multiples of π/(2 MOST_PLACES), a turn in all; and 1/(kπ)."""


@kernel
def rates_doubled(
    formula: Formula,
    loop: Loop,
    curve: DoubledCurve,
    ends: tuple[Twice, Twice],
    pairs: FloatArray,
    count: int,
    rates: FloatArray,
) -> None:
    """Fill in dt/du, a column and its rest, at places whose v is known."""
    numerator = multiply((math.pi, REST_OF_PI), curve.z)
    quotients_doubled(formula, loop, curve, pairs, count)
    for m in range(count):
        at = (pairs[ANGLE, m], pairs[ANGLE + 1, m])
        cosine = (pairs[COSINE, m], pairs[COSINE + 1, m])
        both = multiply(subtract(at, ends[0]), subtract(ends[1], at))
        # 1/c² = cos² v/g2²: of all quotients there is one left.
        above = multiply(multiply(both, multiply(cosine, cosine)), (pairs[BELOW, m], pairs[BELOW + 1, m]))
        square = (pairs[SQUARE, m], pairs[SQUARE + 1, m])
        below = multiply((pairs[SLOPED, m], pairs[SLOPED + 1, m]), square)
        rates[m, 0], rates[m, 1] = multiply(numerator, root(divide(above, below)))


@kernel
def _errors_of(
    formula: Formula,
    loop: Loop,
    ends: tuple[Twice, Twice],
    off: float,
    pairs: FloatArray,
    count: int,
    places: Places,
    rates: FloatArray,
) -> float:
    """Return the sum of the errors of rates, by roundings and by what the ends are off."""
    roundings_of(formula, loop, pairs, count, places)
    errors = 0.0
    for m in range(count):
        near, far = pairs[ANGLE, m] - ends[0][0], ends[1][0] - pairs[ANGLE, m]
        relative = places.bound[m] / abs(pairs[RADICAND, m]) + 2.0 * off * (1.0 / near + 1.0 / far)
        errors += rates[m, 0] * (0.5 * relative + 2.0**-98)
    return errors


@kernel
def _put_angles(ends: tuple[Twice, Twice], number: int, first: int, count: int, pairs: FloatArray) -> None:
    """Put v = m − h cos θ into the workspace, θ = (j + ½)π/n from j = ``first``."""
    middle, half = add(ends[0], ends[1]), subtract(ends[1], ends[0])
    middle, half = (0.5 * middle[0], 0.5 * middle[1]), (0.5 * half[0], 0.5 * half[1])
    for m in range(count):
        t = (2 * (first + m) + 1) * (MOST_PLACES // number)
        cosine = (COSINES[t, 0], COSINES[t, 1])
        at = subtract(middle, multiply(half, cosine))
        pairs[ANGLE, m], pairs[ANGLE + 1, m] = at


@kernel
def _fold(rates: FloatArray, number: int, mean: Twice, folded: FloatArray) -> None:
    """Put sums and differences of the rates, their mean less, at places as far from the middle.

    Harmonics are sums of the ones if they are even, of the others if they are odd: two rows each, with rests.
    """
    for j in range(number // 2):
        one = subtract((rates[j, 0], rates[j, 1]), mean)
        other = subtract((rates[number - 1 - j, 0], rates[number - 1 - j, 1]), mean)
        folded[0, j], folded[1, j] = add(one, other)
        folded[2, j], folded[3, j] = subtract(one, other)


@kernel
def _largest_harmonic(folded: FloatArray, number: int, end: int) -> float:
    """Return the largest of the harmonics before ``end``, to the digits of the rates."""
    largest = 0.0
    stride = MOST_PLACES // number
    for k in range(end - LAST_HARMONICS, end):
        row, total = 2 * (k % 2), (0.0, 0.0)
        for j in range(number // 2):
            t = k * (2 * j + 1) * stride % (4 * MOST_PLACES)
            value = (folded[row, j], folded[row + 1, j])
            total = add(total, multiply(value, (COSINES[t, 0], COSINES[t, 1])))
        largest = max(largest, 2.0 * abs(total[0]) / number)
    return largest


@kernel
def _fill_series(folded: FloatArray, number: int, mean: Twice, series: FloatArray, times: FloatArray) -> None:
    """Fill in all harmonics a_k, as doubles, and a_k/(kπ) with twice the digits, a row and its rest."""
    stride, last = MOST_PLACES // number, 4 * MOST_PLACES
    share = divide((2.0, 0.0), (float(number), 0.0))
    series[0] = mean[0]
    for k in range(1, number):
        row, total, rest = 2 * (k % 2), 0.0, 0.0
        t, step = k * stride, 2 * k * stride
        for j in range(number // 2):
            high, c = folded[row, j], COSINES[t, 0]
            product = high * c
            rest += fused(high, c, -product) + (high * COSINES[t, 1] + folded[row + 1, j] * c)
            total, left = two_sum(total, product)
            rest += left
            t += step
            t -= last if t >= last else 0
        part = multiply(quick_sum(total, rest), share)
        series[k] = part[0]
        times[0, k], times[1, k] = multiply(part, (OVER[k, 0], OVER[k, 1]))


@kernel
def time_of(times: FloatArray, length: int, mean: Twice, u: float) -> Twice:
    """Return the time from 0 to ``u``, a multiple of 1/256, by the series of the rate."""
    total, parts = scale(mean, u), int(2 * MOST_PLACES * u)
    # sin kπu = cos(kπu − π/2).
    t = 3 * MOST_PLACES
    high, rest = total
    for k in range(1, length):
        t += parts
        t -= 4 * MOST_PLACES if t >= 4 * MOST_PLACES else 0
        one, c = times[0, k], COSINES[t, 0]
        product = one * c
        rest += fused(one, c, -product) + (one * COSINES[t, 1] + times[1, k] * c)
        high, left = two_sum(high, product)
        rest += left
    return quick_sum(high, rest)


@kernel
def find_harmonics(
    formula: Formula,
    loop: Loop,
    curve: DoubledCurve,
    ends: tuple[Twice, Twice],
    off: float,
    pairs: FloatArray,
    places: Places,
    series: FloatArray,
    times: FloatArray,
) -> tuple[int, Twice, float, float]:
    """Fill in the cosine series of dt/du, and that of t.

    Return its length (0: none), its mean, the error of that, and that of :func:`time_of`.
    """
    rates, folded = np.empty((MOST_PLACES, 2)), np.empty((4, MOST_PLACES // 2))
    number = FEWEST_PLACES
    while number <= MOST_PLACES:
        errors, total = 0.0, (0.0, 0.0)
        for first in range(0, number, PLACES_TOGETHER):
            count = min(PLACES_TOGETHER, number - first)
            _put_angles(ends, number, first, count, pairs)
            here = rates[first : first + count]
            rates_doubled(formula, loop, curve, ends, pairs, count, here)
            errors += _errors_of(formula, loop, ends, off, pairs, count, places, here)
        for j in range(number):
            total = add(total, (rates[j, 0], rates[j, 1]))
        mean = divide(total, (float(number), 0.0))
        _fold(rates, number, mean, folded)
        last = _largest_harmonic(folded, number, number)
        if not last < math.inf:
            return 0, mean, math.nan, math.nan
        before = _largest_harmonic(folded, number, number - number // 4)
        # From n to 2n they fall as from 3n/4 to n, four times over: half of that is kept.
        fall = min(1.0, last / before) if before > 0.0 else 1.0
        # Half as many again would do for some, but only twice as many are there.
        is_fine = 4.0 * last * fall * fall <= LASTING_MEAN_ERROR * mean[0] or number == MOST_PLACES
        if last <= RESOLVED_HARMONIC * mean[0] and is_fine:
            _fill_series(folded, number, mean, series, times)
            rounding = errors / number + 2.0**-98 * mean[0]
            # Σ|a_k| (1/(kπ) + 1/((2n − k)π)) over what is left out, and interpolated: while a quarter of n
            # harmonics falls to 7/8 at least, it is below 3 of the last.
            return number, mean, 4.0 * last * fall * fall + rounding, 4.0 * (last + rounding)
        number *= 4 if last > UNRESOLVED_HARMONIC * mean[0] else 2
    return 0, (math.nan, 0.0), math.nan, math.nan


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
