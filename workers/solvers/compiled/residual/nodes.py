"""A piece of a run at the points of Chebyshev, and the series and integrals of what is found there.

Rows have the six variables side by side (:mod:`compiled.lanes`). Values at points that are symmetric about
the middle of a stretch are taken together: their sum has the even part of a series, their difference the odd
one. The six rates and the three integrals are found at several states at once, and on a disc for each
variable.
"""

from operator import add, mul, sub, truediv

import numpy as np
from numpy.typing import NDArray

from service.dynamics.defect.accumulation import DEFAULT_INTERVALS, ELLIPSE_RHO, SERIES_RELATIVE_ROUNDING
from service.dynamics.equations.euler_poisson import FourOperations, integrals_in, rates_in
from service.dynamics.motion import COLUMNS
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
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
from workers.solvers.compiled.lanes import (
    LANES,
    ROW,
    Lanes,
    combine,
    number_at,
    place_of,
    put,
    size_of,
    spread,
    take,
)
from workers.solvers.compiled.records import Equations

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
STATE = len(COLUMNS)
"""Variables of a state."""
HIGHEST_DEGREE = 24
"""Highest degree of pieces; those of higher degree need more points than there are here."""
LEVELS = (16, 20, 24, 28, DEFAULT_INTERVALS)
"""Numbers of intervals between the points: the first that leaves out no more than is allowed is taken."""
HALF = DEFAULT_INTERVALS // 2
PLACES = HALF + 2
"""Rows of even or odd numbers, at most."""
HALVES = np.array(LEVELS) // 2
"""Places of the middle among the points; those before it have positive x."""
TAILS = np.array([4.0 * ELLIPSE_RHO**-level / (ELLIPSE_RHO - 1.0) for level in LEVELS])
"""Largest truncation error of interpolation, relative to the bound of F, for each level."""
_K = np.arange(HIGHEST_DEGREE + 1.0)
GROWTH = 0.5 * (ELLIPSE_RHO**_K + ELLIPSE_RHO**-_K) + (_K % 2 == 0)
GROWTH[0] = 0.0
"""|T_k(z) − T_k(0)| on the ellipse of a whole piece."""
WIDTH = 40
"""States that are gone through together."""
ROWS = WIDTH // LANES
"""Rows of lanes of a variable."""
NO_LOWS = np.empty(0)


