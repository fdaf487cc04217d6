r"""Proves the signs of a function on intervals, from series whose truncation is bounded.

A function F that is analytic and within M of F(c) in a disc that holds the ellipse ρ of a panel departs
from its interpolant p at NODES Chebyshev nodes by at most VALUE_TAIL · M, and F' from p' by SLOPE_TAIL · M.
A panel is cut into parts on which F has a certain sign or is monotone: then the signs at the
ends of what is monotone tell whether there is one zero or none. The panels are those that half of the loop is
cut into, on which D is bounded by discs and by a series.
"""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.discs.rows import derivatives_on_discs, put_disc, put_pole
from workers.solvers.compiled.evaluation.curve import loop_points
from workers.solvers.compiled.evaluation.interpreter import derivative, power
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import DiscWorkspace, Places, Workspace

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
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
EDGES = (0.06, 0.135, 0.28, 0.5, 0.76, 1.03, 1.3, 0.5 * math.pi)
"""Edges of the first panels, as distances to the pole."""
EDGE_RATIO = 2.25
"""Between the edges of panels that are nearer to a pole than the first."""
MAX_NEARER_PANELS = 14
"""Largest number of panels nearer to a pole than the first."""
PANELS = 2 * (len(EDGES) - 1)
PANELS_TOGETHER = 10
"""Panels whose nodes are gone through together."""
NODE_ROUNDING_FACTOR = 64.0
"""Rounding of D at a node, in bounds of that in the middle of its panel."""
_EDGES = list(pairwise(EDGES))
POLE_SINE = math.sin(EDGES[0]) * (1.0 + 1e-12)


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


BEGINS, ENDS, SIDES = np.array(
    [(a, b, 1.0) for a, b in _EDGES] + [(b, a, -1.0) for a, b in _EDGES[::-1]]
).T.copy()
"""Ends of the first panels, as distances to the pole, and the side of the equator, by growing v."""
MIDDLE_SINES = np.array([math.sin(v) for v in 0.5 * (BEGINS + ENDS)])
MIDDLE_COSINES = SIDES * np.array([math.cos(v) for v in 0.5 * (BEGINS + ENDS)])
HALF_WIDTHS = 0.5 * np.abs(ENDS - BEGINS) * (1.0 + 1e-12)
X, TO_SERIES = nodes(), to_series()
_AWAY = 0.5 * (BEGINS[:, None] * (1.0 - X) + ENDS[:, None] * (1.0 + X)).ravel()
NODE_SINES = np.array([math.sin(v) for v in _AWAY])
NODE_COSINES = np.repeat(SIDES, NODES) * np.array([math.cos(v) for v in _AWAY])
NODE_LOGARITHMS = np.array([math.log(s) for s in NODE_SINES])
"""At the nodes of the first panels."""


@kernel
def _values(
    formula: Formula, loop: Loop, places: Places, logs: FloatArray, exponent: float, count: int
) -> None:
    """Fill in D, its power of s left out, instead of P."""
    loop_points(loop, places, count)
    first, third = (places.g3, places.g1) if loop.mirrored else (places.g1, places.g3)
    D = derivative(formula, first, places.g2, third, count)
    if exponent == math.floor(exponent):
        for k in range(count):
            places.radicand[k] = D[k] * power(abs(places.sine[k]), -exponent)
    else:
        for k in range(count):
            places.radicand[k] = D[k] * math.exp(-exponent * logs[k])


@kernel
def _put_panel(discs: DiscWorkspace, lane: int, half: float, begin: float, end: float, side: float) -> None:
    """Put the disc around a panel's ellipse on the disc workspace, and its centre alone on the next place."""
    middle, wide = 0.5 * (begin + end), 0.5 * abs(end - begin)
    sine, cosine = half * math.sin(middle), side * math.cos(middle)
    put_disc(discs, lane, sine, cosine, DISC_RADIUS * wide)
    put_disc(discs, lane + 1, sine, cosine, 0.0)


@kernel
def _series(values: FloatArray, first: int, series: FloatArray) -> None:
    for k in range(NODES):
        total = 0.0
        for j in range(NODES):
            total += TO_SERIES[k, j] * values[first + j]
        series[k] = total


