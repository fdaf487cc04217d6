r"""Points of the loop, the radicand P = p² on it, and the rate dt/du, compiled.

The phase u is θ/π of the orbits of a planar motion (one turn is 0 ≤ u ≤ 2):
v = m − h cos θ between two rest points, v = ±θ around the whole loop. Places are
stated by the distance w to an *anchor* (an end, the middle, a quarter turn), from
which the distances to the ends and the sines keep all their digits.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral.compiled import inlined, kernel
from workers.solvers.spectral.interpreter import derivative, derivative_with_bound

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Slots of the vector that describes a loop and an orbit on it.
Z, G, ALPHA, FACTOR, SIGN1, MIRRORED = range(6)
"""Of the loop: α = A/C > 1, C/((A−C)A), sign of the primed g1, 1.0 if mirrored."""
ROTATES, HALF, S_LOWER, C_LOWER, S_MIDDLE, C_MIDDLE, S_UPPER, C_UPPER, DIRECTION = range(6, 15)
"""Of the orbit: (v₊ − v₋)/2, sine and cosine at the ends and in the middle, sense of rotation."""
PERIOD_HI, PERIOD_LO, ORIGIN, BACKWARDS = range(15, 19)
"""Its period; the time from u = 0 (or from u = 1 back, if BACKWARDS) to the start."""
ROOTS_MODE = 19
"""1.0 if P is known by its roots: the slots behind it: see :func:`factor_by_roots`."""
ORIGIN_LO = 95
"""What ORIGIN leaves out."""
SLOTS = 96


# Rows of a desk, on which many places of the loop are worked on together.
SINE, COSINE, BELOW, ABOVE, SPEED, G1, G2, G3, C, VALUE, BOUND, WIDTH, TIME, SENSE = range(14)
"""Of v; v − v₋, v₊ − v and |dv/du|; primed g1, g2, g3 and c = g2/cos v; P (or dt/du) and its bound.

