"""The six rates and the three integrals: at several states at once, and on a disc for each variable."""

from operator import add, mul, sub, truediv

import numpy as np
from numpy.typing import NDArray

from service.dynamics.equations.euler_poisson import FourOperations, integrals_in, rates_in
from workers.solvers.compiled.discs.arithmetic import (
    OPERATION_ERROR,
    Disc,
    exactly,
    minus,
    over,
    plus,
    run_discs,
    times,
)
from workers.solvers.compiled.evaluation.interpreter import named, run_double
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.lanes import LANES, Lanes, place_of, put, spread, take
from workers.solvers.compiled.records import Equations

FloatArray = NDArray[np.float64]

WIDTH = 40
"""States that are gone through together."""
ROWS = WIDTH // LANES
"""Rows of lanes of a variable."""
NO_LOWS = np.empty(0)


def _of_lanes() -> FourOperations[Lanes]:
    return FourOperations(add, sub, mul, truediv)


def _of_discs() -> FourOperations[Disc]:
    return FourOperations(plus, minus, times, over)


# No value of the module has kernels in it: the address of its code is made of values.
_rates_of_lanes = inlined(named(rates_in(_of_lanes()), __name__, "_rates_of_lanes"))
_integrals_of_lanes = inlined(named(integrals_in(_of_lanes()), __name__, "_integrals_of_lanes"))
_rates_of_discs = kernel(named(rates_in(_of_discs()), __name__, "_rates_of_discs"))
_integrals_of_discs = kernel(named(integrals_in(_of_discs()), __name__, "_integrals_of_discs"))


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
    results, body = equations.gradient.results, equations.moments
    V, first, second, third = results[0] * ROWS, results[1] * ROWS, results[2] * ROWS, results[3] * ROWS
    A, B, C, B_C, C_A, A_B = body[0], body[1], body[2], body[3], body[4], body[5]
    moments = spread(A), spread(B), spread(C), spread(B_C), spread(C_A), spread(A_B)
    for m in range((count + LANES - 1) // LANES):
        p, q, r = take(u, m), take(u, ROWS + m), take(u, 2 * ROWS + m)
        g1, g2, g3 = take(u, 3 * ROWS + m), take(u, 4 * ROWS + m), take(u, 5 * ROWS + m)
        state, slopes = (p, q, r, g1, g2, g3), (take(v, first + m), take(v, second + m), take(v, third + m))
        p, q, r, g1, g2, g3 = _rates_of_lanes(moments, state, slopes)
        put(found, m, p)
        put(found, ROWS + m, q)
        put(found, 2 * ROWS + m, r)
        put(found, 3 * ROWS + m, g1)
        put(found, 4 * ROWS + m, g2)
        put(found, 5 * ROWS + m, g3)
        energy, areas, length = _integrals_of_lanes(moments, state, take(v, V + m), spread(0.5))
        put(sums, m, energy)
        put(sums, ROWS + m, areas)
        put(sums, 2 * ROWS + m, length)


@inlined
def _six(x: FloatArray, r: FloatArray) -> tuple[Disc, Disc, Disc, Disc, Disc, Disc]:
    return (x[0], r[0]), (x[1], r[1]), (x[2], r[2]), (x[3], r[3]), (x[4], r[4]), (x[5], r[5])


@inlined
def _moments(equations: Equations) -> tuple[Disc, Disc, Disc, Disc, Disc, Disc]:
    A, B, C = exactly(equations.moments[0]), exactly(equations.moments[1]), exactly(equations.moments[2])
    B_C, C_A, A_B = equations.moments[3], equations.moments[4], equations.moments[5]
    return A, B, C, exactly(B_C), exactly(C_A), exactly(A_B)


@kernel
def _run_on(equations: Equations, discs: FloatArray, centres: FloatArray, radii: FloatArray) -> None:
    for a in range(3):
        discs[0, a, 0], discs[1, a, 0] = centres[3 + a], radii[3 + a]
    run_discs(equations.gradient.code, equations.constants, NO_LOWS, discs, 1)


@inlined
def _result(equations: Equations, discs: FloatArray, k: int) -> Disc:
    place = equations.gradient.results[k]
    return discs[0, place, 0], discs[1, place, 0]


@kernel
def largest_rates(
    equations: Equations, discs: FloatArray, centres: FloatArray, radii: FloatArray, bounds: FloatArray
) -> None:
    """Fill in bounds of the six |F| on the discs with these centres and radii, shape (6,); NaN for none.

    ``discs`` are registers of the gradient, of two parts and one place.
    """
    _run_on(equations, discs, centres, radii)
    slopes = _result(equations, discs, 1), _result(equations, discs, 2), _result(equations, discs, 3)
    found = _rates_of_discs(_moments(equations), _six(centres, radii), slopes)
    for a in range(6):
        centre, radius = found[a]
        bounds[a] = (abs(centre) + radius) * (1.0 + OPERATION_ERROR)


@kernel
def integrals_on(
    equations: Equations, discs: FloatArray, centres: FloatArray, radii: FloatArray, found: FloatArray
) -> None:
    """Fill in centres and radii of the three integrals on discs, shape (2, 3); NaN for what is not known."""
    _run_on(equations, discs, centres, radii)
    state, V = _six(centres, radii), _result(equations, discs, 0)
    energy, areas, length = _integrals_of_discs(_moments(equations), state, V, (0.5, 0.0))
    found[0, 0], found[1, 0] = energy
    found[0, 1], found[1, 1] = areas
    found[0, 2], found[1, 2] = length
