r"""Steps of a fixed high order along the power series of a motion, by compiled code.

The radius of convergence ρ is read off the last two coefficients. A step is

.. math:: h = 0.98\, \rho\, \varepsilon^{1/(N+1)} ,

so that what is left out, a geometric series in h/ρ, is about ε of the largest variable. The states are summed
with what rounding has lost of them.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.general.series import ORDER, STATE, gradient_order, take_series
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ARRIVED, FAILED, TIRED = range(3)
"""How a run ends: at its end; by what is not finite, or a collapsed step; by its number of steps."""
CAUTION = 0.98
ROOM = 64
"""Steps for which there is memory at first."""
INVISIBLE = 2.0**-54
SPACING = 2.0**-50
"""Of a time, relative to it: some ulp."""


def _conversion() -> FloatArray:
    r"""Return :math:`u^k = 2^{1-2k} \sum_j' \binom{2k}{k-j} T_j(2u - 1)` as rows of coefficients.

    All are positive with the sum 1: the conversion loses nothing.
    """
    return np.array(
        [
            [
                math.comb(2 * k, k - j) / 4**k * (1 if j == 0 else 2) if j <= k else 0.0
                for j in range(ORDER + 1)
            ]
            for k in range(ORDER + 1)
        ]
    )


CONVERSION = np.ascontiguousarray(_conversion().T)


@kernel
def _radius(u: FloatArray) -> float:
    """Return the radius of convergence; NaN if a coefficient is not finite, inf if the last ones vanish."""
    size, last, before, total = 0.0, 0.0, 0.0, 0.0
    for a in range(STATE):
        size = max(size, abs(u[a, 0]))
        last = max(last, abs(u[a, ORDER]))
        before = max(before, abs(u[a, ORDER - 1]))
        for k in range(ORDER + 1):
            total += abs(u[a, k])
    if not total < math.inf:
        return math.nan
    radius = math.inf
    if last > 0.0:
        radius = math.pow(size / last, 1.0 / ORDER)
    if before > 0.0:
        radius = min(radius, math.pow(size / before, 1.0 / (ORDER - 1)))
    return radius


@kernel
def _put_piece(u: FloatArray, h: float, coefficients: FloatArray, work: FloatArray) -> None:
    """Put the Chebyshev series of the polynomials over [0, h] into ``coefficients``, shape (ORDER + 1, 6)."""
    factor = 1.0
    for k in range(ORDER + 1):
        for a in range(STATE):
            work[k, a] = u[a, k] * factor
        factor *= h
    for j in range(ORDER + 1):
        s0, s1, s2, s3, s4, s5 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(j, ORDER + 1):
            c = CONVERSION[j, k]
            s0 += c * work[k, 0]
            s1 += c * work[k, 1]
            s2 += c * work[k, 2]
            s3 += c * work[k, 3]
            s4 += c * work[k, 4]
            s5 += c * work[k, 5]
        coefficients[j, 0], coefficients[j, 1], coefficients[j, 2] = s0, s1, s2
        coefficients[j, 3], coefficients[j, 4], coefficients[j, 5] = s3, s4, s5


@kernel
def _trimmed(coefficients: FloatArray) -> FloatArray:
    """Return the series without the last coefficients that no double can see in any column."""
    count = coefficients.shape[0]
    size = np.zeros((ORDER + 1, STATE))
    for n in range(count):
        for k in range(ORDER + 1):
            for a in range(STATE):
                size[k, a] = max(size[k, a], abs(coefficients[n, k, a]))
    length = 1
    for a in range(STATE):
        largest = 0.0
        for k in range(ORDER + 1):
            largest = max(largest, size[k, a])
        tail, k = 0.0, ORDER
        while k >= length:
            tail += size[k, a]
            if tail > INVISIBLE * largest:
                length = k + 1
            k -= 1
    return coefficients[:, :length].copy()


@kernel
def take_steps(
    code: IntArray,
    constants: FloatArray,
    gradient: IntArray,
    moments: FloatArray,
    registers: int,
    state: FloatArray,
    end: float,
    tolerance: float,
    max_steps: int,
    longest: float,
    collapsed: float,
) -> tuple[int, FloatArray, FloatArray]:
    """Integrate from ``state`` at 0 to ``end``; return how that ends, the breaks, and Chebyshev series.

    Their shapes are (steps + 1,) and (steps, degree + 1, 6). No step is longer than ``longest``; one that
    is shorter than ``collapsed`` of the longest one ends the run, as do numbers that are not finite.
    """
    u = np.zeros((registers, ORDER + 1))
    for n in range(len(constants)):
        u[STATE + n, 0] = constants[n]
    lost, work = np.zeros(STATE), np.zeros((ORDER + 1, STATE))
    breaks, pieces = np.zeros(ROOM + 1), np.zeros((ROOM, ORDER + 1, STATE))
    for a in range(STATE):
        u[a, 0] = state[a]
    share = CAUTION * math.pow(tolerance, 1.0 / (ORDER + 1.0))
    count, time, longest_taken, total, status = 0, 0.0, 0.0, 0.0, ARRIVED
    while time != end:
        if count >= max_steps:
            status = TIRED
            break
        take_series(code, gradient, moments, u)
        step = share * _radius(u)
        left = abs(end - time)
        at_end = left <= longest and left <= step
        limit = min(left, longest)
        if not step >= 0.0:
            status = FAILED
            break
        is_cut = limit <= step
        step = min(step, limit)
        longest_taken = max(longest_taken, step)
        if not is_cut and not step > max(collapsed * longest_taken, SPACING * abs(time)):
            status = FAILED
            break
        following = end if at_end else time + math.copysign(step, end)
        h = following - time
        if count == len(pieces):
            more, wider = np.zeros(2 * count + 1), np.zeros((2 * count, ORDER + 1, STATE))
            more[: count + 1] = breaks
            wider[:count] = pieces
            breaks, pieces = more, wider
        _put_piece(u, h, pieces[count], work)
        total = 0.0
        for a in range(STATE):
            gain = u[a, ORDER]
            for k in range(ORDER - 1, 0, -1):
                gain = u[a, k] + h * gain
            gain = h * gain + lost[a]
            new = u[a, 0] + gain
            lost[a] = gain - (new - u[a, 0])
            u[a, 0] = new
            total += abs(new)
        if not total < math.inf:
            status = FAILED
            break
        count += 1
        time = following
        breaks[count] = time
    if count > 0 and status != TIRED and total < math.inf:
        # Where the potential is hardly less than smooth, a step can end beyond its domain.
        gradient_order(code, u, 0)
        if not abs(u[gradient[0], 0]) + abs(u[gradient[1], 0]) + abs(u[gradient[2], 0]) < math.inf:
            status, count = FAILED, count - 1
    return status, breaks[: count + 1].copy(), _trimmed(pieces[:count])
