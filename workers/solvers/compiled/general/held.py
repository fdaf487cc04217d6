r"""What a run leaves of the six equations, bounded on the whole of every step, by compiled code.

The theorem, the points and the ellipse are those of :mod:`service.dynamics.defect`; what is not settled here,
or breaks a bound, is left to it. Values at points that are symmetric about the middle of a stretch are taken
together: their sum has the even part of a series, their difference the odd one.
"""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.defect.stretches import INTERVALS, RHO, ROUNDING
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
from workers.solvers.compiled.blocks import two_sum
from workers.solvers.compiled.general.rates import WIDTH, new_values, rates_at
from workers.solvers.compiled.general.records import Formula, Gradient
from workers.solvers.compiled.general.series import STATE
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.shown.states import evaluate, largest_rates
from workers.solvers.compiled.shown.stretches import (
    COUNT,
    DEEPEST,
    HIGHEST_DEGREE,
    PARTS,
    are_explained,
    disc_of,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEVELS = (16, 20, 24, 28, INTERVALS)
"""Numbers of intervals between the points: the first that leaves out no more than is allowed is taken."""
HALF = INTERVALS // 2
HALVES = np.array(LEVELS) // 2
"""Places of the middle among the points; those before it have positive x."""
TAILS = np.array([4.0 * RHO**-level / (RHO - 1.0) for level in LEVELS])
"""Of the bound of F: what interpolation leaves out at most."""


def _of_level(level: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return points, T_k at those from 1 down to 0, and the coefficients of what is 1 at one of these."""
    points = chebyshev_points(level)
    values = np.polynomial.chebyshev.chebvander(points[: level // 2 + 1], HIGHEST_DEGREE).astype(np.float64)
    return points, values, chebyshev_coefficients(np.eye(level + 1)).T[: level // 2 + 1]


def _tables() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return points, even and odd values (rows by k), even and odd coefficients (rows by the point)."""
    count, half = len(LEVELS), HALF + 1
    nodes = np.zeros((count, INTERVALS + 1))
    even, odd = np.zeros((count, HIGHEST_DEGREE // 2 + 1, half)), np.zeros((count, HIGHEST_DEGREE // 2, half))
    even_series, odd_series = np.zeros((count, half, half)), np.zeros((count, half, half))
    for n, level in enumerate(LEVELS):
        middle = level // 2
        points, values, series = _of_level(level)
        nodes[n, : level + 1] = points
        even[n, :, : middle + 1], odd[n, :, : middle + 1] = values[:, ::2].T, values[:, 1::2].T
        even_series[n, : middle + 1, : middle + 1] = series[:, ::2]
        odd_series[n, : middle + 1, :middle] = series[:, 1::2]
    return nodes, even, odd, even_series, odd_series


NODES, EVEN_VALUES, ODD_VALUES, EVEN_SERIES, ODD_SERIES = _tables()
_K = np.arange(HIGHEST_DEGREE + 1.0)
GROWTH = 0.5 * (RHO**_K + RHO**-_K) + (_K % 2 == 0)
GROWTH[0] = 0.0
"""|T_k(z) − T_k(0)| on the ellipse of a whole piece."""


@kernel
def _whole_disc(series: FloatArray, centres: FloatArray, radii: FloatArray) -> None:
    """Fill in discs that hold the six polynomials, shape (6, degree + 1), on the ellipse of a whole piece."""
    count = series.shape[1]
    for a in range(STATE):
        centre, wide, total, sign = 0.0, 0.0, 0.0, 1.0
        for k in range(count):
            size = abs(series[a, k])
            total += size
            wide += GROWTH[k] * size
            if k % 2 == 0:
                centre += sign * series[a, k]
                sign = -sign
        centres[a], radii[a] = centre, wide * (1.0 + ROUNDING) + ROUNDING * total


@kernel
def _whole_states(
    series: FloatArray, level: int, states: FloatArray, even: FloatArray, odd: FloatArray
) -> None:
    """Fill in the values at the nodes of a whole piece."""
    count, middle = series.shape[1], HALVES[level]
    even_values, odd_values = EVEN_VALUES[level], ODD_VALUES[level]
    for a in range(STATE):
        even[:], odd[:] = 0.0, 0.0
        for n in range((count + 1) // 2):
            x = series[a, 2 * n]
            for m in range(middle + 1):
                even[m] += even_values[n, m] * x
        for n in range(count // 2):
            x = series[a, 2 * n + 1]
            for m in range(middle + 1):
                odd[m] += odd_values[n, m] * x
        for m in range(middle + 1):
            states[a, m] = even[m] + odd[m]
            states[a, 2 * middle - m] = even[m] - odd[m]


@kernel
def _part_states(series: FloatArray, middle: float, half: float, level: int, states: FloatArray) -> None:
    """Fill in the values at the nodes of a part of a piece."""
    for m in range(2 * HALVES[level] + 1):
        x = middle + half * NODES[level, m]
        before, now = 1.0, x
        for a in range(STATE):
            states[a, m] = series[a, 0]
        for k in range(1, series.shape[1]):
            for a in range(STATE):
                states[a, m] += now * series[a, k]
            before, now = now, 2.0 * x * now - before


@kernel
def _to_series(values: FloatArray, level: int, even: FloatArray, odd: FloatArray) -> None:
    """Fill in the even and the odd coefficients of a row of values at the nodes."""
    even[:], odd[:] = 0.0, 0.0
    middle = HALVES[level]
    even_series, odd_series = EVEN_SERIES[level], ODD_SERIES[level]
    for m in range(middle):
        x, y = values[m], values[2 * middle - m]
        plus, minus = x + y, x - y
        for n in range(middle + 1):
            even[n] += even_series[m, n] * plus
        for n in range(middle):
            odd[n] += odd_series[m, n] * minus
    x = values[middle]
    for n in range(middle + 1):
        even[n] += even_series[middle, n] * x


@kernel
def _gained(
    rates: FloatArray, level: int, time: float, even: FloatArray, odd: FloatArray, integral: FloatArray
) -> float:
    """Fill in the series of the integral of a row from −1 on, times ``time``; return its value at 1."""
    _to_series(rates, level, even, odd)
    middle = HALVES[level]
    # The series ends there: its next coefficients are 0.
    whole, least = 0.0, 0.0
    integral[1] = time * (even[0] - 0.5 * even[1])
    for n in range(1, middle + 1):
        integral[2 * n] = time * (odd[n - 1] - odd[n]) / (4.0 * n)
        integral[2 * n + 1] = time * (even[n] - even[n + 1]) / (4.0 * n + 2.0)
    for n in range(middle + 1):
        whole += integral[2 * n + 1]
        least += integral[2 * n + 2] if n < middle else 0.0
    integral[0] = whole - least
    return 2.0 * whole


@kernel
def _level_for(bounds: FloatArray, share: float) -> int:
    """Return the number of points that leaves out no more than ``share`` in a unit of time; -1 for none."""
    for level in range(len(TAILS)):
        is_settled = True
        for a in range(STATE):
            is_settled = is_settled and TAILS[level] * bounds[a] <= share
        if is_settled:
            return level
    return -1


@kernel
def hold(
    formula: Formula,
    slopes: Gradient,
    moments: FloatArray,
    breaks: FloatArray,
    coefficients: FloatArray,
    goal: float,
    allowed: float,
    compares: bool,
    claim: float,
    reference: FloatArray,
    slack: float,
) -> tuple[bool, float, float]:
    """Say whether a run from 0 on keeps all bounds; return the bound of |D| and the largest drift too.

    Shapes are (pieces + 1,) and (pieces, degree + 1, 6). On no stretch may D grow by more than ``allowed``.
    If ``compares``, D may nowhere be beyond twice the ``claim``, and an error ``claim`` explains what the
    integrals do about the ``reference``; their drift is that at the nodes. ``goal`` is what interpolation may
    leave out in all.
    """
    code, constants, result = formula
    registers = np.empty((4, 3 + len(code), WIDTH))
    c, r = np.empty((3 + len(code), 4)), np.empty((3 + len(code), 4))
    states, rates, integrals = (
        new_values(slopes.registers, slopes.constants),
        np.empty((STATE, WIDTH)),
        np.empty((3, WIDTH)),
    )
    centres, radii, bounds = np.empty(STATE), np.empty(STATE), np.empty(STATE)
    T, waiting = np.empty((HIGHEST_DEGREE + 1, 2)), np.empty((PARTS * DEEPEST + 1, 2))
    gained, lost, first, missing = np.zeros(STATE), np.zeros(STATE), np.empty(STATE), np.zeros(STATE)
    even, odd, integral, own = (
        np.empty(HALF + 2),
        np.empty(HALF + 2),
        np.empty(COUNT + 1),
        np.empty(COUNT + 1),
    )
    degrees = coefficients.shape[1]
    if degrees > HIGHEST_DEGREE + 1:
        return False, math.nan, math.nan
    series = np.empty((STATE, degrees))
    share = goal / abs(breaks[-1])
    defect, drift, is_first = 0.0, 0.0, True
    for n in range(len(breaks) - 1):
        for k in range(degrees):
            for a in range(STATE):
                series[a, k] = coefficients[n, k, a]
        waiting[0, 0], waiting[0, 1] = 0.0, 1.0
        left = 1
        while left > 0:
            left -= 1
            middle, half = waiting[left, 0], waiting[left, 1]
            if half == 1.0:
                _whole_disc(series, centres, radii)
            else:
                disc_of(coefficients[n], middle, half, RHO, centres, radii, T)
            largest_rates(code, constants, result, moments, c, r, centres, radii, bounds)
            level = _level_for(bounds, share)
            if level < 0:
                if half < 0.5 * PARTS ** (1.0 - DEEPEST):
                    return False, math.nan, math.nan
                for k in range(PARTS):
                    waiting[left + k, 0] = middle + (PARTS - 1.0 - 2.0 * k) * half / PARTS
                    waiting[left + k, 1] = half / PARTS
                left += PARTS
                continue
            if half != 1.0:
                # What is not a whole piece has no series of its own: its points must resolve it.
                level = len(TAILS) - 1
            count = 2 * HALVES[level] + 1
            if half == 1.0:
                _whole_states(series, level, states, even, odd)
            else:
                _part_states(series, middle, half, level, states)
            if not compares:
                rates_at(slopes.code, slopes.gradient, moments, states, rates, count)
            else:
                evaluate(code, constants, result, moments, registers, states, rates, integrals, count)
                is_good, far = are_explained(
                    code, constants, result, moments, c, r, states, integrals, count, claim, reference, slack
                )
                if not is_good:
                    return False, math.nan, math.nan
                drift = max(drift, far)
            time = 0.5 * (breaks[n + 1] - breaks[n]) * half
            for a in range(STATE):
                own[:] = 0.0
                if half == 1.0:
                    for k in range(degrees):
                        own[k] = series[a, k]
                else:
                    _to_series(states[a], level, even, odd)
                    for k in range(count):
                        own[k] = even[k // 2] if k % 2 == 0 else odd[k // 2]
                integral[:] = 0.0
                step = _gained(rates[a], level, time, even, odd, integral)
                begin = states[a, count - 1]
                own[0] -= begin
                within = 0.0
                for k in range(COUNT + 1):
                    within += abs(own[k] - integral[k])
                tail = 2.0 * abs(time) * TAILS[level] * bounds[a]
                if not within + tail <= allowed:
                    return False, math.nan, math.nan
                if is_first:
                    first[a] = begin
                # D at the beginning of the stretch.
                before = (begin - first[a]) - gained[a] - lost[a]
                size = abs(before) + within + tail + missing[a]
                if not size < math.inf:
                    return False, math.nan, math.nan
                defect = max(defect, size)
                missing[a] += tail
                gained[a], rest = two_sum(gained[a], step)
                lost[a] += rest
            is_first = False
    return not compares or defect <= 2.0 * claim, defect, drift
