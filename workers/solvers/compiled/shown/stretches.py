r"""The defect of a function of time, bounded on whole stretches, by compiled code.

It is what :mod:`service.dynamics.defect` computes for a function of time that keeps its claim: pieces are cut
until F is bounded about each stretch so well that its interpolation leaves out less than the goal, D is
summed up from stretch to stretch, and the integrals are compared at all nodes. The theorem is that of
:mod:`service.dynamics.defect.stretches`, with the same points. The ellipse about a stretch is the thinnest of
several that does: the looser the goal, the thinner it may be, and the fewer stretches are cut.
"""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.defect.stretches import DEFAULT_INTERVALS, ELLIPSE_RHO, SERIES_RELATIVE_ROUNDING
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
from workers.solvers.compiled.blocks import two_sum
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Equations
from workers.solvers.compiled.shown.states import WIDTH, evaluate, integrals_on, largest_rates

FloatArray = NDArray[np.float64]

HIGHEST_DEGREE = 24
"""Highest degree of pieces; those of higher degree need more points than there are here."""
DEEPEST = 8
"""Cuts of a piece into halves."""
UNSETTLED_SHARE = 1e-12
"""Share of the time, next to poles, on which F may have no bound."""
SHORTEST_SHARE = 1e-14
"""Share of the time below which a stretch is not cut any more: nearly a rounding of its times."""
PARTS = 2
OWN_ROUNDING = 2.0**-50
"""Rounding error of a state, relative to its size."""
NODES = chebyshev_points(DEFAULT_INTERVALS)
COUNT = DEFAULT_INTERVALS + 1
RHOS = np.array([2.0, 2.5, 3.0, 3.5, ELLIPSE_RHO])
"""Sums of the semi-axes of ellipses, the thinnest first."""
TAILS = 4.0 * RHOS**-DEFAULT_INTERVALS / (RHOS - 1.0)
"""Largest truncation error of interpolation, relative to the bound of F, on each ellipse."""
_TRANSFORM = chebyshev_coefficients(np.eye(COUNT)).T
MIDDLE = DEFAULT_INTERVALS // 2
EVEN = np.ascontiguousarray(_TRANSFORM[: MIDDLE + 1, ::2])
"""Matrix from sums of values at opposite nodes (rows, the middle one last) to coefficients of even index."""
ODD = np.ascontiguousarray(_TRANSFORM[:MIDDLE, 1::2])
"""Matrix from differences of values at opposite nodes to coefficients of odd index."""
VANDER = np.ascontiguousarray(np.polynomial.chebyshev.chebvander(NODES, HIGHEST_DEGREE).T)
"""T_k at the nodes, shape (degree + 1, nodes)."""


@kernel
def disc_of(
    series: FloatArray,
    middle: float,
    half: float,
    sum_of_axes: float,
    centres: FloatArray,
    radii: FloatArray,
    T: FloatArray,
) -> None:
    """Fill in discs that hold the six polynomials, shape (degree + 1, 6), on an ellipse of a stretch."""
    count = len(series)
    # The ellipse lies in a disc of its larger semi-axis.
    s = 0.5 * (sum_of_axes + 1.0 / sum_of_axes) * half
    rho = 1.0 + s + math.sqrt(s * (2.0 + s))
    T[0, 0], T[1, 0], T[0, 1], T[1, 1] = 1.0, middle, 0.0, 1.0
    for k in range(2, count):
        T[k, 0] = 2.0 * middle * T[k - 1, 0] - T[k - 2, 0]
        T[k, 1] = 2.0 * T[k - 1, 0] + 2.0 * middle * T[k - 1, 1] - T[k - 2, 1]
    for a in range(6):
        centre, total, slope, steep, first, second, whole = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        up, upper, lower = 1.0, 1.0, 1.0
        for k in range(count):
            size = abs(series[k, a])
            centre += T[k, 0] * series[k, a]
            slope += T[k, 1] * series[k, a]
            total += size
            if k > 0:
                upper, lower = upper * sum_of_axes, lower / sum_of_axes
                # |T_k(z) − T_k(0)| on the ellipse of a whole piece.
                whole += (0.5 * (upper + lower) + (1.0 if k % 2 == 0 else 0.0)) * size
                steep += k * k * size
                first += k * k * up * size
                second += k * k * (k * k - 1.0) / 3.0 * (up / rho if k > 1 else 1.0) * size
                up *= rho
        if half == 1.0:
            wide = whole * (1.0 + SERIES_RELATIVE_ROUNDING)
        else:
            slope = abs(slope) + SERIES_RELATIVE_ROUNDING * steep
            wide = min(s * first, s * slope + 0.5 * s * s * second) * (1.0 + SERIES_RELATIVE_ROUNDING)
        centres[a], radii[a] = centre, wide + SERIES_RELATIVE_ROUNDING * total


