"""A piece of a run at the points of Chebyshev, and the series and integrals of what is found there.

Rows have the six variables side by side (:mod:`compiled.lanes`). Values at points that are symmetric about
the middle of a stretch are taken together: their sum has the even part of a series, their difference the odd
one.
"""

import numpy as np
from numpy.typing import NDArray

from service.dynamics.defect.accumulation import DEFAULT_INTERVALS, ELLIPSE_RHO, SERIES_RELATIVE_ROUNDING
from service.dynamics.motion import COLUMNS
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import (
    LANES,
    ROW,
    combine,
    number_at,
    place_of,
    put,
    size_of,
    spread,
    take,
)

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
_K = np.arange(HIGHEST_DEGREE + 1.0)
GROWTH = 0.5 * (ELLIPSE_RHO**_K + ELLIPSE_RHO**-_K) + (_K % 2 == 0)
GROWTH[0] = 0.0
"""|T_k(z) − T_k(0)| on the ellipse of a whole piece."""


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
