"""A stored solution at many times, compiled: the very numbers of its own evaluation.

Times are sorted by the piece they are in, and every series is summed for all times of
a piece together, by the operations of :meth:`DenseOutput.__call__` in their order.
"""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import DenseOutput
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.workspace import BLOCK, STRIDE, sort_by_interval

FloatArray = NDArray[np.float64]

# Rows of the workspace, in one dimension.
X, FIRST, SECOND = (np.uint64(STRIDE * row) for row in range(3))
SPLIT = 134217729.0
"""2^27 + 1, by which a double is cut in halves (Dekker)."""
TOGETHER = 5
"""Steps of Clenshaw's recurrence between which nothing is written to memory."""


def evaluate(dense: DenseOutput, times: FloatArray) -> FloatArray:
    """Return ``dense(times)``.

    Raises
    ------
    OutsideHorizonError
        As calling ``dense``.
    """
    times = np.ascontiguousarray(times, dtype=np.float64)
    hi, lo = math.inf, 0.0
    if dense.period is None:
        dense.require_within(times)
    else:
        hi, lo = dense.period.hi, dense.period.lo
    values, turns = np.empty((len(times), len(dense.columns))), np.empty(len(times))
    _evaluate(times, hi, lo, dense.breaks, np.ascontiguousarray(dense.coefficients), turns, values)
    dense.advance(values, turns)
    return values


@kernel
def _remainder(time: float, turns: float, hi: float, lo: float) -> float:
    """Return time − turns (hi + lo), the product with hi being exact (Dekker)."""
    product = turns * hi
    a_high = SPLIT * turns - (SPLIT * turns - turns)
    b_high = SPLIT * hi - (SPLIT * hi - hi)
    a_low, b_low = turns - a_high, hi - b_high
    rest = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return ((time - product) - rest) - turns * lo


@kernel
def _reduce(times: FloatArray, hi: float, lo: float, local: FloatArray, turns: FloatArray) -> None:
    """Fill in the times within a period, and the whole periods before."""
    for k in range(len(times)):
        n = math.floor(times[k] / hi)
        t = _remainder(times[k], n, hi, lo)
        shift = -1.0 if t < 0.0 else (1.0 if t >= hi else 0.0)
        if shift != 0.0:
            n += shift
            t = _remainder(times[k], n, hi, lo)
        local[k], turns[k] = min(hi, max(0.0, t)), n


@kernel
def _sum(series: FloatArray, column: int, workspace: FloatArray, begin: int, end: int) -> None:
    """Leave the sum of one column's series, at the places from ``begin`` to ``end``, in FIRST."""
    for k in range(begin, end):
        workspace[FIRST + k], workspace[SECOND + k] = 0.0, 0.0
    degree = len(series) - 1
    while degree % TOGETHER:
        c = series[degree, column]
        for k in range(begin, end):
            first = workspace[FIRST + k]
            workspace[FIRST + k] = (c + 2.0 * workspace[X + k] * first) - workspace[SECOND + k]
            workspace[SECOND + k] = first
        degree -= 1
    while degree:
        for k in range(begin, end):
            twice, first, second = 2.0 * workspace[X + k], workspace[FIRST + k], workspace[SECOND + k]
            for step in range(TOGETHER):
                first, second = (series[degree - step, column] + twice * first) - second, first
            workspace[FIRST + k], workspace[SECOND + k] = first, second
        degree -= TOGETHER
    c = series[0, column]
    for k in range(begin, end):
        workspace[FIRST + k] = (c + workspace[X + k] * workspace[FIRST + k]) - workspace[SECOND + k]


@kernel
def _evaluate(
    times: FloatArray,
    hi: float,
    lo: float,
    breaks: FloatArray,
    coefficients: FloatArray,
    turns: FloatArray,
    out: FloatArray,
) -> None:
    """Fill ``out`` (times, columns) and the whole periods before each time; hi is inf without a period."""
    size = min(BLOCK, len(times))
    workspace, local = np.empty(3 * STRIDE), np.empty(size)
    home, order = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    pieces = len(breaks) - 1
    begins = np.empty(pieces + 1, dtype=np.uint64)
    for start in range(0, len(times), BLOCK):
        count = min(BLOCK, len(times) - start)
        here = times[start : start + count]
        if hi < math.inf:
            _reduce(here, hi, lo, local, turns[start : start + count])
        else:
            local[:count] = here
            turns[start : start + count] = 0.0
        sort_by_interval(breaks[:-1], local[:count], home, begins, order)
        for n in range(pieces):
            begin, end = begins[n], begins[n + 1]
            if begin == end:
                continue
            left, right = breaks[n], breaks[n + 1]
            for k in range(begin, end):
                t = local[order[k]]
                x = ((t - left) - (right - t)) / (right - left)
                workspace[X + k] = min(1.0, max(-1.0, x))
            for column in range(out.shape[1]):
                _sum(coefficients[n], column, workspace, begin, end)
                for k in range(begin, end):
                    out[start + order[k], column] = workspace[FIRST + k]
