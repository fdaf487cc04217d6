r"""Hill's equation across an orbit: its coefficient, and parts of panels crossed by collocation, compiled.

The equation is that of :mod:`workers.solvers.stability.assessment`, B q̇ = −M, Ṁ = c q with

.. math::
    c = (A-C)\Bigl[\frac{(B-C) r^2}{A} + \frac{(A-B) p^2}{C}\Bigr]
        - \frac{(A-C) B g_2}{Q} Y[V]
        + \Bigl(1 + \frac{B g_2^2}{Q}\Bigr) \frac{\partial^2 V}{\partial\varphi^2},

Q = A g1² + C g3² and Y = (−g1 g2/C, g1²/C − g3²/A, g2 g3/A). It depends on the place alone: on the way back
a libration finds the same c.

Parts of the panels of a time map are crossed by Gauss' collocation. With the stages and the integrals a_ij,
b_j of :mod:`workers.solvers.stability.monodromy`, and α = ω dt/dx, β = c/(B ω) dt/dx at the stages, y = (q,
M/(B ω)) obeys

.. math:: q_i = q_0 - \sum_j a_{ij} α_j m_j, \qquad m_i = m_0 + \sum_j a_{ij} β_j q_j .

The second eliminates m from the first: one linear system in as many unknowns as there are stages.
"""

import math

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON, UNIT_ROUNDOFF
from workers.solvers.compiled.evaluation.curve import loop_points, place, radicands_with_bounds
from workers.solvers.compiled.evaluation.interpreter import run_bounded
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import NODES, Formula, Loop, Panel, Records
from workers.solvers.compiled.time_map.panels import POINTS, at, distance, last_coefficients
from workers.solvers.compiled.workspace import Places

FloatArray = NDArray[np.float64]
WIDTH = 16
"""Places that are gone through together."""
PLACE_ULPS = 8.0
"""Roundings of g1, g2 and g3 where the curve's own numbers are exact."""
STAGES, WEIGHTS = legendre.leggauss(WIDTH)
_P = legendre.legvander(STAGES, WIDTH)
INTEGRALS = np.ascontiguousarray(
    0.5 * (np.column_stack([STAGES + 1.0, _P[:, 2:] - _P[:, :-2]]) @ _P[:, :-1].T) * WEIGHTS
)
"""a_ij, shape (stages, stages); from ∫ P_k dx = (P_{k+1} − P_{k−1}) / (2k + 1)."""
RATE_PLACES, INTERPOLATION_FACTOR = 8, 2.0
"""Places of a panel where the rounding of P is bounded; factor by which interpolation amplifies it."""
POLE_PHASE_DISTANCES = (2.0**-16, 2.0**-26)
"""Distances from a pole, in θ."""
FARTHEST_POLE = 0.99
"""Largest distance of a pole from the middle of a libration, in parts of the half width."""
Q_ROW, M_ROW, ALPHA, BETA, C_ROW, C_ERROR, RELATIVE, ALPHA_ERROR, BETA_ERROR, ROWS = (
    0,
    2,
    4,
    5,
    6,
    7,
    8,
    9,
    10,
    11,
)
"""Rows of stages: q and M/(B ω) of both solutions, the coefficients, c, and errors, multiplied by weights."""


