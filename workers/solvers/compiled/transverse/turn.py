r"""The monodromy of Hill's equation over one turn of an orbit, from its time map, compiled.

It is what :mod:`workers.solvers.stability.monodromy` does in balls: the panels are those of the time map, which
resolve the motion; each is halved until its propagator is the product of those of its halves. On the way back
over its half turn a libration finds the same c, and a panel's propagator P becomes R P⁻¹ R, R = diag(1, −1).

The trace is off by what halving changed and determinants lack to 1, carried by the norms of what is before and
after; and to first order, with the monodromy K(x) that begins at x, by

.. math:: \int |K_{01} δβ| + |K_{10} δα| \,dx

for the roundings δα, δβ of dt/dx and c (:mod:`.hill` has both equations), and for what the ends of the window
are in doubt by. The first is a measurement, the other a bound of first order.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.desk import Places
from workers.solvers.compiled.evaluation.curve import loop_points, place, radicands_with_bounds
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import NODES, Formula, Loop, Panel, Records
from workers.solvers.compiled.time_map.series import POINTS, at, distance, last_coefficients
from workers.solvers.compiled.transverse.hill import coefficients
from workers.solvers.compiled.transverse.jets import WIDTH
from workers.solvers.compiled.transverse.steps import STAGES, WEIGHTS, cross

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

EPSILON = 2.0**-52
RESOLVED = 1e-14
ROUNDINGS = 4.0
"""As those of :mod:`workers.solvers.stability.monodromy`."""
MOST = 96
"""Panels, and those that wait: motions that need more are left to balls."""
PLACES, AMPLIFIED = 8, 2.0
"""Of a panel, where the rounding of P is looked at; what interpolation makes of roundings at its nodes."""
DISTANCES = (2.0**-16, 2.0**-26)
"""From a pole, in θ."""
NEAREST = 0.99
"""Of a pole to the end of a libration, in parts of its half width."""
ERROR, EXCURSION, SPEED, LOOKED_AT = range(4, 8)
"""Places in what :func:`turn` fills in, after the matrix: see there."""
Q, M, ALPHA, BETA, C, C_ERROR, RELATIVE, ALPHA_ERROR, BETA_ERROR, ROWS = 0, 2, 4, 5, 6, 7, 8, 9, 10, 11
"""Rows of stages: q and M/(B ω) of both solutions, the coefficients, c, and errors, multiplied by weights."""


@inlined
def _put(loop: Loop, places: Places, k: int, anchor: int, w: float) -> None:
    places.below[k], places.above[k], places.sine[k], places.cosine[k], places.speed[k] = place(
        loop, anchor, w
    )


@kernel
def _doubt_of_ends(formula: Formula, loop: Loop, places: Places, panels: Records, number: int) -> float:
    """Return by how much the ends of a libration, zeros of P, may be wrong in v."""
    if loop.rotates:
        return 0.0
    places.sine[0], places.cosine[0] = loop.s_lower, loop.c_lower
    places.sine[1], places.cosine[1] = loop.s_upper, loop.c_upper
    radicands_with_bounds(formula, loop, places, 2)
    doubt = 0.0
    for k in range(2):
        panel = panels[0 if k == 0 else number - 1]
        _, slope = at(panel, panel.first if k == 0 else panel.last)
        rate = slope * 2.0 / (panel.high - panel.low)
        # dt/du = π Z/(c √K), and P' = 2 h K at the end.
        root = math.pi * loop.z / (places.c[k] * rate)
        doubt = max(doubt, places.bound[k] / (2.0 * loop.half_width * root * root))
    return doubt + EPSILON


@kernel
def _error_of_rate(formula: Formula, loop: Loop, panel: Panel, places: Places) -> tuple[float, float]:
    """Return the relative error of dt/dx on a panel, and an absolute one.

    The rounding of P is looked at where the series was made. Where nothing is proved, the last coefficients
    say what a series leaves out, as for the time map (:mod:`compiled.time_map.error`).
    """
    is_half = panel.last - panel.first < 2.0
    for k in range(PLACES):
        j = 2 * k
        if is_half:
            j = k if panel.last > 0.0 else NODES - 1 - k
        _put(loop, places, k, panel.anchor, distance(panel, POINTS[j]))
    radicands_with_bounds(formula, loop, places, PLACES)
    total = 0.0
    for k in range(PLACES):
        total += places.bound[k] / abs(places.radicand[k])
    noise = AMPLIFIED * 0.5 * total / PLACES + 8.0 * EPSILON
    if not math.isnan(panel.proved):
        return noise + panel.proved, 0.0
    return noise, 2.0 * last_coefficients(panel.slopes)


@kernel
def _cross(
    formula: Formula,
    loop: Loop,
    panel: Panel,
    spans: tuple[float, float],
    about: tuple[float, float, float, float, float],
    moments: FloatArray,
    places: Places,
    jets: FloatArray,
    stages: FloatArray,
    end: FloatArray,
) -> float:
    """Fill in the propagator of a part of a panel, and the rows of its ``stages``; return max p² + r².

    ``about`` are ω, B ω, the doubt of the ends, and the relative and the absolute error of dt/dx.
    """
    frequency, scale, doubt, relative, absolute = about
    middle, half = 0.5 * (spans[0] + spans[1]), 0.5 * (spans[1] - spans[0])
    alpha, beta, c, errors = stages[ALPHA], stages[BETA], stages[C], stages[C_ERROR]
    for k in range(WIDTH):
        _put(loop, places, k, panel.anchor, distance(panel, middle + half * STAGES[k]))
    fastest = coefficients(formula, loop, moments, places, jets, c, errors)
    for k in range(WIDTH):
        _, slope = at(panel, middle + half * STAGES[k])
        alpha[k], beta[k] = frequency * (slope * half), c[k] / scale * (slope * half)
    cross(alpha, beta, stages[Q:M], stages[M:ALPHA], end)
    for k in range(WIDTH):
        j = k if k < WIDTH - 1 else k - 1
        error = errors[k]
        if doubt > 0.0:
            error += doubt * abs((c[j + 1] - c[j]) / (places.below[j + 1] - places.below[j]))
        stages[RELATIVE, k] = WEIGHTS[k] * relative
        stages[ALPHA_ERROR, k] = WEIGHTS[k] * absolute * half * frequency
        stages[BETA_ERROR, k] = (
            WEIGHTS[k] * (absolute * half * abs(c[k]) + abs(alpha[k] / frequency) * error) / scale
        )
    return fastest


@kernel
def _is_integrable(
    formula: Formula,
    loop: Loop,
    scale: float,
    moments: FloatArray,
    places: Places,
    jets: FloatArray,
    c: FloatArray,
    errors: FloatArray,
) -> bool:
    """Tell whether |c| times the distance from each pole falls towards it, as is required in balls."""
    middle = math.atan2(loop.s_middle, loop.c_middle)
    for pole in range(-1, 3):
        if loop.rotates:
            if pole < 0 or pole > 1:
                continue
            anchor, w = 2 * pole, 0.0
        else:
            share = (math.pi * pole - middle) / loop.half_width
            if abs(share) >= 1.0:
                continue
            if abs(share) > NEAREST:
                return False
            anchor, w = 1, math.asin(share) / math.pi
        for k in range(WIDTH):
            side = 1.0 if k % 2 else -1.0
            _put(loop, places, k, anchor, w + side * DISTANCES[(k // 2) % 2] / math.pi)
        coefficients(formula, loop, moments, places, jets, c, errors)
        for k in range(2):
            far = max(abs(c[k]), scale) * DISTANCES[0]
            if not abs(c[2 + k]) * DISTANCES[1] < 0.5 * far:
                return False
    return True


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
    stray = abs(product[0, 0] * product[1, 1] - product[0, 1] * product[1, 0] - 1.0) + ROUNDINGS * EPSILON
    return math.sqrt(change) + stray * size, size


@kernel
def _error_from_roundings(stages: FloatArray, K: FloatArray) -> float:
    """Return what the roundings at the stages of a part do to the trace; K is the monodromy from its start."""
    total = 0.0
    for k in range(WIDTH):
        q0, q1, m0, m1 = stages[Q, k], stages[Q + 1, k], stages[M, k], stages[M + 1, k]
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
    constants: FloatArray,
    loops: Records,
    panels: Records,
    founds: Records,
    desks: Records,
    moments: FloatArray,
    out: FloatArray,
) -> bool:
    """Fill in the monodromy of (q, M/(B ω)) from u = 0, and say whether that was possible.

    ``out``, shape (8,), has the matrix row by row, the error of its trace, the excursion, the largest
    \\|(p, r)\\| and the number of places looked at. ``moments`` are A, B, C, B − C, A − C, A − B.
    """
    loop, places = loops[0], desks[0].places
    # No discs are worked on here.
    blank, none = np.empty((0, 0)), np.empty(0)
    formula = Formula(code, result, constants, none, new_registers(code), blank, none, none, none)
    jets = np.empty((8, code.shape[0] + 3, WIDTH))
    parts, errors = np.empty((4 * MOST, 2, 2)), np.empty(MOST)
    stages, waiting, ranges = np.empty((2 * MOST, ROWS, WIDTH)), np.empty((MOST, 2, 2)), np.empty((MOST, 2))
    frequency = 2.0 * math.pi / founds[0].period
    scale = moments[1] * frequency
    c, noise = stages[0, C], stages[0, C_ERROR]
    if not _is_integrable(formula, loop, scale * frequency, moments, places, jets, c, noise):
        return False
    doubt = _doubt_of_ends(formula, loop, places, panels, len(panels))
    shift = 0.0 if loop.rotates else 2.0 * doubt / loop.half_width
    product = np.empty((2, 2))
    count, looked_at, speed = 0, 0, 0.0
    for n in range(len(panels)):
        panel = panels[n]
        relative, absolute = _error_of_rate(formula, loop, panel, places)
        about = (frequency, scale, doubt, relative + shift, absolute)
        ranges[0, 0], ranges[0, 1] = panel.first, panel.last
        if count + 2 > 2 * MOST:
            return False
        span = (panel.first, panel.last)
        _cross(formula, loop, panel, span, about, moments, places, jets, stages[count], waiting[0])
        looked_at += WIDTH
        pending = 1
        while pending:
            pending -= 1
            if count + 2 > 2 * MOST or pending + 2 > MOST:
                return False
            left, right = ranges[pending, 0], ranges[pending, 1]
            middle = 0.5 * (left + right)
            first, second = parts[count], parts[count + 1]
            for half in range(2):
                span = (left, middle) if half == 0 else (middle, right)
                to, end = stages[count + half], parts[count + half]
                fast = _cross(formula, loop, panel, span, about, moments, places, jets, to, end)
                speed = max(speed, fast)
            looked_at += 2 * WIDTH
            error, size = _merge(waiting[pending], first, second, product)
            if not size < math.inf:
                return False
            if error <= (RESOLVED + ROUNDINGS * EPSILON) * size:
                errors[count // 2] = error
                count += 2
                continue
            waiting[pending], ranges[pending, 0], ranges[pending, 1] = second, middle, right
            waiting[pending + 1], ranges[pending + 1, 0], ranges[pending + 1, 1] = first, left, middle
            pending += 2
    if not loop.rotates:
        for n in range(count):
            there, back = parts[count - 1 - n], parts[count + n]
            back[0, 0], back[0, 1], back[1, 0], back[1, 1] = there[1, 1], there[0, 1], there[1, 0], there[0, 0]
    _assemble(parts, errors, stages, count, not loop.rotates, out)
    out[SPEED], out[LOOKED_AT] = math.sqrt(speed), looked_at
    return bool(out[ERROR] < math.inf)