@kernel
def _states_at_nodes(series: FloatArray, middle: float, half: float, states: FloatArray) -> None:
    count = len(series)
    states[:, :] = 0.0
    if half == 1.0:
        for a in range(6):
            for k in range(count):
                x = series[k, a]
                for m in range(COUNT):
                    states[a, m] += VANDER[k, m] * x
        return
    x, before, now = middle + half * NODES, np.ones(COUNT), middle + half * NODES
    for a in range(6):
        states[a, :COUNT] = series[0, a]
    for k in range(1, count):
        for a in range(6):
            coefficient = series[k, a]
            if coefficient != 0.0:
                for m in range(COUNT):
                    states[a, m] += now[m] * coefficient
        for m in range(COUNT):
            before[m], now[m] = now[m], 2.0 * x[m] * now[m] - before[m]


@kernel
def _transform(values: FloatArray, series: FloatArray) -> None:
    """Fill in the Chebyshev coefficients of the values at the nodes."""
    even, odd = np.zeros(MIDDLE + 1), np.zeros(MIDDLE)
    for m in range(MIDDLE):
        total, difference = (
            values[m] + values[DEFAULT_INTERVALS - m],
            values[m] - values[DEFAULT_INTERVALS - m],
        )
        for k in range(MIDDLE):
            odd[k] += ODD[m, k] * difference
        for k in range(MIDDLE + 1):
            even[k] += EVEN[m, k] * total
    for k in range(MIDDLE + 1):
        series[2 * k] = even[k] + EVEN[MIDDLE, k] * values[MIDDLE]
    for k in range(MIDDLE):
        series[2 * k + 1] = odd[k]


@kernel
def _integrate(series: FloatArray, integral: FloatArray) -> None:
    """Fill in the Chebyshev coefficients of the integral from −1 on, one more than ``series`` has."""
    at_start = 0.0
    for k in range(1, COUNT + 1):
        before = 2.0 * series[0] if k == 1 else series[k - 1]
        integral[k] = (before - (series[k + 1] if k + 1 < COUNT else 0.0)) / (2.0 * k)
        at_start += integral[k] if k % 2 == 0 else -integral[k]
    integral[0] = -at_start


@kernel
def are_explained(
    equations: Equations,
    discs: FloatArray,
    states: FloatArray,
    integrals: FloatArray,
    count: int,
    claim: float,
    reference: FloatArray,
    slack: float,
) -> tuple[bool, float]:
    """Say whether an error ``claim`` of each state explains its integrals; return the largest departure too.

    Where the kinetic energy alone does not, V and all others are bounded on discs about the state.
    """
    drift = 0.0
    centres, radii, found = np.empty(6), np.empty(6), np.empty((2, 3))
    for m in range(count):
        energy, areas, length = slack, 0.0, 0.0
        for a in range(3):
            omega, gamma = abs(states[a, m]), abs(states[3 + a, m])
            energy += claim * omega * equations.moments[a]
            areas += claim * (omega + gamma) * equations.moments[a]
            length += claim * 2.0 * gamma
        far, astray, long = (
            abs(integrals[0, m] - reference[0]),
            abs(integrals[1, m] - reference[1]),
            abs(integrals[2, m] - reference[2]),
        )
        if not (far < math.inf and astray < math.inf and long < math.inf):
            return False, math.nan
        drift = max(drift, far, astray, long)
        if far <= energy and astray <= areas and long <= length:
            continue
        for a in range(6):
            centres[a], radii[a] = states[a, m], claim + OWN_ROUNDING * abs(states[a, m])
        integrals_on(equations, discs, centres, radii, found)
        for k in range(3):
            if not abs(found[0, k] - reference[k]) <= found[1, k] + (slack if k == 0 else 0.0):
                return False, drift
    return True, drift


@kernel
def samples_are_explained(
    equations: Equations,
    samples: FloatArray,
    claim: float,
    reference: FloatArray,
    slack: float,
) -> bool:
    """Say whether an error ``claim`` explains the integrals of all samples, shape (n, 6)."""
    code = equations.gradient.code
    registers, discs = new_registers(code, 1, WIDTH), new_registers(code, 2, 1)
    states, rates, integrals = np.empty((6, WIDTH)), np.empty((6, WIDTH)), np.empty((3, WIDTH))
    for begin in range(0, len(samples), WIDTH):
        count = min(WIDTH, len(samples) - begin)
        for m in range(count):
            for a in range(6):
                states[a, m] = samples[begin + m, a]
        evaluate(equations, registers, states, rates, integrals, count)
        is_good, _ = are_explained(equations, discs, states, integrals, count, claim, reference, slack)
        if not is_good:
            return False
    return True