@kernel
def coefficients(
    formula: Formula, loop: Loop, moments: FloatArray, places: Places, c: FloatArray, errors: FloatArray
) -> float:
    """Fill in c and the bound of its rounding at WIDTH places whose sines and cosines are known.

    ``formula`` has the instructions of :func:`service.dynamics.formula.derived.across`; ``moments`` are
    A, B, C, B − C, A − C, A − B. Returns the largest p² + r².
    """
    loop_points(loop, places, WIDTH)
    A, B, C, B_C, A_C, A_B = moments
    first, third = (places.g3, places.g1) if loop.mirrored else (places.g1, places.g3)
    registers, results = formula.registers, formula.turn.results
    for m in range(WIDTH):
        # λ is known by its rounded logarithm, and |g1| as a power of sin v by that of the sine.
        ulps = PLACE_ULPS + 2.0 * loop.alpha * (abs(loop.log_lambda) + abs(math.log(abs(places.sine[m]))))
        registers[0, 0, m], registers[0, 1, m], registers[0, 2, m] = first[m], places.g2[m], third[m]
        for k in range(3):
            registers[1, k, m] = ulps * abs(registers[0, k, m])
    run_bounded(formula.turn.code, formula.constants, formula.lows, registers, WIDTH)
    D, bend, by_first, by_third = results[0], results[1], results[2], results[3]
    largest = 0.0
    factor = -loop.factor if loop.mirrored else loop.factor
    for m in range(WIDTH):
        g1, g2, g3 = first[m], places.g2[m], third[m]
        ulps = registers[1, 0, m] / abs(g1) + 4.0
        share = factor * places.g3[m] / places.g1[m]
        P = share * registers[0, D, m]
        P_error = abs(share) * registers[1, D, m] + (2.0 * ulps + 4.0) * abs(P)
        ratio = loop.alpha * places.g1[m] / places.g3[m]
        other, other_error = ratio * ratio * P, ratio * ratio * (P_error + (4.0 * ulps + 4.0) * abs(P))
        p, p_error, r, r_error = P, P_error, other, other_error
        if loop.mirrored:
            p, p_error, r, r_error = other, other_error, P, P_error
        Q = A * g1 * g1 + C * g3 * g3
        spin, spin_error = B_C * r / A, abs(B_C) / A * r_error
        turn, turn_error = A_B * p / C, abs(A_B) / C * p_error
        gyration = A_C * (spin + turn)
        pull = A_C * B * g2 / Q
        along = (registers[0, by_first, m] / C, registers[0, by_third, m] / A)
        along_error = registers[1, by_first, m] / C + registers[1, by_third, m] / A
        along_error += 2.0 * (abs(along[0]) + abs(along[1]))
        swell = 1.0 + B * g2 * g2 / Q
        torque, swing = pull * (along[0] + along[1]), swell * registers[0, bend, m]
        c[m] = gyration - torque + swing
        error = abs(A_C) * (spin_error + turn_error + 5.0 * (abs(spin) + abs(turn)))
        error += abs(pull) * along_error + (3.0 * ulps + 8.0) * abs(torque)
        error += swell * registers[1, bend, m] + (4.0 * ulps + 8.0) * abs(swing)
        errors[m] = UNIT_ROUNDOFF * (error + 2.0 * abs(c[m]))
        largest = max(largest, p + r)
    return largest


@kernel
def solve_in_place(matrix: FloatArray, right: FloatArray) -> None:
    """Replace ``right``, shape (n, 2), by the solution of a linear system, by elimination with pivots."""
    size = len(matrix)
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[best, k]):
                best = i
        if best != k:
            for j in range(k, size):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
            for j in range(2):
                right[k, j], right[best, j] = right[best, j], right[k, j]
        inverse = 1.0 / matrix[k, k]
        for i in range(k + 1, size):
            factor = matrix[i, k] * inverse
            if factor != 0.0:
                for j in range(k + 1, size):
                    matrix[i, j] -= factor * matrix[k, j]
                right[i, 0] -= factor * right[k, 0]
                right[i, 1] -= factor * right[k, 1]
    for k in range(size - 1, -1, -1):
        for j in range(2):
            total = right[k, j]
            for i in range(k + 1, size):
                total -= matrix[k, i] * right[i, j]
            right[k, j] = total / matrix[k, k]


@kernel
def cross(alpha: FloatArray, beta: FloatArray, q: FloatArray, m: FloatArray, end: FloatArray) -> None:
    """Fill in the solutions from (1, 0) and (0, 1) at the stages (2, stages), and at the end (2, 2)."""
    matrix, right = np.zeros((WIDTH, WIDTH)), np.empty((WIDTH, 2))
    for i in range(WIDTH):
        right[i, 0], right[i, 1] = 1.0, 0.0
        for k in range(WIDTH):
            weight = INTEGRALS[i, k] * alpha[k]
            right[i, 1] -= weight
            for j in range(WIDTH):
                matrix[i, j] += weight * (INTEGRALS[k, j] * beta[j])
        matrix[i, i] += 1.0
    solve_in_place(matrix, right)
    for i in range(WIDTH):
        q[0, i], q[1, i] = right[i, 0], right[i, 1]
    for j in range(2):
        for i in range(WIDTH):
            total = 0.0 + j
            for k in range(WIDTH):
                total += INTEGRALS[i, k] * beta[k] * q[j, k]
            m[j, i] = total
        first, second = 1.0 - j, 0.0 + j
        for k in range(WIDTH):
            first -= WEIGHTS[k] * alpha[k] * m[j, k]
            second += WEIGHTS[k] * beta[k] * q[j, k]
        end[0, j], end[1, j] = first, second


@inlined
def _put(loop: Loop, places: Places, k: int, anchor: int, w: float) -> None:
    places.below[k], places.above[k], places.sine[k], places.cosine[k], places.speed[k] = place(
        loop, anchor, w
    )


