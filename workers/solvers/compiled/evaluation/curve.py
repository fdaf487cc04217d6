r"""Points of the loop, the radicand P = p² on it, and the rate dt/du, compiled.

The phase u is θ/π of the orbits of a planar motion (one turn is 0 ≤ u ≤ 2):
v = m − h cos θ between two rest points, v = ±θ around the whole loop. Places are
stated by the distance w to an *anchor* (an end, the middle, a quarter turn), from
which the distances to the ends and the sines keep all their digits.

A program, gone through in degrees, also tells whether V is a sum of low powers, which have no features much
narrower than the sphere.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.evaluation.interpreter import (
    CompiledArithmetic,
    Constant,
    derivative,
    derivative_with_bound,
    double_of,
    get_triple,
    interpreter_of,
    new_registers,
    put_triple,
)
from workers.solvers.compiled.evaluation.program import ABS
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula, Loop
from workers.solvers.compiled.workspace import Moments, Places

FloatArray = NDArray[np.float64]
Degrees = tuple[float, float, float]
"""The lowest and the highest degree, and the kind."""
HIGHEST_DEGREE = 12.0
"""Degree, of either sign, of the products of g1, g2 and g3 that V is a sum of."""
NUMBER, PRODUCT, SUM, OTHER = 0.0, 1.0, 2.0, 3.0
"""The kinds of registers: a number, a product of powers of g1 and g3, a sum of such products and whole powers
of g2, and anything else."""


@inlined
def size_and_c(alpha: float, z: float, size: float, sine: float, cosine: float) -> tuple[float, float]:
    """Return |g1| and c at a place; see :mod:`service.dynamics.reduction.geometry.point`."""
    square = cosine * cosine
    log_sine = 0.5 * math.log1p(-square) if square < 0.75 else math.log(abs(sine))
    if square > 1e-24:
        c = math.sqrt(z * z - size * size * math.expm1(2.0 * alpha * log_sine) / square)
    else:
        c = math.sqrt(z * z + size * size * alpha)
    return size * math.exp(alpha * log_sine), c


@kernel
def loop_points(loop: Loop, places: Places | Moments, count: int) -> None:
    """Fill in primed g1, g2, g3 and c at places whose sines and cosines are known."""
    alpha, size, z, sign = loop.alpha, loop.g, loop.z, loop.sign1
    if alpha == 2.0:
        for k in range(count):
            sine = places.sine[k]
            c = math.sqrt(z * z + size * size * (1.0 + sine * sine))
            places.g1[k], places.g2[k] = sign * (size * sine * sine), c * places.cosine[k]
            places.g3[k], places.c[k] = z * sine, c
        return
    for k in range(count):
        sine, cosine = places.sine[k], places.cosine[k]
        first, c = size_and_c(alpha, z, size, sine, cosine)
        places.g1[k], places.g2[k] = sign * first, c * cosine
        places.g3[k], places.c[k] = z * sine, c


@kernel
def radicands(formula: Formula, loop: Loop, places: Places, count: int) -> None:
    """Fill in P at places whose sines and cosines are known."""
    loop_points(loop, places, count)
    factor = -loop.factor if loop.mirrored else loop.factor
    first, third = (places.g3, places.g1) if loop.mirrored else (places.g1, places.g3)
    D = derivative(formula, first, places.g2, third, count)
    for k in range(count):
        places.radicand[k] = factor * places.g3[k] * D[k] / places.g1[k]


@inlined
def radicands_with_bounds(formula: Formula, loop: Loop, places: Places, count: int) -> None:
    """Fill in P and the bound of its rounding."""
    loop_points(loop, places, count)
    sign = -1.0 if loop.mirrored else 1.0
    first, third = (places.g3, places.g1) if loop.mirrored else (places.g1, places.g3)
    D, ulps = derivative_with_bound(formula, first, places.g2, third, count)
    for k in range(count):
        factor = loop.factor * places.g3[k] / places.g1[k]
        places.radicand[k] = factor * (sign * D[k])
        places.bound[k] = abs(factor) * (ulps[k] + 6.0 * abs(D[k])) * 1.1102230246251565e-16


@kernel
def place(loop: Loop, anchor: int, w: float) -> tuple[float, float, float, float, float]:
    """Return v − v₋, v₊ − v, sin v, cos v and |dv/du| at u = anchor/2 + w."""
    if loop.rotates:
        turn = math.pi * w
        sine, cosine = math.sin(turn), math.cos(turn)
        for _ in range(anchor):
            sine, cosine = cosine, -sine
        return 0.0, 0.0, loop.direction * sine, cosine, math.pi
    h = loop.half_width
    if anchor == 1:
        offset = h * math.sin(math.pi * w)
        s, c = math.sin(offset), math.cos(offset)
        sine = loop.s_middle * c + loop.c_middle * s
        cosine = loop.c_middle * c - loop.s_middle * s
        return h + offset, h - offset, sine, cosine, math.pi * h * math.cos(math.pi * w)
    root = math.sin(0.5 * math.pi * w)
    near = 2.0 * h * root * root
    s, c = math.sin(near), math.cos(near)
    speed = math.pi * h * abs(math.sin(math.pi * w))
    if anchor == 0:
        sine, cosine = loop.s_lower * c + loop.c_lower * s, loop.c_lower * c - loop.s_lower * s
        return near, 2.0 * h - near, sine, cosine, speed
    sine, cosine = loop.s_upper * c - loop.c_upper * s, loop.c_upper * c + loop.s_upper * s
    return 2.0 * h - near, near, sine, cosine, speed


@kernel
def ratio(sine: float, angle: float) -> float:
    """Return sin x / x, 1 at 0."""
    return sine / angle if angle > 0.0 else 1.0


@kernel
def factor_by_roots(loop: Loop, below: float, above: float, sine: float, cosine: float) -> float:
    """Return K (P for a rotation) from the roots in x = |g1| = G sin²v, for A = 2C.

    P = ``leading`` · x^−``mu`` · Π. The kind of ``ends`` is 0 for a rotation, 1 where both ends are one root
    of x, its value from below, 2 the same from above, 3 where they are two roots and x grows with v, 4 where
    it falls. ``roots`` has the ``reals`` that are no ends, a flag −1 with lo − r or 1 with r − hi, then of
    complex ``pairs`` the real and the imaginary part.
    """
    size = loop.g
    x, equator = size * sine * sine, size * cosine * cosine
    kind = loop.ends
    up, down = x, equator
    value = loop.leading
    # sin(v − v₋) and sin(v₊ − v); far from the end, where they are small again, by the addition theorem.
    to_lower, to_upper = math.sin(below), math.sin(above)
    if below > 1.5 and above < below:
        to_lower = abs(sine * loop.c_lower - cosine * loop.s_lower)
    elif above > 1.5:
        to_upper = abs(loop.s_upper * cosine - loop.c_upper * sine)
    if kind == 1 or kind == 2:
        value *= size * ratio(to_lower, below) * ratio(to_upper, above)
        if kind == 1:
            up = size * to_lower * to_upper
        else:
            down = size * to_lower * to_upper
    elif kind >= 3:
        first = sine * loop.c_lower + cosine * loop.s_lower
        second = sine * loop.c_upper + cosine * loop.s_upper
        value *= abs(size * size * ratio(to_lower, below) * ratio(to_upper, above) * first * second)
        up, down = abs(size * to_lower * first), abs(size * to_upper * second)
        if kind == 4:
            up, down = down, up
    value *= x**-loop.mu
    for k in range(loop.reals):
        value *= (up if loop.roots[k, 0] < 0.0 else down) + loop.roots[k, 1]
    for k in range(loop.reals, loop.reals + loop.pairs):
        away = x - loop.roots[k, 0]
        value *= away * away + loop.roots[k, 1] * loop.roots[k, 1]
    return float(value)


@inlined
def rates(formula: Formula, loop: Loop, places: Places, count: int) -> None:
    """Fill in dt/du at places that are there as :func:`place` has them."""
    if loop.by_roots:
        loop_points(loop, places, count)
        for k in range(count):
            places.rate[k] = factor_by_roots(
                loop, places.below[k], places.above[k], places.sine[k], places.cosine[k]
            )
    else:
        radicands(formula, loop, places, count)
        for k in range(count):
            places.rate[k] = places.radicand[k]
        if not loop.rotates:
            for k in range(count):
                places.rate[k] /= places.below[k] * places.above[k]
    numerator = math.pi * loop.z
    for k in range(count):
        K = places.rate[k]
        rate = numerator / (places.c[k] * math.sqrt(K))
        places.rate[k] = rate if K > 0.0 else math.nan


@inlined
def _number(constant: Constant) -> Degrees:
    # Its value instead of its degrees, which are 0: it may be an exponent.
    return double_of(constant), 0.0, NUMBER


@inlined
def _of(x: Degrees) -> Degrees:
    return (0.0, 0.0, NUMBER) if x[2] == NUMBER else x


@inlined
def _within(low: float, high: float, kind: float) -> Degrees:
    return low, high, kind if low >= -HIGHEST_DEGREE and high <= HIGHEST_DEGREE else OTHER


@kernel
def _sum(x: Degrees, y: Degrees) -> Degrees:
    x, y = _of(x), _of(y)
    kind = max(x[2], y[2])
    return min(x[0], y[0]), max(x[1], y[1]), kind if kind == NUMBER else max(kind, SUM)


@kernel
def _product(x: Degrees, y: Degrees) -> Degrees:
    x, y = _of(x), _of(y)
    return _within(x[0] + y[0], x[1] + y[1], max(x[2], y[2]))


@kernel
def _quotient(x: Degrees, y: Degrees) -> Degrees:
    x, y = _of(x), _of(y)
    return _within(x[0] - y[1], x[1] - y[0], max(x[2], y[2]) if y[2] <= PRODUCT else OTHER)


@inlined
def _opposite(x: Degrees) -> Degrees:
    return x


@kernel
def _power(x: Degrees, exponent: Degrees) -> Degrees:
    (low, high, kind), by = _of(x), exponent[0]
    is_known = kind <= PRODUCT or (by >= 0.0 and by == math.floor(by))
    return _within(min(by * low, by * high), max(by * low, by * high), kind if is_known else OTHER)


@inlined
def _function(operation: int, x: Degrees) -> Degrees:
    is_known = x[2] == NUMBER or (operation == ABS and x[2] == PRODUCT)
    return x[0], x[1], x[2] if is_known else OTHER


run_degrees = interpreter_of(
    CompiledArithmetic(
        get_triple, put_triple, _number, _sum, _product, _quotient, _opposite, _power, _function
    ),
    __name__,
    "run_degrees",
)


@kernel
def is_of_low_degree(formula: Formula) -> bool:
    """Say whether V is a sum of products of real powers of g1 and g3 and whole powers of g2, of low degree.

    A feature of such a V is about as wide as the sphere over its degree, and leaves its trace in the last
    coefficients of a series. A quotient by a sum, a function or a high power may make one of any width, but
    those of numbers are numbers.
    """
    registers = new_registers(formula.code, 3, 1)
    for k in range(3):
        put_triple(registers, k, 0, (1.0, 1.0, SUM if k == 1 else PRODUCT))
    run_degrees(formula.code, formula.constants, formula.lows, registers, 1)
    return bool(registers[2, formula.result, 0] < OTHER)
