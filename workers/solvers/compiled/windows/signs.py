r"""Proves the signs of a function on intervals, from series whose truncation is bounded.

A function F that is analytic and within M of F(c) in a disc that holds the ellipse ρ of a panel departs
from its interpolant p at NODES Chebyshev nodes by at most VALUE_TAIL · M, and F' from p' by SLOPE_TAIL · M.
A panel is cut into parts on which F has a certain sign or is monotone: then the signs at the
ends of what is monotone tell whether there is one zero or none.
"""

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]

NODES = 8
ELLIPSE = 4.0
"""ρ, the sum of the half axes, in halves of the panel."""
DISC_RADIUS = 0.5 * (ELLIPSE + 1.0 / ELLIPSE) * (1.0 + 1e-12)
"""Half its longer axis: the radius of the disc."""
_FROM = np.arange(NODES, 200)
# |a_k| ≤ 2 M ρ^−k; each further T_k is taken for a T_j with j < NODES by the nodes.
VALUE_TAIL = float(4.0 * np.sum(ELLIPSE**-_FROM)) * (1.0 + 1e-9)
SLOPE_TAIL = float(2.0 * np.sum(ELLIPSE**-_FROM * (_FROM**2 + (NODES - 1.0) ** 2))) * (1.0 + 1e-9)
FINEST_HALF_WIDTH = 1.0 / 64.0
"""Half the width of the smallest part of a panel, which is −1 ≤ x ≤ 1."""

SIGN, DIRECTION, AT, AT_SIDE = range(4)
"""State of the reading: the last certain sign, whether F grows since (0: it need not be known), and where."""


def nodes() -> FloatArray:
    """Return cos(π (j + 1/2)/NODES), growing."""
    j = np.arange(NODES)
    return np.asarray(np.sin(np.pi * (2 * j + 1 - NODES) / (2 * NODES)), dtype=np.float64)


def to_series() -> FloatArray:
    """Return the matrix (NODES, NODES) from values at the nodes to a series."""
    matrix = np.polynomial.chebyshev.chebvander(nodes(), NODES - 1).T * (2.0 / NODES)
    matrix[0] *= 0.5
    return np.asarray(matrix, dtype=np.float64)


@kernel
def is_certain(
    state: FloatArray,
    sign: float,
    left: float,
    left_side: float,
    right: float,
    right_side: float,
    brackets: FloatArray,
    found: int,
) -> int:
    """Go on over a part of one certain sign; return the number of brackets, −1 for a contradiction."""
    if state[SIGN] != 0.0 and sign != state[SIGN]:
        if state[DIRECTION] != sign or found == len(brackets):
            return -1
        brackets[found, 0], brackets[found, 1] = state[AT], state[AT_SIDE]
        brackets[found, 2], brackets[found, 3] = left, left_side
        found += 1
    state[SIGN], state[DIRECTION], state[AT], state[AT_SIDE] = sign, 0.0, right, right_side
    return found


@kernel
def read_panel(
    series: FloatArray,
    error: float,
    slope_error: float,
    begin: float,
    end: float,
    side: float,
    state: FloatArray,
    brackets: FloatArray,
    found: int,
) -> int:
    """Go on over a panel between two distances to a pole; return as :func:`is_certain`, −1 if too coarse."""
    rest, bend, steep = 0.0, 0.0, 0.0
    for k in range(1, NODES):
        size = abs(series[k])
        rest += size
        steep += k * k * size
        bend += k * k * (k * k - 1.0) / 3.0 * size
    if abs(series[0]) > rest + error:
        return is_certain(state, np.sign(series[0]), begin, side, end, side, brackets, found)
    if not error < np.inf:
        return -1
    stack = np.empty((16, 2))
    top = 0
    stack[0, 0], stack[0, 1] = -1.0, 1.0
    while top >= 0:
        a, b = stack[top, 0], stack[top, 1]
        top -= 1
        x, w = 0.5 * (a + b), 0.5 * (b - a)
        value, slope = value_and_slope(series, x)
        left, right = 0.5 * (begin * (1.0 - a) + end * (1.0 + a)), 0.5 * (begin * (1.0 - b) + end * (1.0 + b))
        rounding = 2.0**-48 * (abs(series[0]) + steep)
        if abs(value) > (abs(slope) + 0.5 * bend * w) * w + error + rounding:
            found = is_certain(state, np.sign(value), left, side, right, side, brackets, found)
            if found < 0:
                return -1
        elif abs(slope) > bend * w + slope_error + rounding:
            rises = np.sign(slope)
            if state[DIRECTION] == -rises:
                return -1
            state[DIRECTION] = rises
            last, _ = value_and_slope(series, b)
            if abs(last) > error + rounding:
                found = is_certain(state, np.sign(last), right, side, right, side, brackets, found)
                if found < 0:
                    return -1
        elif w <= FINEST_HALF_WIDTH:
            return -1
        else:
            stack[top + 1, 0], stack[top + 1, 1] = x, b
            stack[top + 2, 0], stack[top + 2, 1] = a, x
            top += 2
    return found


@kernel
def value_and_slope(series: FloatArray, x: float) -> tuple[float, float]:
    """Return the sum of a series and its derivative, by Clenshaw's recurrence."""
    b1, b2, d1, d2 = 0.0, 0.0, 0.0, 0.0
    for k in range(NODES - 1, 0, -1):
        d1, d2 = 2.0 * x * d1 - d2 + 2.0 * b1, d1
        b1, b2 = 2.0 * x * b1 - b2 + series[k], b1
    return x * b1 - b2 + series[0], b1 + x * d1 - d2