def _of_level(level: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return points, T_k at those from 1 down to 0, and the coefficients of what is 1 at one of these."""
    points = chebyshev_points(level)
    values = np.polynomial.chebyshev.chebvander(points[: level // 2 + 1], HIGHEST_DEGREE).astype(np.float64)
    return points, values, chebyshev_coefficients(np.eye(level + 1)).T[: level // 2 + 1]


def _tables() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return points, even and odd values (rows by the point), even and odd coefficients (rows by k)."""
    count, half = len(LEVELS), HALF + 1
    nodes = np.zeros((count, DEFAULT_INTERVALS + 1))
    even, odd = np.zeros((count, half, HIGHEST_DEGREE // 2 + 1)), np.zeros((count, half, HIGHEST_DEGREE // 2))
    even_series, odd_series = np.zeros((count, half, half)), np.zeros((count, half, half))
    for n, level in enumerate(LEVELS):
        middle = level // 2
        points, values, series = _of_level(level)
        nodes[n, : level + 1] = points
        even[n, : middle + 1], odd[n, : middle + 1] = values[:, ::2], values[:, 1::2]
        even_series[n, : middle + 1, : middle + 1] = series[:, ::2].T
        odd_series[n, :middle, : middle + 1] = series[:, 1::2].T
    return nodes, even, odd, even_series, odd_series


NODES, EVEN_VALUES, ODD_VALUES, EVEN_SERIES, ODD_SERIES = _tables()


def in_lanes(coefficients: FloatArray) -> FloatArray:
    """Return series as kernels have them: beside the six variables two columns of 0."""
    padded = np.zeros((*coefficients.shape[:2], LANES))
    padded[:, :, :STATE] = coefficients
    return padded


@kernel
def whole_disc(series: int, count: int, few: int, centres: FloatArray, radii: FloatArray) -> None:
    """Fill in discs that hold the six polynomials, rows of coefficients, on the ellipse of a whole piece."""
    centre, wide, total, sign = spread(0.0), spread(0.0), spread(0.0), spread(1.0)
    for k in range(count):
        value = take(series, k)
        size = size_of(value)
        total = total + size
        wide = wide + spread(GROWTH[k]) * size
        if k % 2 == 0:
            centre = centre + sign * value
            sign = spread(0.0) - sign
    put(few, 0, centre)
    put(few, 1, wide * spread(1.0 + SERIES_RELATIVE_ROUNDING) + spread(SERIES_RELATIVE_ROUNDING) * total)
    for a in range(STATE):
        centres[a], radii[a] = number_at(few, 0, a), number_at(few, 1, a)


@kernel
def put_whole_states(series: int, count: int, level: int, states: int, room: int) -> None:
    """Put the values at the nodes of a whole piece into rows; there is room for as many more."""
    middle, half = HALVES[level], (count + 1) // 2
    even, odd, plus, minus = room, room + ROW * PLACES, room + 2 * ROW * PLACES, room + 3 * ROW * PLACES
    for n in range(half):
        put(even, n, take(series, 2 * n))
    for n in range(count // 2):
        put(odd, n, take(series, 2 * n + 1))
    values = place_of(EVEN_VALUES), place_of(ODD_VALUES)
    width = EVEN_VALUES.shape[2], ODD_VALUES.shape[2]
    step = 8 * level * (HALF + 1)
    combine(values[0] + step * width[0], width[0], middle + 1, half, 0, even, plus)
    combine(values[1] + step * width[1], width[1], middle + 1, count // 2, 0, odd, minus)
    for m in range(middle + 1):
        x, y = take(plus, m), take(minus, m)
        put(states, m, x + y)
        put(states, 2 * middle - m, x - y)


@kernel
def put_part_states(series: int, count: int, middle: float, half: float, level: int, states: int) -> None:
    """Put the values at the nodes of a part of a piece into rows."""
    for m in range(2 * HALVES[level] + 1):
        x = middle + half * NODES[level, m]
        before, now = 1.0, x
        value = take(series, 0)
        for k in range(1, count):
            value = value + spread(now) * take(series, k)
            before, now = now, 2.0 * x * now - before
        put(states, m, value)


@kernel
def put_series(values: int, level: int, room: int, even: int, odd: int) -> None:
    """Put the even and the odd coefficients of values at the nodes into rows, and rows of 0 after them."""
    middle = HALVES[level]
    plus, minus = room, room + ROW * PLACES
    for m in range(middle):
        x, y = take(values, m), take(values, 2 * middle - m)
        put(plus, m, x + y)
        put(minus, m, x - y)
    put(plus, middle, take(values, middle))
    width, step = HALF + 1, 8 * level * (HALF + 1) * (HALF + 1)
    combine(place_of(EVEN_SERIES) + step, width, middle + 1, middle + 1, 0, plus, even)
    combine(place_of(ODD_SERIES) + step, width, middle, middle, 0, minus, odd)
    put(even, middle + 1, spread(0.0))
    put(odd, middle, spread(0.0))


@kernel
def put_gains(even: int, odd: int, level: int, time: float, integral: int, few: int) -> None:
    """Put the series of integrals from −1 on, times ``time``, into rows; their values at 1 into ``few``."""
    middle = HALVES[level]
    by = spread(time)
    # The series ends there: its next coefficients are 0.
    now = by * (take(even, 0) - spread(0.5) * take(even, 1))
    put(integral, 1, now)
    whole, least = now, spread(0.0)
    for n in range(1, middle + 1):
        now = by * (take(odd, n - 1) - take(odd, n)) / spread(4.0 * n)
        put(integral, 2 * n, now)
        least = least + now
        now = by * (take(even, n) - take(even, n + 1)) / spread(4.0 * n + 2.0)
        put(integral, 2 * n + 1, now)
        whole = whole + now
    put(integral, 0, whole - least)
    put(few, 0, whole + whole)


@kernel
def put_distances(own: int, owned: int, integral: int, count: int, begin: int, few: int) -> None:
    """Put the sums of what two series differ by into the second of ``few``, one of them less ``begin``."""
    total = size_of(take(own, 0) - take(begin, 0) - take(integral, 0))
    for k in range(1, max(owned, count)):
        x = take(own, k) if k < owned else spread(0.0)
        if k < count:
            x = x - take(integral, k)
        total = total + size_of(x)
    put(few, 1, total)


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