@kernel
def resolve(
    formula: Formula,
    loop: Loop,
    half: float,
    exponent: float,
    panels: IntArray,
    errors: FloatArray,
    all_series: FloatArray,
    workspace: Workspace,
) -> None:
    """Fill in the series of some of the first panels, and the errors of their values and slopes."""
    number, logs = len(panels), np.empty(NODES * len(panels))
    for k in range(number):
        n = panels[k]
        sine, cosine = half * MIDDLE_SINES[n], MIDDLE_COSINES[n]
        put_disc(workspace.discs, 2 * k, sine, cosine, DISC_RADIUS * HALF_WIDTHS[n])
        put_disc(workspace.discs, 2 * k + 1, sine, cosine, 0.0)
        for j in range(NODES):
            at, to = NODES * n + j, NODES * k + j
            workspace.places.sine[to], workspace.places.cosine[to] = half * NODE_SINES[at], NODE_COSINES[at]
            logs[to] = NODE_LOGARITHMS[at]
    row = derivatives_on_discs(formula, loop, workspace.discs, 2 * number)
    _values(formula, loop, workspace.places, logs, exponent, NODES * number)
    for k in range(number):
        n = panels[k]
        far = formula.discs.radii[row, 2 * k]
        rounding = NODE_ROUNDING_FACTOR * formula.discs.radii[row, 2 * k + 1]
        errors[n, 0] = far * VALUE_TAIL + rounding
        errors[n, 1] = far * SLOPE_TAIL + rounding * NODES * NODES
        _series(workspace.places.radicand, NODES * k, all_series[n])


@kernel
def pole_cells(formula: Formula, loop: Loop, half: float, side: float, workspace: Workspace) -> int:
    """Return how many more panels lead to a cell at the pole on which D has one sign (−1: none)."""
    for k in range(MAX_NEARER_PANELS):
        put_pole(workspace.discs, k, math.sin(EDGES[0] / EDGE_RATIO ** (k + 1.0)) * (1.0 + 1e-15), side, half)
    row = derivatives_on_discs(formula, loop, workspace.discs, MAX_NEARER_PANELS)
    for k in range(MAX_NEARER_PANELS):
        if abs(formula.discs.centres[row, k]) > formula.discs.radii[row, k]:
            return k + 1
    return -1


@kernel
def read_alone(
    formula: Formula,
    loop: Loop,
    half: float,
    begin: float,
    end: float,
    side: float,
    exponent: float,
    state: FloatArray,
    brackets: FloatArray,
    found: int,
    workspace: Workspace,
) -> int:
    """Read a panel that is not among the first; the state stays as it was where that fails."""
    middle, wide = 0.5 * (begin + end), 0.5 * abs(end - begin)
    _put_panel(workspace.discs, 0, half, begin, end, side)
    put_disc(workspace.discs, 2, half * math.sin(middle), side * math.cos(middle), wide)
    row = derivatives_on_discs(formula, loop, workspace.discs, 3)
    c, r = formula.discs.centres, formula.discs.radii
    if abs(c[row, 2]) > r[row, 2]:
        return is_certain(state, np.sign(c[row, 2]), begin, side, end, side, brackets, found)
    far, rounding = r[row, 0], NODE_ROUNDING_FACTOR * r[row, 1]
    if not far < math.inf:
        return -1
    logs, series, kept = np.empty(NODES), np.empty(NODES), state.copy()
    for j in range(NODES):
        x = X[j]
        away = 0.5 * (begin * (1.0 - x) + end * (1.0 + x))
        workspace.places.sine[j], workspace.places.cosine[j] = half * math.sin(away), side * math.cos(away)
        logs[j] = math.log(math.sin(away))
    _values(formula, loop, workspace.places, logs, exponent, NODES)
    _series(workspace.places.radicand, 0, series)
    error, slope_error = far * VALUE_TAIL + rounding, far * SLOPE_TAIL + rounding * NODES * NODES
    found = read_panel(series, error, slope_error, begin, end, side, state, brackets, found)
    if found < 0:
        state[:] = kept
    return found
