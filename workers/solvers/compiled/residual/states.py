"""The six rates and the three integrals: at several states at once, and on a disc for each variable."""

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.arithmetic import (
    ARITHMETIC,
    Disc,
    exactly,
    minus,
    plus,
    run_discs,
    times,
)
from workers.solvers.compiled.evaluation.interpreter import run_double
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import LANES, Lanes, place_of, put, spread, take
from workers.solvers.compiled.records import Equations

FloatArray = NDArray[np.float64]

WIDTH = 40
"""States that are gone through together."""
ROWS = WIDTH // LANES
"""Rows of lanes of a variable."""
NO_LOWS = np.empty(0)


@kernel
def evaluate(
    equations: Equations,
    registers: FloatArray,
    states: FloatArray,
    rates: FloatArray,
    integrals: FloatArray,
    count: int,
) -> None:
    """Fill in F and the integrals at ``count`` states; rows are the columns of a motion, of WIDTH states.

    ``registers`` are those of the gradient, of one part. Each state has the digits it has alone; what is
    found at the states after these, up to a multiple of ``LANES``, is nothing.
    """
    for a in range(3):
        for m in range(count):
            registers[0, a, m] = states[3 + a, m]
    run_double(equations.gradient.code, equations.constants, NO_LOWS, registers, count)
    u, v, found, sums = place_of(states), place_of(registers), place_of(rates), place_of(integrals)
    results, moments = equations.gradient.results, equations.moments
    V, first, second, third = results[0] * ROWS, results[1] * ROWS, results[2] * ROWS, results[3] * ROWS
    A, B, C = spread(moments[0]), spread(moments[1]), spread(moments[2])
    along, across, about = spread(moments[3]), spread(moments[4]), spread(moments[5])
    for m in range((count + LANES - 1) // LANES):
        p, q, r = take(u, m), take(u, ROWS + m), take(u, 2 * ROWS + m)
        g1, g2, g3 = take(u, 3 * ROWS + m), take(u, 4 * ROWS + m), take(u, 5 * ROWS + m)
        V1, V2, V3 = take(v, first + m), take(v, second + m), take(v, third + m)
        put(found, m, (along * (q * r) + (g2 * V3 - g3 * V2)) / A)
        put(found, ROWS + m, (across * (p * r) + (g3 * V1 - g1 * V3)) / B)
        put(found, 2 * ROWS + m, (about * (p * q) + (g1 * V2 - g2 * V1)) / C)
        put(found, 3 * ROWS + m, r * g2 - q * g3)
        put(found, 4 * ROWS + m, p * g3 - r * g1)
        put(found, 5 * ROWS + m, q * g1 - p * g2)
        doubled: Lanes = A * p * p + B * q * q + C * r * r
        put(sums, m, spread(0.5) * doubled + take(v, V + m))
        put(sums, ROWS + m, A * p * g1 + B * q * g2 + C * r * g3)
        put(sums, 2 * ROWS + m, g1 * g1 + g2 * g2 + g3 * g3)


@kernel
def _run_on(equations: Equations, discs: FloatArray, centres: FloatArray, radii: FloatArray) -> None:
    for a in range(3):
        discs[0, a, 0], discs[1, a, 0] = centres[3 + a], radii[3 + a]
    run_discs(equations.gradient.code, equations.constants, NO_LOWS, discs, 1)


@kernel
def _cross(x: FloatArray, r: FloatArray, i: int, j: int, V: Disc, W: Disc) -> Disc:
    """Return g_i V_j − g_j V_i on discs; V_i and V_j are given."""
    return minus(times((x[3 + i], r[3 + i]), W), times((x[3 + j], r[3 + j]), V))


@kernel
def largest_rates(
    equations: Equations,
    discs: FloatArray,
    centres: FloatArray,
    radii: FloatArray,
    bounds: FloatArray,
) -> None:
    """Fill in bounds of the six |F| on the discs with these centres and radii, shape (6,); NaN for none.

    ``discs`` are registers of the gradient, of two parts and one place.
    """
    _run_on(equations, discs, centres, radii)
    results, moments = equations.gradient.results, equations.moments
    for a in range(3):
        i, j = (a + 1) % 3, (a + 2) % 3
        m, n = results[1 + i], results[1 + j]
        pull = _cross(
            centres, radii, i, j, (discs[0, m, 0], discs[1, m, 0]), (discs[0, n, 0], discs[1, n, 0])
        )
        turn = times((centres[i], radii[i]), (centres[j], radii[j]))
        bound = plus(times(exactly(moments[3 + a]), turn), pull)
        bounds[a] = (abs(bound[0]) + bound[1]) / moments[a] * (1.0 + 8.0 * ARITHMETIC)
        # γ' = γ × ω
        bound = _cross(centres, radii, i, j, (centres[i], radii[i]), (centres[j], radii[j]))
        bounds[3 + a] = (abs(bound[0]) + bound[1]) * (1.0 + ARITHMETIC)


@kernel
def integrals_on(
    equations: Equations,
    discs: FloatArray,
    centres: FloatArray,
    radii: FloatArray,
    found: FloatArray,
) -> None:
    """Fill in centres and radii of the three integrals on discs, shape (2, 3); NaN for what is not known."""
    _run_on(equations, discs, centres, radii)
    value, moments = equations.gradient.results[0], equations.moments
    energy, areas, length = (discs[0, value, 0], discs[1, value, 0]), (0.0, 0.0), (0.0, 0.0)
    for a in range(3):
        omega, gamma = (centres[a], radii[a]), (centres[3 + a], radii[3 + a])
        momentum = times(exactly(moments[a]), omega)
        energy = plus(energy, times(momentum, (0.5 * omega[0], 0.5 * omega[1])))
        areas, length = plus(areas, times(momentum, gamma)), plus(length, times(gamma, gamma))
    found[0, 0], found[1, 0] = energy
    found[0, 1], found[1, 1] = areas
    found[0, 2], found[1, 2] = length