The last three are those of :mod:`.sampling`."""
ROWS = 14


@kernel
def loop_points(loop: FloatArray, desk: FloatArray, count: int) -> None:
    """Fill in primed g1, g2, g3 and c at places whose sines and cosines are on the desk."""
    alpha, size, z, sign = loop[ALPHA], loop[G], loop[Z], loop[SIGN1]
    if alpha == 2.0:
        for k in range(count):
            sine = desk[SINE, k]
            c = math.sqrt(z * z + size * size * (1.0 + sine * sine))
            desk[G1, k], desk[G2, k] = sign * (size * sine * sine), c * desk[COSINE, k]
            desk[G3, k], desk[C, k] = z * sine, c
        return
    for k in range(count):
        sine, cosine = desk[SINE, k], desk[COSINE, k]
        square = cosine * cosine
        log_sine = 0.5 * math.log1p(-square) if square < 0.75 else math.log(abs(sine))
        if square > 1e-24:
            c = math.sqrt(z * z - size * size * math.expm1(2.0 * alpha * log_sine) / square)
        else:
            c = math.sqrt(z * z + size * size * alpha)
        desk[G1, k], desk[G2, k] = sign * (size * math.exp(alpha * log_sine)), c * cosine
        desk[G3, k], desk[C, k] = z * sine, c


@kernel
def radicands(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    desk: FloatArray,
    count: int,
    work: FloatArray,
) -> None:
    """Fill in P at places whose sines and cosines are on the desk."""
    loop_points(loop, desk, count)
    first, third, factor = (G3, G1, -loop[FACTOR]) if loop[MIRRORED] != 0.0 else (G1, G3, loop[FACTOR])
    D = derivative(code, result, constants, desk, (first, G2, third), count, work)
    for k in range(count):
        desk[VALUE, k] = factor * desk[G3, k] * D[k] / desk[G1, k]


@inlined
def radicands_with_bounds(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    desk: FloatArray,
    count: int,
    work: FloatArray,
) -> None:
    """Fill in P and the bound of its rounding."""
    loop_points(loop, desk, count)
    first, third, sign = (G3, G1, -1.0) if loop[MIRRORED] != 0.0 else (G1, G3, 1.0)
    D, ulps = derivative_with_bound(code, result, constants, desk, (first, G2, third), count, work)
    for k in range(count):
        factor = loop[FACTOR] * desk[G3, k] / desk[G1, k]
        desk[VALUE, k] = factor * (sign * D[k])
        desk[BOUND, k] = abs(factor) * (ulps[k] + 6.0 * abs(D[k])) * 1.1102230246251565e-16


@kernel
def place(loop: FloatArray, anchor: int, w: float) -> tuple[float, float, float, float, float]:
    """Return v − v₋, v₊ − v, sin v, cos v and |dv/du| at u = anchor/2 + w."""
    if loop[ROTATES] != 0.0:
        turn = math.pi * w
        sine, cosine = math.sin(turn), math.cos(turn)
        for _ in range(anchor):
            sine, cosine = cosine, -sine
        return 0.0, 0.0, loop[DIRECTION] * sine, cosine, math.pi
    h = loop[HALF]
    if anchor == 1:
        offset = h * math.sin(math.pi * w)
        s, c = math.sin(offset), math.cos(offset)
        sine = loop[S_MIDDLE] * c + loop[C_MIDDLE] * s
        cosine = loop[C_MIDDLE] * c - loop[S_MIDDLE] * s
        return h + offset, h - offset, sine, cosine, math.pi * h * math.cos(math.pi * w)
    root = math.sin(0.5 * math.pi * w)
    near = 2.0 * h * root * root
    s, c = math.sin(near), math.cos(near)
    speed = math.pi * h * abs(math.sin(math.pi * w))
    if anchor == 0:
        sine, cosine = loop[S_LOWER] * c + loop[C_LOWER] * s, loop[C_LOWER] * c - loop[S_LOWER] * s
        return near, 2.0 * h - near, sine, cosine, speed
    sine, cosine = loop[S_UPPER] * c - loop[C_UPPER] * s, loop[C_UPPER] * c + loop[S_UPPER] * s
    return 2.0 * h - near, near, sine, cosine, speed


@kernel
def ratio(sine: float, angle: float) -> float:
    """Return sin x / x, 1 at 0."""
    return sine / angle if angle > 0.0 else 1.0


@kernel
def factor_by_roots(loop: FloatArray, below: float, above: float, sine: float, cosine: float) -> float:
    """Return K (P for a rotation) from the roots in x = |g1| = G sin²v, for A = 2C.

    Slots from ROOTS_MODE: 1.0, the leading factor, μ with P = factor · x^−μ · Π, the
    kind of ends (0 rotation, 1 both ends are one root of x, its value from below, 2 the
    same from above, 3 two roots and x grows with v, 4 it falls), then the number of real
    roots that are no ends and of complex pairs; for each real root lo − r or r − hi after
    a flag −1 or 1, for each pair its real and imaginary part.
    """
    o = ROOTS_MODE
    size = loop[G]
    x, equator = size * sine * sine, size * cosine * cosine
    kind = int(loop[o + 3])
    up, down = x, equator
    value = loop[o + 1]
    # sin(v − v₋) and sin(v₊ − v); far from the end, where they are small again, by the addition theorem.
    to_lower, to_upper = math.sin(below), math.sin(above)
    if below > 1.5 and above < below:
        to_lower = abs(sine * loop[C_LOWER] - cosine * loop[S_LOWER])
    elif above > 1.5:
        to_upper = abs(loop[S_UPPER] * cosine - loop[C_UPPER] * sine)
    if kind == 1 or kind == 2:
        value *= size * ratio(to_lower, below) * ratio(to_upper, above)
        if kind == 1:
            up = size * to_lower * to_upper
        else:
            down = size * to_lower * to_upper
    elif kind >= 3:
        first = sine * loop[C_LOWER] + cosine * loop[S_LOWER]
        second = sine * loop[C_UPPER] + cosine * loop[S_UPPER]
        value *= abs(size * size * ratio(to_lower, below) * ratio(to_upper, above) * first * second)
        up, down = abs(size * to_lower * first), abs(size * to_upper * second)
        if kind == 4:
            up, down = down, up
    value *= x ** -loop[o + 2]
    reals, pairs = int(loop[o + 4]), int(loop[o + 5])
    k = o + 6
    for _ in range(reals):
        value *= (up if loop[k] < 0.0 else down) + loop[k + 1]
        k += 2
    for _ in range(pairs):
        away = x - loop[k]
        value *= away * away + loop[k + 1] * loop[k + 1]
        k += 2
    return float(value)


@inlined
def rates(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    desk: FloatArray,
    count: int,
    work: FloatArray,
) -> None:
    """Fill in dt/du at places that are on the desk as :func:`place` has them."""
    if loop[ROOTS_MODE] != 0.0:
        loop_points(loop, desk, count)
        for k in range(count):
            desk[VALUE, k] = factor_by_roots(
                loop, desk[BELOW, k], desk[ABOVE, k], desk[SINE, k], desk[COSINE, k]
            )
    else:
        radicands(code, result, constants, loop, desk, count, work)
        if loop[ROTATES] == 0.0:
            for k in range(count):
                desk[VALUE, k] /= desk[BELOW, k] * desk[ABOVE, k]
    numerator = math.pi * loop[Z]
    for k in range(count):
        K = desk[VALUE, k]
        rate = numerator / (desk[C, k] * math.sqrt(K))
        desk[VALUE, k] = rate if K > 0.0 else math.nan
