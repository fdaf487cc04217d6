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
from workers.solvers.compiled.general.series import STATE
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.shown.gradients import WIDTH
from workers.solvers.compiled.shown.states import evaluate, largest_rates
from workers.solvers.compiled.shown.stretches import (
    COUNT,
    DEEPEST,
    HIGHEST_DEGREE,
    PARTS,
    TAIL,
    are_explained,
    disc_of,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HALF = INTERVALS // 2
"""Place of the middle among the points; those before it have positive x."""
NODES = chebyshev_points(INTERVALS)
_VALUES = np.polynomial.chebyshev.chebvander(NODES, HIGHEST_DEGREE).T[:, : HALF + 1]
EVEN_VALUES, ODD_VALUES = np.ascontiguousarray(_VALUES[::2]), np.ascontiguousarray(_VALUES[1::2])
"""T_k at the points from 1 down to 0, rows by k."""
_SERIES = chebyshev_coefficients(np.eye(COUNT)).T[: HALF + 1]
EVEN_SERIES, ODD_SERIES = np.ascontiguousarray(_SERIES[:, ::2]), np.ascontiguousarray(_SERIES[:, 1::2])
"""Coefficients of what is 1 at one of these points, rows by the point."""
EVEN, ODD = HALF + 1, HALF
"""How many coefficients there are of each kind."""
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
def _whole_states(series: FloatArray, states: FloatArray, even: FloatArray, odd: FloatArray) -> None:
    """Fill in the values at the nodes of a whole piece."""
    count = series.shape[1]
    for a in range(STATE):
        even[:], odd[:] = 0.0, 0.0
        for n in range((count + 1) // 2):
            x = series[a, 2 * n]
            for m in range(HALF + 1):
                even[m] += EVEN_VALUES[n, m] * x
        for n in range(count // 2):
            x = series[a, 2 * n + 1]
            for m in range(HALF + 1):
                odd[m] += ODD_VALUES[n, m] * x
        for m in range(HALF + 1):
            states[a, m] = even[m] + odd[m]
            states[a, INTERVALS - m] = even[m] - odd[m]


@kernel
def _part_states(series: FloatArray, middle: float, half: float, states: FloatArray) -> None:
    """Fill in the values at the nodes of a part of a piece."""
    for m in range(COUNT):
        x = middle + half * NODES[m]
        before, now = 1.0, x
        for a in range(STATE):
            states[a, m] = series[a, 0]
        for k in range(1, series.shape[1]):
            for a in range(STATE):
                states[a, m] += now * series[a, k]
            before, now = now, 2.0 * x * now - before


@kernel
def _to_series(values: FloatArray, a: int, even: FloatArray, odd: FloatArray) -> None:
    """Fill in the even and the odd coefficients of a row of values at the nodes."""
    even[:], odd[:] = 0.0, 0.0
    for m in range(HALF):
        x, y = values[a, m], values[a, INTERVALS - m]
        plus, minus = x + y, x - y
        for n in range(EVEN):
            even[n] += EVEN_SERIES[m, n] * plus
        for n in range(ODD):
            odd[n] += ODD_SERIES[m, n] * minus
    x = values[a, HALF]
    for n in range(EVEN):
        even[n] += EVEN_SERIES[HALF, n] * x


@kernel
def _gained(
    rates: FloatArray, a: int, time: float, even: FloatArray, odd: FloatArray, integral: FloatArray
) -> float:
    """Fill in the series of the integral of a row from −1 on, times ``time``; return its value at 1."""
    _to_series(rates, a, even, odd)
    whole, sign = 0.0, 1.0
    integral[1] = time * (even[0] - 0.5 * even[1])
    for n in range(1, EVEN):
        here = odd[n] if n < ODD else 0.0
        integral[2 * n] = time * (odd[n - 1] - here) / (4.0 * n)
        following = even[n + 1] if n + 1 < EVEN else 0.0
        integral[2 * n + 1] = time * (even[n] - following) / (4.0 * n + 2.0)
    integral[0] = 0.0
    for k in range(1, COUNT + 1):
        sign = -sign
        whole += integral[k]
        integral[0] -= sign * integral[k]
    return whole + integral[0]


@kernel
def hold(
    code: IntArray,
    constants: FloatArray,
    result: int,
    moments: FloatArray,
    coefficients: FloatArray,
    lengths: FloatArray,
    goal: float,
    allowed: float,
    compares: bool,
    claim: float,
    reference: FloatArray,
    slack: float,
) -> tuple[bool, float, float]:
    """Say whether a run from 0 on keeps all bounds; return the bound of |D| and the largest drift too.

    The program is that of V; shapes are (pieces, degree + 1, 6) and (pieces,), lengths having the sign of the
    time. On no stretch may D grow by more than ``allowed``. If ``compares``, D may nowhere be beyond twice
    the ``claim``, and an error ``claim`` explains what the integrals do about the ``reference``; their drift
    is that at the nodes. ``goal`` is what interpolation may leave out in all.
    """
    registers = np.empty((4, 3 + len(code), WIDTH))
    c, r = np.empty((3 + len(code), 4)), np.empty((3 + len(code), 4))
    states, rates, integrals = np.empty((STATE, WIDTH)), np.empty((STATE, WIDTH)), np.empty((3, WIDTH))
    centres, radii, bounds = np.empty(STATE), np.empty(STATE), np.empty(STATE)
    T, waiting = np.empty((HIGHEST_DEGREE + 1, 2)), np.empty((PARTS * DEEPEST + 1, 2))
    gained, lost, first, missing = np.zeros(STATE), np.zeros(STATE), np.empty(STATE), np.zeros(STATE)
    even, odd, integral, own = np.empty(EVEN), np.empty(EVEN), np.empty(COUNT + 1), np.empty(COUNT + 1)
    degrees = coefficients.shape[1]
    series = np.empty((STATE, degrees))
    share = goal / np.abs(lengths).sum()
    defect, drift, is_first = 0.0, 0.0, True
    for n in range(len(lengths)):
        for k in range(degrees):
            for a in range(STATE):
                series[a, k] = coefficients[n, k, a]
        waiting[0, 0], waiting[0, 1] = (0.0, 1.0)
        left = 1
        while left > 0:
            left -= 1
            middle, half = waiting[left, 0], waiting[left, 1]
            if half == 1.0:
                _whole_disc(series, centres, radii)
            else:
                disc_of(coefficients[n], middle, half, centres, radii, T)
            largest_rates(code, constants, result, moments, c, r, centres, radii, bounds)
            is_settled = True
            for a in range(STATE):
                is_settled = is_settled and TAIL * bounds[a] <= share
            if not is_settled:
                if half < 0.5 * PARTS ** (1.0 - DEEPEST):
                    return False, math.nan, math.nan
                for k in range(PARTS):
                    waiting[left + k, 0] = middle + (PARTS - 1.0 - 2.0 * k) * half / PARTS
                    waiting[left + k, 1] = half / PARTS
                left += PARTS
                continue
            if half == 1.0:
                _whole_states(series, states, even, odd)
            else:
                _part_states(series, middle, half, states)
            evaluate(code, constants, result, moments, registers, states, rates, integrals, COUNT)
            if compares:
                is_good, far = are_explained(
                    code, constants, result, moments, c, r, states, integrals, COUNT, claim, reference, slack
                )
                if not is_good:
                    return False, math.nan, math.nan
                drift = max(drift, far)
            time = 0.5 * lengths[n] * half
            for a in range(STATE):
                if half == 1.0:
                    own[:] = 0.0
                    for k in range(degrees):
                        own[k] = series[a, k]
                else:
                    _to_series(states, a, even, odd)
                    own[COUNT] = 0.0
                    for k in range(COUNT):
                        own[k] = even[k // 2] if k % 2 == 0 else odd[k // 2]
                step = _gained(rates, a, time, even, odd, integral)
                begin = states[a, COUNT - 1]
                own[0] -= begin
                within = 0.0
                for k in range(COUNT + 1):
                    within += abs(own[k] - integral[k])
                tail = 2.0 * abs(time) * TAIL * bounds[a]
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
