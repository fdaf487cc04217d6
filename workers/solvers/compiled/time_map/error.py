"""Bounds the error of a time map: the rounding of dt/du, and what the series of dt/du leave out."""

import math

from workers.solvers.compiled.desk import POINTS, Places
from workers.solvers.compiled.evaluation.curve import place, radicands_with_bounds
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula, Loop, Panel, Records
from workers.solvers.compiled.time_map.series import at, distance, larger, last_coefficients

EPSILON = 2.0**-52
TAIL = 1.0
"""What a series that is not proved leaves out of t, in its last coefficients: they may be small by chance,
and what follows them with fractional powers falls off slowly."""
EACH = 4
"""Of a panel, where the rounding is looked at: three for t, the last for dt/du."""


@kernel
def _place_of(panel: Panel, k: int) -> float:
    share = 0.37 if k == EACH - 1 else 0.09 + 0.4 * k
    return float(panel.first + (panel.last - panel.first) * share)


@kernel
def _noise_by_roots(loop: Loop, places: Places, count: int) -> None:
    """Fill in the bound of the relative rounding of dt/du where P is known by its roots."""
    size = loop.g
    for n in range(count):
        worst = 0.0
        for k in range(loop.reals, loop.reals + loop.pairs):
            real, imaginary = loop.roots[k, 0], loop.roots[k, 1]
            away = size * places.sine[n] * places.sine[n] - real
            worst = larger(worst, 2.0 * abs(away) * size / (away * away + imaginary * imaginary))
        zeros = float(loop.reals + loop.pairs)
        places.noise[n] = (8.0 + zeros + worst) * 0.5 * EPSILON


@inlined
def _noise(
    formula: Formula,
    loop: Loop,
    at_ends: tuple[float, float],
    places: Places,
    count: int,
) -> None:
    """Fill in the bound of the relative rounding of dt/du at places."""
    if loop.by_roots:
        _noise_by_roots(loop, places, count)
        return
    radicands_with_bounds(formula, loop, places, count)
    for k in range(count):
        below, above, bound = places.below[k], places.above[k], places.bound[k]
        if not loop.rotates and k % EACH < EACH - 1:
            bound += (at_ends[0] * above + at_ends[1] * below) / (below + above)
        places.noise[k] = 0.5 * bound / abs(places.radicand[k]) + 4.0 * EPSILON


@inlined
def _bounds_at_ends(formula: Formula, loop: Loop, places: Places) -> tuple[float, float]:
    """Return the bounds of the rounding of P at both ends, which are zeros of it."""
    if loop.by_roots or loop.rotates:
        return 0.0, 0.0
    places.sine[0], places.cosine[0] = loop.s_lower, loop.c_lower
    places.sine[1], places.cosine[1] = loop.s_upper, loop.c_upper
    radicands_with_bounds(formula, loop, places, 2)
    return places.bound[0], places.bound[1]


@kernel
def map_error(
    formula: Formula,
    loop: Loop,
    panels: Records,
    number: int,
    places: Places,
) -> tuple[float, float]:
    """Return the bound of the error of the map's length, and the largest relative error of dt/du."""
    at_ends = _bounds_at_ends(formula, loop, places)
    error, worst = 0.0, 0.0
    together = POINTS // EACH
    for begin in range(0, number, together):
        end = min(number, begin + together)
        for n in range(begin, end):
            for k in range(EACH):
                row = EACH * (n - begin) + k
                (
                    places.below[row],
                    places.above[row],
                    places.sine[row],
                    places.cosine[row],
                    places.speed[row],
                ) = place(loop, panels[n].anchor, distance(panels[n], _place_of(panels[n], k)))
        _noise(formula, loop, at_ends, places, EACH * (end - begin))
        for n in range(begin, end):
            panel, row = panels[n], EACH * (n - begin)
            rough = 0.0
            for k in range(EACH - 1):
                rough += places.noise[row + k] / 3.0
            if not math.isnan(panel.proved):
                error += (rough + panel.proved) * panel.length
                worst = larger(worst, places.noise[row + EACH - 1] + panel.proved)
                continue
            tail = last_coefficients(panel.slopes)
            # T_k integrates to at most 1/(k − 1) of itself: a factor 4 is kept.
            error += rough * panel.length + TAIL * tail
            _, smallest = at(panel, _place_of(panel, EACH - 1))
            worst = larger(worst, places.noise[row + EACH - 1] + 2.0 * tail / smallest)
    return error, worst
