"""Values of functions of time, and how two runs differ, by compiled code.

The values have the very digits of :class:`service.dynamics.solution.dense_output.DenseOutput`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.general.series import STATE
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.shown.gradients import WIDTH
from workers.solvers.compiled.shown.states import evaluate

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


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
def values_at(
    breaks: FloatArray, coefficients: FloatArray, times: FloatArray, rests: FloatArray, values: FloatArray
) -> None:
    """Fill in the six variables, shape (6, n), at the sums of ``times`` and ``rests``, if there are any."""
    piece, degree = 0, coefficients.shape[1] - 1
    for m in range(len(times)):
        time = times[m]
        piece = _piece_of(breaks, time, piece)
        left, right = breaks[piece], breaks[piece + 1]
        x = ((time - left) - (right - time)) / (right - left)
        if len(rests):
            x = x + 2.0 * rests[m] / (right - left)
        x = min(max(x, -1.0), 1.0)
        twice = 2.0 * x
        # One series beside the other: none waits for the one before.
        a0, a1, a2, a3, a4, a5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        b0, b1, b2, b3, b4, b5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        row = coefficients[np.uint64(piece)]
        for k in range(degree):
            n = np.uint64(degree - k)
            a0, b0 = (row[n, 0] + twice * a0) - b0, a0
            a1, b1 = (row[n, 1] + twice * a1) - b1, a1
            a2, b2 = (row[n, 2] + twice * a2) - b2, a2
            a3, b3 = (row[n, 3] + twice * a3) - b3, a3
            a4, b4 = (row[n, 4] + twice * a4) - b4, a4
            a5, b5 = (row[n, 5] + twice * a5) - b5, a5
        values[0, m] = (row[0, 0] + x * a0) - b0
        values[1, m] = (row[0, 1] + x * a1) - b1
        values[2, m] = (row[0, 2] + x * a2) - b2
        values[3, m] = (row[0, 3] + x * a3) - b3
        values[4, m] = (row[0, 4] + x * a4) - b4
        values[5, m] = (row[0, 5] + x * a5) - b5


@kernel
def compare(
    code: IntArray,
    constants: FloatArray,
    result: int,
    moments: FloatArray,
    fine_breaks: FloatArray,
    fine: FloatArray,
    coarse_breaks: FloatArray,
    coarse: FloatArray,
    times: FloatArray,
    safety: float,
    rounding: float,
) -> tuple[float, float, float, float, FloatArray]:
    """Return the estimated error of the finer run at ``times``, and their largest difference.

    Then the energy at t = 0, how far it strays at most, and the three integrals there. The estimate is
    ``safety`` times the difference, and ``rounding`` relative to the variables and to what they change by
    while the time is multiplied by 1 + rounding. NaN where one of the numbers is not finite.
    """
    registers = np.empty((4, 3 + len(code), WIDTH))
    rates, integrals = np.empty((STATE, WIDTH)), np.empty((3, WIDTH))
    none, zero = np.empty(0), np.zeros(1)
    values, others = np.empty((STATE, len(times))), np.empty((STATE, len(times)))
    states = np.empty((STATE, WIDTH))
    start = np.empty((STATE, 1))
    values_at(fine_breaks, fine, zero, none, start)
    for a in range(STATE):
        states[a, 0] = start[a, 0]
    evaluate(code, constants, result, moments, registers, states, rates, integrals, 1)
    reference = integrals[:, 0].copy()
    values_at(fine_breaks, fine, times, none, values)
    values_at(coarse_breaks, coarse, times, none, others)
    error, difference, stray = 0.0, 0.0, 0.0
    for begin in range(0, len(times), WIDTH):
        count = min(WIDTH, len(times) - begin)
        for a in range(STATE):
            for m in range(count):
                states[a, m] = values[a, begin + m]
        evaluate(code, constants, result, moments, registers, states, rates, integrals, count)
        for m in range(count):
            gap, size, speed, total = 0.0, 0.0, 0.0, 0.0
            for a in range(STATE):
                far = abs(states[a, m] - others[a, begin + m])
                total += far + abs(rates[a, m])
                gap, size = max(gap, far), max(size, abs(states[a, m]))
                speed = max(speed, abs(rates[a, m]))
            departure = abs(integrals[0, m] - reference[0])
            if not total + departure < math.inf:
                return math.nan, math.nan, math.nan, math.nan, reference
            error = max(error, safety * gap + rounding * (size + abs(times[begin + m]) * speed))
            difference, stray = max(difference, gap), max(stray, departure)
    return error, difference, reference[0], stray + rounding * abs(reference[0]), reference
