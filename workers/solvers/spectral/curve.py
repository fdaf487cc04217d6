r"""Points of the loop, the radicand P = p² on it, and the rate dt/du, compiled.

The phase u is θ/π of the orbits of a planar motion (one turn is 0 ≤ u ≤ 2):
v = m − h cos θ between two rest points, v = ±θ around the whole loop. Places are
stated by the distance w to an *anchor* (an end, the middle, a quarter turn), from
which the distances to the ends and the sines keep all their digits.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral.compiled import kernel
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
SLOTS = 96


@kernel
def loop_point(loop: FloatArray, sine: float, cosine: float) -> tuple[float, float, float, float]:
    """Return primed g1, g2, g3 and c = g2/cos v."""
    square = cosine * cosine
    alpha, size = loop[ALPHA], loop[G]
    if alpha == 2.0:
        g1 = size * sine * sine
        c = math.sqrt(loop[Z] * loop[Z] + size * size * (1.0 + sine * sine))
    else:
        log_sine = 0.5 * math.log1p(-square) if square < 0.75 else math.log(abs(sine))
        g1 = size * math.exp(alpha * log_sine)
        if square > 1e-24:
            c = math.sqrt(loop[Z] * loop[Z] - size * size * math.expm1(2.0 * alpha * log_sine) / square)
        else:
            c = math.sqrt(loop[Z] * loop[Z] + size * size * alpha)
    return loop[SIGN1] * g1, c * cosine, loop[Z] * sine, c


@kernel
def radicand(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    sine: float,
    cosine: float,
    work: FloatArray,
) -> float:
    """Return P at sin v and cos v."""
    g1, g2, g3, _ = loop_point(loop, sine, cosine)
    if loop[MIRRORED] != 0.0:
        D = -derivative(code, result, constants, g3, g2, g1, work)
    else:
        D = derivative(code, result, constants, g1, g2, g3, work)
    return float(loop[FACTOR] * g3 * D / g1)


@kernel
def radicand_with_bound(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    sine: float,
    cosine: float,
    work: FloatArray,
) -> tuple[float, float]:
    """Return P and the bound of its rounding."""
    g1, g2, g3, _ = loop_point(loop, sine, cosine)
    if loop[MIRRORED] != 0.0:
        D, ulps = derivative_with_bound(code, result, constants, g3, g2, g1, work)
        D = -D
    else:
        D, ulps = derivative_with_bound(code, result, constants, g1, g2, g3, work)
    factor = loop[FACTOR] * g3 / g1
    return factor * D, abs(factor) * (ulps + 6.0 * abs(D)) * 1.1102230246251565e-16


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


@kernel
def rate(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    anchor: int,
    w: float,
    work: FloatArray,
) -> float:
    """Return dt/du at a place."""
    below, above, sine, cosine, _ = place(loop, anchor, w)
    _, _, _, c = loop_point(loop, sine, cosine)
    if loop[ROOTS_MODE] != 0.0:
        K = factor_by_roots(loop, below, above, sine, cosine)
    else:
        K = radicand(code, result, constants, loop, sine, cosine, work)
        if loop[ROTATES] == 0.0:
            K /= below * above
    return math.pi * loop[Z] / (c * math.sqrt(K)) if K > 0.0 else math.nan
