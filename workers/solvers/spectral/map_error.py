"""What the rounding of dt/du, and what its series leave out, do to a time map, compiled."""

import numpy as np
from numpy.typing import NDArray

from workers.solvers.spectral import curve
from workers.solvers.spectral.compiled import inlined, kernel
from workers.solvers.spectral.curve import (
    ABOVE,
    BELOW,
    BOUND,
    COSINE,
    SINE,
    SPEED,
    VALUE,
    place,
    radicands_with_bounds,
)
from workers.solvers.spectral.interpreter import POINTS
from workers.solvers.spectral.time_map import ANCHOR, FIRST, LAST, LENGTH, NODES, SLOPES, at, distance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

EPSILON = 2.0**-52
TAIL = 1.0
"""What the series leaves out of t, in its last coefficients: they may be small by chance, and what
follows them with fractional powers falls off slowly."""
PLACES = 4
"""Of a panel, where the rounding is looked at: three for t, the last for dt/du."""


@inlined
def larger(one: float, other: float) -> float:
    """Return the larger of two numbers, NaN if either is: ``max`` drops it by its place."""
    return other if other > one or np.isnan(other) else one


@kernel
def _place_of(panel: FloatArray, k: int) -> float:
    share = 0.37 if k == PLACES - 1 else 0.09 + 0.4 * k
    return float(panel[FIRST] + (panel[LAST] - panel[FIRST]) * share)


@kernel
def _noise_by_roots(loop: FloatArray, desk: FloatArray, count: int) -> None:
    """Fill in the bound of the relative rounding of dt/du where P is known by its roots."""
    size = loop[curve.G]
    reals, pairs = int(loop[curve.ROOTS_MODE + 4]), int(loop[curve.ROOTS_MODE + 5])
    for n in range(count):
        worst, k = 0.0, curve.ROOTS_MODE + 6 + 2 * reals
        for _ in range(pairs):
            away = size * desk[SINE, n] * desk[SINE, n] - loop[k]
            worst = larger(worst, 2.0 * abs(away) * size / (away * away + loop[k + 1] * loop[k + 1]))
            k += 2
        zeros = loop[curve.ROOTS_MODE + 4] + loop[curve.ROOTS_MODE + 5]
        desk[BOUND, n] = (8.0 + zeros + worst) * 0.5 * EPSILON


@inlined
def _noise(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    at_ends: tuple[float, float],
    desk: FloatArray,
    count: int,
    work: FloatArray,
) -> None:
    """Fill in the bound of the relative rounding of dt/du at places on the desk."""
    if loop[curve.ROOTS_MODE] != 0.0:
        _noise_by_roots(loop, desk, count)
        return
    radicands_with_bounds(code, result, constants, loop, desk, count, work)
    for k in range(count):
        below, above, bound = desk[BELOW, k], desk[ABOVE, k], desk[BOUND, k]
        if loop[curve.ROTATES] == 0.0 and k % PLACES < PLACES - 1:
            bound += (at_ends[0] * above + at_ends[1] * below) / (below + above)
        desk[BOUND, k] = 0.5 * bound / abs(desk[VALUE, k]) + 4.0 * EPSILON


@inlined
def _bounds_at_ends(
    code: IntArray, result: int, constants: FloatArray, loop: FloatArray, desk: FloatArray, work: FloatArray
) -> tuple[float, float]:
    """Return the bounds of the rounding of P at both ends, which are zeros of it."""
    if loop[curve.ROOTS_MODE] != 0.0 or loop[curve.ROTATES] != 0.0:
        return 0.0, 0.0
    desk[SINE, 0], desk[COSINE, 0] = loop[curve.S_LOWER], loop[curve.C_LOWER]
    desk[SINE, 1], desk[COSINE, 1] = loop[curve.S_UPPER], loop[curve.C_UPPER]
    radicands_with_bounds(code, result, constants, loop, desk, 2, work)
    return desk[BOUND, 0], desk[BOUND, 1]


@kernel
def map_error(
    code: IntArray,
    result: int,
    constants: FloatArray,
    loop: FloatArray,
    panels: FloatArray,
    number: int,
    desk: FloatArray,
    work: FloatArray,
) -> tuple[float, float]:
    """Return the bound of the error of the map's length, and the largest relative error of dt/du."""
    at_ends = _bounds_at_ends(code, result, constants, loop, desk, work)
    error, worst = 0.0, 0.0
    together = POINTS // PLACES
    for begin in range(0, number, together):
        end = min(number, begin + together)
        for n in range(begin, end):
            for k in range(PLACES):
                row = PLACES * (n - begin) + k
                desk[BELOW, row], desk[ABOVE, row], desk[SINE, row], desk[COSINE, row], desk[SPEED, row] = (
                    place(loop, int(panels[n, ANCHOR]), distance(panels[n], _place_of(panels[n], k)))
                )
        _noise(code, result, constants, loop, at_ends, desk, PLACES * (end - begin), work)
        for n in range(begin, end):
            panel, row = panels[n], PLACES * (n - begin)
            rough = 0.0
            for k in range(PLACES - 1):
                rough += desk[BOUND, row + k] / 3.0
            tail = larger(abs(panel[SLOPES + NODES - 1]), abs(panel[SLOPES + NODES - 2]))
            # T_k integrates to at most 1/(k − 1) of itself: a factor 4 is kept.
            error += rough * panel[LENGTH] + TAIL * tail
            _, smallest = at(panel, _place_of(panel, PLACES - 1))
            worst = larger(worst, desk[BOUND, row + PLACES - 1] + 2.0 * tail / smallest)
    return error, worst