@kernel
def defect_and_drift(
    equations: Equations,
    coefficients: FloatArray,
    lengths: FloatArray,
    claim: float,
    goal: float,
    reference: FloatArray,
    slack: float,
) -> tuple[float, float, float]:
    """Return the bound of |D| on the whole of all pieces, the largest drift at the nodes, the settled share.

    The first two are NaN where more than UNSETTLED_SHARE of the time is not settled, as next to a pole where
    F has no bound, or an error ``claim`` does not explain what the integrals do. D stays what it is on
    stretches that are not settled.
    """
    code = equations.gradient.code
    registers, discs = new_registers(code, 1, WIDTH), new_registers(code, 2, 1)
    states, rates, integrals = np.empty((6, WIDTH)), np.empty((6, WIDTH)), np.empty((3, WIDTH))
    centres, radii, bounds = np.empty(6), np.empty(6), np.empty(6)
    T, waiting = np.empty((HIGHEST_DEGREE + 1, 2)), np.empty((PARTS * DEEPEST + 1, 2))
    gained, lost, first, missing = np.zeros(6), np.zeros(6), np.empty(6), np.zeros(6)
    series, rate, integral = np.empty(COUNT), np.empty(COUNT), np.empty(COUNT + 1)
    whole, unsettled = lengths.sum(), 0.0
    allowed = goal / whole
    # Where rates are of the size 1, a thinner ellipse leaves out too much.
    thinnest = 0
    while thinnest + 1 < len(RHOS) and not TAILS[thinnest] <= allowed:
        thinnest += 1
    defect, drift, is_first = 0.0, 0.0, True
    for n in range(len(lengths)):
        waiting[0, 0], waiting[0, 1] = 0.0, 1.0
        left = 1
        while left > 0:
            left -= 1
            middle, half = waiting[left, 0], waiting[left, 1]
            is_settled, is_bounded, level = False, True, thinnest - 1
            # Where F has no bound on one ellipse, it has none on a thicker one.
            while not is_settled and is_bounded and level + 1 < len(RHOS):
                level += 1
                disc_of(coefficients[n], middle, half, RHOS[level], centres, radii, T)
                largest_rates(equations, discs, centres, radii, bounds)
                is_settled = True
                for a in range(6):
                    is_settled = is_settled and TAILS[level] * bounds[a] <= allowed
                    is_bounded = is_bounded and bounds[a] < math.inf
            if not is_settled:
                if half < 0.5 * PARTS ** (1.0 - DEEPEST) or lengths[n] * half < SHORTEST_SHARE * whole:
                    unsettled += lengths[n] * half
                    if not unsettled <= UNSETTLED_SHARE * whole:
                        return math.nan, math.nan, 0.0
                    _states_at_nodes(coefficients[n], middle, half, states)
                    for a in range(6):
                        if is_first:
                            first[a] = states[a, COUNT - 1]
                        gained[a], rest = two_sum(gained[a], states[a, 0] - states[a, COUNT - 1])
                        lost[a] += rest
                    is_first = False
                    continue
                for k in range(PARTS):
                    waiting[left + k, 0] = middle + (PARTS - 1.0 - 2.0 * k) * half / PARTS
                    waiting[left + k, 1] = half / PARTS
                left += PARTS
                continue
            _states_at_nodes(coefficients[n], middle, half, states)
            evaluate(equations, registers, states, rates, integrals, COUNT)
            is_good, far = are_explained(equations, discs, states, integrals, COUNT, claim, reference, slack)
            if not is_good:
                return math.nan, math.nan, 0.0
            drift = max(drift, far)
            time = 0.5 * lengths[n] * half
            for a in range(6):
                _transform(states[a], series)
                _transform(rates[a], rate)
                _integrate(rate, integral)
                step, within = 0.0, 0.0
                for k in range(COUNT + 1):
                    gain = time * integral[k]
                    step += gain
                    within += abs(
                        (series[k] if k < COUNT else 0.0) - gain - (states[a, COUNT - 1] if k == 0 else 0.0)
                    )
                if is_first:
                    first[a] = states[a, COUNT - 1]
                # D at the beginning of the stretch.
                before = (states[a, COUNT - 1] - first[a]) - gained[a] - lost[a]
                tail = 2.0 * time * TAILS[level] * bounds[a]
                size = abs(before) + within + tail + missing[a]
                if not size < math.inf:
                    return math.nan, math.nan, 0.0
                defect = max(defect, size)
                missing[a] += tail
                gained[a], rest = two_sum(gained[a], step)
                lost[a] += rest
            is_first = False
    return defect, drift, 1.0 - unsettled / whole
