r"""Windows of a planar motion in doubles: zeros of P along y with v = 2 arctan e^y.

There sin v = 1/cosh y and cos v = −tanh y: both poles are at infinity, where P is a
power law, a straight line of log|P|, and the equator is at 0. Whatever doubles leave
in doubt (zeros about to merge, a P that is not resolved, undefined values) is not
decided here.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral.compiled import kernel
from workers.solvers.spectral.curve import BOUND, COSINE, SINE, VALUE, radicands, radicands_with_bounds

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MAX_ZEROS = 16
BLOCKED, PASSABLE, OPEN = 0, 1, 2
"""At a pole: P < 0; P > 0 with a finite limit; P > 0 and it diverges or dies out."""


def scan_places() -> FloatArray:
    """Return the y at which P is looked at, with sin v and cos v there: symmetric, with 0 among them."""
    positive = np.concatenate([np.arange(1, 21) * 0.2, 4.0 + np.arange(1, 13) * 0.5, [11.0, 12.0, 13.0]])
    places = np.concatenate([-positive[::-1], [0.0], positive])
    # One by one: digits of whole arrays may differ from those that the zeros are found with.
    sines = [1.0 / math.cosh(y) for y in places.tolist()]
    cosines = [-math.tanh(y) for y in places.tolist()]
    return np.array([places, sines, cosines])


@kernel
def radicand_at(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    half: float,
    y: float,
    desk: FloatArray,
    work: FloatArray,
) -> float:
    """Return P at y on the half of the loop with this sign of g3."""
    desk[SINE, 0], desk[COSINE, 0] = half / math.cosh(y), -math.tanh(y)
    radicands(code, result, constants, loop, desk, 1, work)
    return float(desk[VALUE, 0])


@kernel
def _zero(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    half: float,
    a: float,
    b: float,
    fa: float,
    fb: float,
    desk: FloatArray,
    work: FloatArray,
) -> float:
    """Return the zero between a and b, where the signs differ, by Anderson and Björck's rule."""
    for step in range(200):
        x = 0.5 * (a + b) if step % 4 == 3 else (a * fb - b * fa) / (fb - fa)
        if not (min(a, b) < x < max(a, b)):
            x = 0.5 * (a + b)
        if x in (a, b):
            break
        fx = radicand_at(code, result, constants, loop, half, x, desk, work)
        if fx == 0.0:
            return x
        if (fx > 0.0) == (fb > 0.0):
            weight = 1.0 - fx / fb
            fa *= weight if weight > 0.0 else 0.5
        else:
            a, fa = b, fb
        last = b
        b, fb = x, fx
        if abs(last - x) <= 2e-16 * abs(x) or abs(b - a) <= 2e-16 * abs(b):
            break
    return b


@kernel
def _dips_below_zero(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    half: float,
    a: float,
    b: float,
    sign: float,
    desk: FloatArray,
    work: FloatArray,
) -> bool:
    """Say whether sign · P may vanish between a and b, by golden section for its minimum."""
    ratio = 0.6180339887498949
    x, y = b - ratio * (b - a), a + ratio * (b - a)
    fx = sign * radicand_at(code, result, constants, loop, half, x, desk, work)
    fy = sign * radicand_at(code, result, constants, loop, half, y, desk, work)
    for _ in range(36):
        if not (fx > 0.0 and fy > 0.0):
            return True
        if fx < fy:
            b, y, fy = y, x, fx
            x = b - ratio * (b - a)
            fx = sign * radicand_at(code, result, constants, loop, half, x, desk, work)
        else:
            a, x, fx = x, y, fy
            y = a + ratio * (b - a)
            fy = sign * radicand_at(code, result, constants, loop, half, y, desk, work)
    desk[SINE, 0], desk[COSINE, 0] = half / math.cosh(x), -math.tanh(x)
    radicands_with_bounds(code, result, constants, loop, desk, 1, work)
    return not abs(desk[VALUE, 0]) > desk[BOUND, 0]


@kernel
def _pole(values: FloatArray, places: FloatArray, towards: int) -> int:
    """Return what P does at the pole behind the first (−1) or last places; −1 if it is unclear."""
    n = len(places)
    a, b, c = (0, 1, 2) if towards < 0 else (n - 1, n - 2, n - 3)
    if not (values[a] > 0.0) == (values[b] > 0.0) == (values[c] > 0.0):
        return -1
    outer = math.log(values[a] / values[b]) / abs(places[a] - places[b])
    inner = math.log(values[b] / values[c]) / abs(places[b] - places[c])
    if not abs(outer - inner) < 1e-2:
        return -1
    if values[a] < 0.0:
        return BLOCKED
    return PASSABLE if abs(outer) < 1e-4 else OPEN


@kernel
def scan_half(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    half: float,
    table: FloatArray,
    zeros: FloatArray,
    desk: FloatArray,
    work: FloatArray,
) -> tuple[int, int, int, int]:
    """Return the number of zeros (−1: undecided), P's sign before the first, and its north and south pole.

    ``table`` is that of :func:`scan_places`. The zeros y go into ``zeros``, growing.
    """
    places = table[0]
    n = len(places)
    for k in range(n):
        desk[SINE, k], desk[COSINE, k] = half * table[1, k], table[2, k]
    radicands(code, result, constants, loop, desk, n, work)
    values = desk[VALUE, :n].copy()
    for k in range(n):
        if not (abs(values[k]) > 0.0 and abs(values[k]) < math.inf):
            return -1, 0, 0, 0
    north, south = _pole(values, places, -1), _pole(values, places, 1)
    if north < 0 or south < 0:
        return -1, 0, 0, 0
    count = 0
    for k in range(n - 1):
        a, b = values[k], values[k + 1]
        if (a > 0.0) != (b > 0.0):
            if count == MAX_ZEROS:
                return -1, 0, 0, 0
            zeros[count] = _zero(
                code, result, constants, loop, half, places[k], places[k + 1], a, b, desk, work
            )
            count += 1
            continue
        sign = 1.0 if a > 0.0 else -1.0
        falls = k > 0 and sign * values[k - 1] > sign * a
        rises = k + 2 < n and sign * values[k + 2] > sign * b
        if falls and rises:
            step = places[k + 1] - places[k]
            left = sign * a - sign * (values[k - 1] - a) / (places[k] - places[k - 1]) * step
            right = sign * b - sign * (values[k + 2] - b) / (places[k + 2] - places[k + 1]) * step
            if min(left, right) <= 0.0 and _dips_below_zero(
                code, result, constants, loop, half, places[k], places[k + 1], sign, desk, work
            ):
                return -1, 0, 0, 0
    return count, 1 if values[0] > 0.0 else -1, north, south
