"""Bounds the error of a time map: the rounding of dt/du, and what the series of dt/du leave out."""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.compiled.evaluation.curve import place, radicands_with_bounds
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import Formula, Loop, Panel, Records
from workers.solvers.compiled.time_map.series import distance, larger, slope_at
from workers.solvers.compiled.workspace import POINTS, Places

FloatArray = NDArray[np.float64]

TIME_ULPS = 1.5
"""Roundings of a time on a panel, in 2^-52 of its length: of the difference, the series, and the step."""
DEPARTURE_FACTOR = 3.0
"""Times the largest departure of a series from the formula at the places of its panel, noise left out."""
TIME_SHARE, LENGTH_SHARE = 1.0 / 6.0, 1.0 / 32.0
"""Errors of a time on a panel, and of the panel's length, where a series is not proved: as shares of the
departure of the series times the length. In the nodes T_k is −T_(32−k), k > 16, and T_16 is 0: integrated,
T_16 departs by 0.067 at most and by 0.008 at the end, others to k = 25 by 0.17 and 0.04, the last ones by
0.8 and 0.7. If coefficients fall by 0.7 at least from one to the next, the sums are 0.15 and 0.02 of the
product, with fractional powers, as k^-3, 0.5 and 0.1: as many are kept, with what is counted of a
departure besides."""
PANEL_PLACES = 4
"""Places of a panel where series are compared and the rounding bounded: three for t, the last for dt/du."""
PLACES_ON_WHOLE = tuple(math.cos(math.pi * j / 16) for j in (13, 8, 3, 10))
PLACES_ON_HALF = tuple(math.cos(math.pi * j / 16) for j in (7, 5, 2, 6))
"""The four places, at which |T_16| is 1: on the whole of −1 ≤ x ≤ 1, and on one half of it."""
REST_NOISE_FACTOR = (PLACES_ON_HALF[0] / math.cos(math.pi * 7.5 / 16)) ** 2
"""Times the rounding at the first place of half a panel: next to a rest it grows like x^-2, as far as to the
first node. The mean of three such numbers is 1.5 times what the nodes' weights make of x^-2."""


@kernel
def _place_of(panel: Panel, k: int) -> float:
    if panel.last - panel.first == 2.0:
        return PLACES_ON_WHOLE[k]
    return PLACES_ON_HALF[k] if panel.last > 0.0 else -PLACES_ON_HALF[k]


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
def _noise(formula: Formula, loop: Loop, at_ends: tuple[float, float], places: Places, count: int) -> None:
    """Fill in the bound of the relative rounding of dt/du at places."""
    if loop.by_roots:
        _noise_by_roots(loop, places, count)
        return
    radicands_with_bounds(formula, loop, places, count)
    for k in range(count):
        below, above, bound = places.below[k], places.above[k], places.bound[k]
        if not loop.rotates and k % PANEL_PLACES < PANEL_PLACES - 1:
            bound += (at_ends[0] * above + at_ends[1] * below) / (below + above)
        places.noise[k] = 0.5 * bound / abs(places.radicand[k]) + 4.0 * EPSILON


@inlined
def _bounds_at_ends(formula: Formula, loop: Loop, places: Places) -> tuple[float, float]:
    """Return bounds of P at both ends, zeros of it if these were no doubles; with roundings.

    Next to a pole, where v is a multiple of π, an end is off by more than what P is rounded by there.
    """
    if loop.by_roots or loop.rotates:
        return 0.0, 0.0
    places.sine[0], places.cosine[0] = loop.s_lower, loop.c_lower
    places.sine[1], places.cosine[1] = loop.s_upper, loop.c_upper
    radicands_with_bounds(formula, loop, places, 2)
    return places.bound[0] + abs(places.radicand[0]), places.bound[1] + abs(places.radicand[1])


@inlined
def _departure(loop: Loop, panel: Panel, places: Places, row: int) -> float:
    """Return what is to be counted of the departure of a series from dt/du, against that."""
    half, numerator = 0.5 * (panel.high - panel.low), math.pi * loop.z
    off = 0.0
    for k in range(row, row + PANEL_PLACES):
        K = places.radicand[k]
        if not loop.rotates:
            K /= places.below[k] * places.above[k]
        rate = numerator / (places.c[k] * math.sqrt(K)) if K > 0.0 else math.nan
        seen = abs(slope_at(panel, _place_of(panel, k - row)) / (half * rate) - 1.0)
        # What noise hides counts once, what is beyond it several times.
        noise = places.noise[k]
        off = larger(
            off, min(seen, noise) + DEPARTURE_FACTOR * max(seen - noise, 0.0) if seen == seen else math.nan
        )
    return off


@kernel
def map_error(
    formula: Formula, loop: Loop, panels: Records, number: int, places: Places, inside: FloatArray
) -> tuple[float, float]:
    """Return the bound of the error of the map's length, and the largest relative error of dt/du.

    Fill in what times ``inside`` each panel are off at most since its start.
    """
    at_ends = _bounds_at_ends(formula, loop, places)
    error, worst = 0.0, 0.0
    together = POINTS // PANEL_PLACES
    for begin in range(0, number, together):
        end = min(number, begin + together)
        for n in range(begin, end):
            for k in range(PANEL_PLACES):
                row = PANEL_PLACES * (n - begin) + k
                (
                    places.below[row],
                    places.above[row],
                    places.sine[row],
                    places.cosine[row],
                    places.speed[row],
                ) = place(loop, panels[n].anchor, distance(panels[n], _place_of(panels[n], k)))
        _noise(formula, loop, at_ends, places, PANEL_PLACES * (end - begin))
        for n in range(begin, end):
            panel, row = panels[n], PANEL_PLACES * (n - begin)
            rough = (REST_NOISE_FACTOR if panel.last - panel.first < 2.0 else 1.0) * places.noise[row] / 3.0
            for k in range(1, PANEL_PLACES - 1):
                rough += places.noise[row + k] / 3.0
            if not math.isnan(panel.proved):
                inside[n] = (rough + panel.proved) * panel.length
                error += inside[n]
                worst = larger(worst, places.noise[row + PANEL_PLACES - 1] + panel.proved)
                continue
            off = _departure(loop, panel, places, row)
            inside[n] = (rough + TIME_SHARE * off) * panel.length
            error += (rough + LENGTH_SHARE * off) * panel.length
            worst = larger(worst, places.noise[row + PANEL_PLACES - 1] + off)
    return error, worst


@kernel
def add_roundings(panels: Records, number: int, astray: FloatArray) -> None:
    """Add to the errors of times on each panel what rounding does to a time there, and to its phase."""
    for n in range(number):
        panel = panels[n]
        # Of a phase, counted from the anchor, against the panel.
        far = max(abs(panel.low), abs(panel.high)) / (panel.high - panel.low)
        astray[n] += (TIME_ULPS + far) * EPSILON * panel.length
