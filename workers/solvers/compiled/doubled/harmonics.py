r"""The rate dt/du of a libration as a cosine series, and its period with twice the digits.

Between rest points v = m − h cos θ, θ = πu, and f = dt/du is an analytic, even function of θ of period 2π.
With K = P/((v − v₋)(v₊ − v)) and the ends known to twice the digits, f keeps its digits next to them. Its
mean over n places θ = (j + ½)π/n is half a period up to the harmonics 2n, 4n, … of f, which are far smaller
than the last ones that n places tell. That they fall off like those before is evidence, no bound: this is for
sums of low powers (:mod:`.evaluation.low_degree`), which have no other features.
"""

import math

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from workers.solvers.compiled.blocks import two_sum
from workers.solvers.compiled.doubled.arithmetic import (
    Twice,
    add,
    divide,
    doubled,
    multiply,
    quick_sum,
    root,
    scale,
    subtract,
)
from workers.solvers.compiled.doubled.curve import (
    ANGLE,
    BELOW,
    COSINE,
    RADICAND,
    SLOPED,
    SQUARE,
    DoubledCurve,
    quotients_doubled,
    roundings_of,
)
from workers.solvers.compiled.evaluation.program import REST_OF_PI
from workers.solvers.compiled.kernels import fused, kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import Places

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
def _largest_of(folded: FloatArray, number: int, end: int) -> float:
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
        last = _largest_of(folded, number, number)
        if not last < math.inf:
            return 0, mean, math.nan, math.nan
        before = _largest_of(folded, number, number - number // 4)
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
