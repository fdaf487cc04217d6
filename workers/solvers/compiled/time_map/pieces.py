"""Resolves a motion in time, piece by piece, as :func:`workers.solvers.assembly.dense.resolve_motion` does.

For motions that are smooth all along: no passage, no kink, no narrow feature. It is that algorithm around a
sampler that is compiled too: the pieces of a generation take one call and no array of Python.
"""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
from workers.solvers.assembly.dense import CHECKED_POINTS, PIECE_DEGREE, VARIABLE_RELATIVE_ROUNDING
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Records
from workers.solvers.compiled.time_map.sampling import sample

FloatArray = NDArray[np.float64]

NODES = PIECE_DEGREE + 1
PLACES = np.concatenate([chebyshev_points(PIECE_DEGREE), CHECKED_POINTS])
"""Nodes, and places between them at which the series is compared with the motion."""
COUNT = NODES + len(CHECKED_POINTS)
TRANSFORM = np.ascontiguousarray(chebyshev_coefficients(np.eye(NODES)).T)
"""Matrix from values at the nodes, rows, to coefficients."""
SERIES_BETWEEN = np.ascontiguousarray(
    np.polynomial.chebyshev.chebvander(np.array(CHECKED_POINTS), PIECE_DEGREE)
)
"""T_k at the places between, shape (places, degree + 1)."""
ALL = np.arange(6)


@kernel
def _resolve_piece(
    states: FloatArray, share: float, atol: float, series: FloatArray, coefficients: FloatArray
) -> tuple[bool, float]:
    """Fill in the series of one piece, shape (NODES, 6); say if it is resolved, and how far it departs.

    ``states`` has the shape (COUNT, 6); ``share`` is the scale of time over the length of the piece.
    """
    is_resolved, departure = True, 0.0
    for a in range(6):
        series[:] = 0.0
        low, high, largest = math.inf, -math.inf, 0.0
        for m in range(COUNT):
            value = states[m, a]
            low, high, largest = min(low, value), max(high, value), max(largest, abs(value))
            # NaN passes no comparison.
            if not abs(value) < math.inf:
                return False, math.nan
        # A column that vanishes, as q does, has nothing to resolve.
        if largest == 0.0:
            coefficients[:, a] = 0.0
            continue
        for m in range(NODES):
            value = states[m, a]
            for k in range(NODES):
                series[k] += TRANSFORM[m, k] * value
        for j in range(COUNT - NODES):
            value = 0.0
            for k in range(NODES):
                value += SERIES_BETWEEN[j, k] * series[k]
            departure = max(departure, abs(value - states[NODES + j, a]))
        allowed = atol + VARIABLE_RELATIVE_ROUNDING * (largest + share * (high - low))
        tail = max(abs(series[NODES - 1]), abs(series[NODES - 2]))
        is_resolved = is_resolved and tail <= allowed
        coefficients[:, a] = series
    return is_resolved, departure


@kernel
def resolve_one(
    loops: Records,
    panels: Records,
    last: float,
    pieces: int,
    atol: float,
    finest: float,
    workspaces: Records,
    rights: FloatArray,
    coefficients: FloatArray,
) -> tuple[int, float, int]:
    """Resolve the only loop's motion from 0 to ``last``, beginning with so many equal ``pieces``.

    Fill in where the pieces end, and their series, shapes (most,) and (most, NODES, 6), in no order. Return
    the number of pieces, 0 if there would be more than these or a value is not finite, the largest departure
    seen between nodes, and the number of states.
    """
    loop, moments, most = loops[0], workspaces[0].moments, len(rights)
    waiting, following = np.empty((most, 2)), np.empty((most, 2))
    for k in range(pieces):
        waiting[k, 0], waiting[k, 1] = last * k / pieces, last * (k + 1) / pieces
    waiting[pieces - 1, 1] = last
    count, done, departure, states_taken = pieces, 0, 0.0, 0
    series = np.empty(NODES)
    while count > 0:
        times, rests = np.empty(count * COUNT), np.zeros(count * COUNT)
        states = np.empty((count * COUNT, 6))
        for n in range(count):
            middle, half = 0.5 * (waiting[n, 0] + waiting[n, 1]), 0.5 * (waiting[n, 1] - waiting[n, 0])
            for m in range(COUNT):
                times[n * COUNT + m] = middle + half * PLACES[m]
        sample(loop, panels, len(panels), times, rests, ALL, moments, states)
        states_taken += count * COUNT
        halved = 0
        for n in range(count):
            left, right = waiting[n, 0], waiting[n, 1]
            share = last / (right - left)
            if done + 2 * halved + 2 + (count - n) > most:
                return 0, departure, states_taken
            is_good, far = _resolve_piece(
                states[n * COUNT : (n + 1) * COUNT], share, atol, series, coefficients[done]
            )
            if not far < math.inf:
                return 0, math.nan, states_taken
            if is_good or share > finest:
                rights[done] = right
                done += 1
                departure = max(departure, far)
                continue
            middle = 0.5 * (left + right)
            following[2 * halved, 0], following[2 * halved, 1] = left, middle
            following[2 * halved + 1, 0], following[2 * halved + 1, 1] = middle, right
            halved += 1
        waiting, following, count = following, waiting, 2 * halved
    return done, departure, states_taken