@kernel
def doubt_of_ends(formula: Formula, loop: Loop, places: Places, panels: Records, number: int) -> float:
    """Return by how much the ends of a libration, zeros of P, may be wrong in v."""
    if loop.rotates:
        return 0.0
    places.sine[0], places.cosine[0] = loop.s_lower, loop.c_lower
    places.sine[1], places.cosine[1] = loop.s_upper, loop.c_upper
    radicands_with_bounds(formula, loop, places, 2)
    doubt = 0.0
    for k in range(2):
        panel = panels[0 if k == 0 else number - 1]
        _, slope = at(panel, panel.first if k == 0 else panel.last)
        rate = slope * 2.0 / (panel.high - panel.low)
        # dt/du = π Z/(c √K), and P' = 2 h K at the end.
        root = math.pi * loop.z / (places.c[k] * rate)
        doubt = max(doubt, places.bound[k] / (2.0 * loop.half_width * root * root))
    return doubt + EPSILON


@kernel
def error_of_rate(formula: Formula, loop: Loop, panel: Panel, places: Places) -> tuple[float, float]:
    """Return the relative error of dt/dx on a panel, and an absolute one.

    The rounding of P is looked at where the series was made. Where nothing is proved, the last coefficients
    say what a series leaves out, as for the time map (:mod:`compiled.time_map.error`).
    """
    is_half = panel.last - panel.first < 2.0
    for k in range(RATE_PLACES):
        j = 2 * k
        if is_half:
            j = k if panel.last > 0.0 else NODES - 1 - k
        _put(loop, places, k, panel.anchor, distance(panel, POINTS[j]))
    radicands_with_bounds(formula, loop, places, RATE_PLACES)
    total = 0.0
    for k in range(RATE_PLACES):
        total += places.bound[k] / abs(places.radicand[k])
    noise = INTERPOLATION_FACTOR * 0.5 * total / RATE_PLACES + 8.0 * EPSILON
    if not math.isnan(panel.proved):
        return noise + panel.proved, 0.0
    return noise, 2.0 * last_coefficients(panel.slopes)


@kernel
def cross_part(
    formula: Formula,
    loop: Loop,
    panel: Panel,
    spans: tuple[float, float],
    about: tuple[float, float, float, float, float],
    moments: FloatArray,
    places: Places,
    stages: FloatArray,
    end: FloatArray,
) -> float:
    """Fill in the propagator of a part of a panel, and the rows of its ``stages``; return max p² + r².

    ``about`` are ω, B ω, the doubt of the ends, and the relative and the absolute error of dt/dx.
    """
    frequency, scale, doubt, relative, absolute = about
    middle, half = 0.5 * (spans[0] + spans[1]), 0.5 * (spans[1] - spans[0])
    alpha, beta, c, errors = stages[ALPHA], stages[BETA], stages[C_ROW], stages[C_ERROR]
    for k in range(WIDTH):
        _put(loop, places, k, panel.anchor, distance(panel, middle + half * STAGES[k]))
    fastest = coefficients(formula, loop, moments, places, c, errors)
    for k in range(WIDTH):
        _, slope = at(panel, middle + half * STAGES[k])
        alpha[k], beta[k] = frequency * (slope * half), c[k] / scale * (slope * half)
    cross(alpha, beta, stages[Q_ROW:M_ROW], stages[M_ROW:ALPHA], end)
    for k in range(WIDTH):
        j = k if k < WIDTH - 1 else k - 1
        error = errors[k]
        if doubt > 0.0:
            error += doubt * abs((c[j + 1] - c[j]) / (places.below[j + 1] - places.below[j]))
        stages[RELATIVE, k] = WEIGHTS[k] * relative
        stages[ALPHA_ERROR, k] = WEIGHTS[k] * absolute * half * frequency
        stages[BETA_ERROR, k] = (
            WEIGHTS[k] * (absolute * half * abs(c[k]) + abs(alpha[k] / frequency) * error) / scale
        )
    return fastest


@kernel
def is_integrable(
    formula: Formula,
    loop: Loop,
    scale: float,
    moments: FloatArray,
    places: Places,
    c: FloatArray,
    errors: FloatArray,
) -> bool:
    """Tell whether |c| times the distance from each pole falls towards it, as is required in balls."""
    middle = math.atan2(loop.s_middle, loop.c_middle)
    for pole in range(-1, 3):
        if loop.rotates:
            if pole < 0 or pole > 1:
                continue
            anchor, w = 2 * pole, 0.0
        else:
            share = (math.pi * pole - middle) / loop.half_width
            if abs(share) >= 1.0:
                continue
            if abs(share) > FARTHEST_POLE:
                return False
            anchor, w = 1, math.asin(share) / math.pi
        for k in range(WIDTH):
            side = 1.0 if k % 2 else -1.0
            _put(loop, places, k, anchor, w + side * POLE_PHASE_DISTANCES[(k // 2) % 2] / math.pi)
        coefficients(formula, loop, moments, places, c, errors)
        for k in range(2):
            far = max(abs(c[k]), scale) * POLE_PHASE_DISTANCES[0]
            if not abs(c[2 + k]) * POLE_PHASE_DISTANCES[1] < 0.5 * far:
                return False
    return True
