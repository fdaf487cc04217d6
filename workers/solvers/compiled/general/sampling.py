"""Values of functions of time, and how runs differ, by compiled code.

The values have the very digits of :class:`service.dynamics.solution.dense_output.DenseOutput`. Rows of series
have the six variables, and two columns of nothing, side by side.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.general.steps import STATE
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import (
    LANES,
    first_row,
    larger,
    new_rows,
    number_at,
    place_of,
    put,
    put_number,
    size_of,
    spread,
    take,
)
from workers.solvers.compiled.records import Equations
from workers.solvers.compiled.residual.nodes import WIDTH, evaluate

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TIMES_TOGETHER = 4
"""Times whose sums do not wait for one another."""


@kernel
def _piece_of(breaks: FloatArray, time: float, last: int) -> int:
    """Return the piece that a time is in; ``last`` is where the search begins."""
    count = len(breaks) - 1
    piece = last
    if not (breaks[piece] <= time < breaks[piece + 1]):
        low, high = 0, count + 1
        while low < high:
            middle = (low + high) // 2
            if breaks[middle] <= time:
                low = middle + 1
            else:
                high = middle
        piece = min(max(low - 1, 0), count - 1)
    return piece


@kernel
def _put_sums(rows: int, i: int, j: int, k: int, m: int, places: int, degree: int, out: int, to: int) -> None:
    """Put the sums of four series, which begin at rows i, j, k, m, at the ``places`` into four rows."""
    x = spread(number_at(places, 0, 0))
    y = spread(number_at(places, 0, 1))
    z = spread(number_at(places, 0, 2))
    w = spread(number_at(places, 0, 3))
    a, b, c, d = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    e, f, g, h = a, a, a, a
    two = spread(2.0)
    x2, y2, z2, w2 = two * x, two * y, two * z, two * w
    for n in range(degree, 0, -1):
        a, e = (take(rows, i + n) + x2 * a) - e, a
        b, f = (take(rows, j + n) + y2 * b) - f, b
        c, g = (take(rows, k + n) + z2 * c) - g, c
        d, h = (take(rows, m + n) + w2 * d) - h, d
    put(out, to, (take(rows, i) + x * a) - e)
    put(out, to + 1, (take(rows, j) + y * b) - f)
    put(out, to + 2, (take(rows, k) + z * c) - g)
    put(out, to + 3, (take(rows, m) + w * d) - h)


@kernel
def values_at(
    breaks: FloatArray,
    series: FloatArray,
    length: int,
    times: FloatArray,
    rests: FloatArray,
    values: FloatArray,
) -> None:
    """Fill in the variables at the sums of ``times`` and ``rests``, if there are any.

    ``series`` has the shape (pieces, at least ``length``, LANES), ``values`` (n, LANES) with
    n at least the number of times, rounded up to a multiple of ``TIMES_TOGETHER``.
    """
    piece, width = 0, series.shape[1]
    rows, out = place_of(series), place_of(values)
    places, pieces = np.empty(TIMES_TOGETHER), np.empty(TIMES_TOGETHER, dtype=np.int64)
    at = place_of(places)
    for begin in range(0, len(times), TIMES_TOGETHER):
        for n in range(TIMES_TOGETHER):
            m = min(begin + n, len(times) - 1)
            time = times[m]
            piece = _piece_of(breaks, time, piece)
            left, right = breaks[piece], breaks[piece + 1]
            x = ((time - left) - (right - time)) / (right - left)
            if len(rests):
                x = x + 2.0 * rests[m] / (right - left)
            places[n], pieces[n] = min(max(x, -1.0), 1.0), piece * width
        _put_sums(rows, pieces[0], pieces[1], pieces[2], pieces[3], at, length - 1, out, begin)


@kernel
def new_values_at(
    breaks: FloatArray, series: FloatArray, length: int, times: FloatArray, rests: FloatArray
) -> FloatArray:
    """Return what :func:`values_at` fills in, with some rows too many."""
    values = np.empty(((len(times) + TIMES_TOGETHER - 1) // TIMES_TOGETHER * TIMES_TOGETHER, LANES))
    values_at(breaks, series, length, times, rests, values)
    return values


@kernel
def widen(values: FloatArray, others: FloatArray, gaps: FloatArray) -> None:
    """Raise ``gaps`` to what values and others differ by; NaN stays. All have the same shape (n, LANES)."""
    rows, seconds, found = place_of(values), place_of(others), place_of(gaps)
    for n in range(len(values)):
        far = size_of(take(rows, n) - take(seconds, n))
        put(found, n, larger(far, take(found, n)) + (far - far))


@kernel
def compare(
    equations: Equations,
    start: FloatArray,
    values: FloatArray,
    gaps: FloatArray,
    times: FloatArray,
    safety: float,
    rounding: float,
) -> tuple[float, float, float, float, FloatArray]:
    """Return the estimated error of a run with ``values`` at ``times``, and the largest of the ``gaps``.

    Then the energy at t = 0, how far it strays at most, and the three integrals there. The estimate is
    ``safety`` times the gaps to other runs, and ``rounding`` relative to the variables and to what they
    change by while the time is multiplied by 1 + rounding. NaN where one of the numbers is not finite.
    ``start`` is the row at t = 0; the others have the shape (at least n, LANES).
    """
    registers = new_registers(equations.gradient.code, 1, WIDTH)
    rates, integrals = np.empty((STATE, WIDTH)), np.empty((3, WIDTH))
    states, others = np.empty((STATE, WIDTH)), np.empty((STATE, WIDTH))
    for a in range(STATE):
        states[a, 0] = start[a]
    evaluate(equations, registers, states, rates, integrals, 1)
    reference = integrals[:, 0].copy()
    room = new_rows(5)
    found = first_row(room)
    sizes = place_of(states), place_of(others), place_of(rates), place_of(integrals)
    error, difference, stray, total = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for begin in range(0, len(times), WIDTH):
        count = min(WIDTH, len(times) - begin)
        blocks = (count + LANES - 1) // LANES
        for m in range(blocks * LANES):
            n = begin + min(m, count - 1)
            for a in range(STATE):
                states[a, m], others[a, m] = values[n, a], gaps[n, a]
        evaluate(equations, registers, states, rates, integrals, blocks * LANES)
        for block in range(blocks):
            for lane in range(LANES):
                put_number(found, 0, lane, abs(times[begin + min(block * LANES + lane, count - 1)]))
            gap, size, speed = spread(0.0), spread(0.0), spread(0.0)
            for a in range(STATE):
                row = a * (WIDTH // LANES) + block
                state, rate = take(sizes[0], row), size_of(take(sizes[2], row))
                far = take(sizes[1], row)
                # What is not a number is seen here alone.
                total = total + (far + rate)
                gap, size, speed = larger(far, gap), larger(size_of(state), size), larger(rate, speed)
            departure = size_of(take(sizes[3], block) - spread(reference[0]))
            total = total + departure
            estimate = spread(safety) * gap + spread(rounding) * (size + take(found, 0) * speed)
            error, difference, stray = (
                larger(estimate, error),
                larger(gap, difference),
                larger(departure, stray),
            )
    put(found, 1, error)
    put(found, 2, difference)
    put(found, 3, stray)
    put(found, 4, total)
    worst = np.zeros(4)
    for lane in range(LANES):
        for n in range(4):
            worst[n] = max(worst[n], number_at(found, 1 + n, lane))
        if not number_at(found, 4, lane) < math.inf:
            worst[:] = math.nan
            break
    # Up to here the rooms have owners.
    room[0, 0], states[0, 0], others[0, 0], rates[0, 0], integrals[0, 0] = 0.0, 0.0, 0.0, 0.0, 0.0
    error_found, far_found, stray_found = worst[0], worst[1], worst[2]
    return error_found, far_found, reference[0], stray_found + rounding * abs(reference[0]), reference
