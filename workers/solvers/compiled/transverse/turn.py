r"""The monodromy of Hill's equation over one turn of an orbit, from its time map, compiled.

It is what :mod:`workers.solvers.stability.monodromy` does in balls: the panels are those of the time map,
which resolve the motion; each is halved until its propagator is the product of those of its halves. On the
way back over its half turn a libration finds the same c, and a panel's propagator P becomes R P⁻¹ R, where
R = diag(1, −1).

The trace is off by what halving changed and determinants lack to 1, carried by the norms of what is before
and after; and to first order, with the monodromy K(x) that begins at x, by

.. math:: \int |K_{01} δβ| + |K_{10} δα| \,dx

for the roundings δα, δβ of dt/dx and c (:mod:`.parts` has both equations), and for what the ends of the
window are in doubt by. The first is a measurement, the other a bound of first order.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Discs, Formula, Instructions, Records
from workers.solvers.compiled.transverse.parts import (
    ALPHA,
    ALPHA_ERROR,
    BETA,
    BETA_ERROR,
    C_ERROR,
    C_ROW,
    M_ROW,
    Q_ROW,
    RELATIVE,
    ROWS,
    WIDTH,
    cross_part,
    doubt_of_ends,
    error_of_rate,
    is_integrable,
)
from workers.solvers.compiled.workspace import POINTS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PROPAGATOR_RELATIVE_CHANGE, PROPAGATOR_ROUNDING = 1e-14, 4.0 * 2.0**-52
"""As those of :mod:`workers.solvers.stability.monodromy`."""
MAX_PANELS = 96
"""Panels, and those that wait: motions that need more are left to balls."""
ERROR, EXCURSION, SPEED, LOOKED_AT = range(4, 8)
"""Places in what :func:`turn` fills in, after the matrix: see there."""


@inlined
def _norm_of_product(a: FloatArray, b: FloatArray) -> float:
    total = 0.0
    for i in range(2):
        for j in range(2):
            entry = a[i, 0] * b[0, j] + a[i, 1] * b[1, j]
            total += entry * entry
    return math.sqrt(total)


@inlined
def _multiply(a: FloatArray, b: FloatArray, to: FloatArray) -> None:
    for j in range(2):
        first, second = b[0, j], b[1, j]
        to[0, j] = a[0, 0] * first + a[0, 1] * second
        to[1, j] = a[1, 0] * first + a[1, 1] * second


@inlined
def _spectral(a: FloatArray) -> float:
    square = a[0, 0] ** 2 + a[0, 1] ** 2 + a[1, 0] ** 2 + a[1, 1] ** 2
    determinant = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    rest = math.sqrt(max(0.0, square - 2.0 * abs(determinant)) * (square + 2.0 * abs(determinant)))
    return math.sqrt(0.5 * (square + rest))


@kernel
def _merge(
    whole: FloatArray, first: FloatArray, second: FloatArray, product: FloatArray
) -> tuple[float, float]:
    """Fill in the product of both halves; return what it and its determinant are off by, and its norm."""
    _multiply(second, first, product)
    size, change = 0.0, 0.0
    for i in range(2):
        for j in range(2):
            size += product[i, j] ** 2
            change += (product[i, j] - whole[i, j]) ** 2
    size = math.sqrt(size)
    stray = abs(product[0, 0] * product[1, 1] - product[0, 1] * product[1, 0] - 1.0) + PROPAGATOR_ROUNDING
    return math.sqrt(change) + stray * size, size


@kernel
def _error_from_roundings(stages: FloatArray, K: FloatArray) -> float:
    """Return what roundings at the stages of a part do to the trace, K being the monodromy from its start."""
    total = 0.0
    for k in range(WIDTH):
        q0, q1 = stages[Q_ROW, k], stages[Q_ROW + 1, k]
        m0, m1 = stages[M_ROW, k], stages[M_ROW + 1, k]
        # Y K Y⁻¹, det Y = 1.
        a, b = q0 * K[0, 0] + q1 * K[1, 0], q0 * K[0, 1] + q1 * K[1, 1]
        c, d = m0 * K[0, 0] + m1 * K[1, 0], m0 * K[0, 1] + m1 * K[1, 1]
        upper, lower = b * q0 - a * q1, c * m1 - d * m0
        total += stages[RELATIVE, k] * abs(upper * stages[BETA, k] - lower * stages[ALPHA, k])
        total += abs(upper) * stages[BETA_ERROR, k] + abs(lower) * stages[ALPHA_ERROR, k]
    return total


@kernel
def _assemble(
    parts: FloatArray, errors: FloatArray, stages: FloatArray, count: int, returns: bool, out: FloatArray
) -> None:
    """Fill in the monodromy, the error of its trace and the excursion, from propagators in their order.

    ``errors`` are those of two parts together, at the first of them.
    """
    turns = 2 * count if returns else count
    before, after = np.empty((turns + 1, 2, 2)), np.empty((turns + 1, 2, 2))
    before[0], after[turns] = np.eye(2), np.eye(2)
    longest = 1.0
    for n in range(turns):
        _multiply(parts[n], before[n], before[n + 1])
        longest = max(longest, _spectral(before[n + 1]))
        k = turns - 1 - n
        _multiply(after[k + 1], parts[k], after[k])
    error, K = 0.0, np.empty((2, 2))
    for n in range(count):
        if n % 2 == 0:
            error += errors[n // 2] * _norm_of_product(before[n], after[n + 2])
        _multiply(before[n], after[n], K)
        error += _error_from_roundings(stages[n], K)
    if returns:
        # What the way back does is the same: the monodromy from there has the same K01 and K10.
        error *= 2.0
    for k in range(4):
        out[k] = before[turns, k // 2, k % 2]
    out[ERROR], out[EXCURSION] = error, longest / max(1.0, _spectral(before[turns]))


@kernel
def turn(
    code: IntArray,
    result: int,
    instructions: Instructions,
    constants: FloatArray,
    loops: Records,
    panels: Records,
    founds: Records,
    workspaces: Records,
    moments: FloatArray,
    out: FloatArray,
) -> bool:
    """Fill in the monodromy of (q, M/(B ω)) from u = 0, and say whether that was possible.

    ``out``, shape (8,), has the matrix row by row, the error of its trace, the excursion, the largest
    size of (p, r) and the number of places looked at. ``moments`` are A, B, C, B − C, A − C, A − B;
    ``instructions`` those of :func:`service.dynamics.formula.derived.across`, the first result of which is D.
    """
    loop, places = loops[0], workspaces[0].places
    # No discs are worked on here.
    blank, none = np.empty((0, 0)), np.empty(0)
    discs = Discs(blank, blank, none)
    registers = new_registers(instructions.code, 2, POINTS)
    formula = Formula(code, result, instructions, constants, none, registers, discs, none)
    parts, errors = np.empty((4 * MAX_PANELS, 2, 2)), np.empty(MAX_PANELS)
    stages, waiting, ranges = (
        np.empty((2 * MAX_PANELS, ROWS, WIDTH)),
        np.empty((MAX_PANELS, 2, 2)),
        np.empty((MAX_PANELS, 2)),
    )
    frequency = 2.0 * math.pi / founds[0].period
    scale = moments[1] * frequency
    c, noise = stages[0, C_ROW], stages[0, C_ERROR]
    if not is_integrable(formula, loop, scale * frequency, moments, places, c, noise):
        return False
    doubt = doubt_of_ends(formula, loop, places, panels, len(panels))
    shift = 0.0 if loop.rotates else 2.0 * doubt / loop.half_width
    product = np.empty((2, 2))
    count, looked_at, speed = 0, 0, 0.0
    for n in range(len(panels)):
        panel = panels[n]
        relative, absolute = error_of_rate(formula, loop, panel, places)
        about = (frequency, scale, doubt, relative + shift, absolute)
        ranges[0, 0], ranges[0, 1] = panel.first, panel.last
        if count + 2 > 2 * MAX_PANELS:
            return False
        span = (panel.first, panel.last)
        cross_part(formula, loop, panel, span, about, moments, places, stages[count], waiting[0])
        looked_at += WIDTH
        pending = 1
        while pending:
            pending -= 1
            if count + 2 > 2 * MAX_PANELS or pending + 2 > MAX_PANELS:
                return False
            left, right = ranges[pending, 0], ranges[pending, 1]
            middle = 0.5 * (left + right)
            first, second = parts[count], parts[count + 1]
            for half in range(2):
                span = (left, middle) if half == 0 else (middle, right)
                to, end = stages[count + half], parts[count + half]
                fast = cross_part(formula, loop, panel, span, about, moments, places, to, end)
                speed = max(speed, fast)
            looked_at += 2 * WIDTH
            error, size = _merge(waiting[pending], first, second, product)
            if not size < math.inf:
                return False
            if error <= (PROPAGATOR_RELATIVE_CHANGE + PROPAGATOR_ROUNDING) * size:
                errors[count // 2] = error
                count += 2
                continue
            waiting[pending], ranges[pending, 0], ranges[pending, 1] = second, middle, right
            waiting[pending + 1], ranges[pending + 1, 0], ranges[pending + 1, 1] = first, left, middle
            pending += 2
    if not loop.rotates:
        for n in range(count):
            there, back = parts[count - 1 - n], parts[count + n]
            back[0, 0], back[0, 1], back[1, 0], back[1, 1] = (
                there[1, 1],
                there[0, 1],
                there[1, 0],
                there[0, 0],
            )
    _assemble(parts, errors, stages, count, not loop.rotates, out)
    out[SPEED], out[LOOKED_AT] = math.sqrt(speed), looked_at
    return bool(out[ERROR] < math.inf)
