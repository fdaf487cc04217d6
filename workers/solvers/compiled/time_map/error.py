r"""Errors of a time map: the rounding of dt/du, and what series of dt/du leave out, proved on whole panels.

Panels on which that fails are halved. With f = dt/du and Q = 1/f², let p and q be the polynomials of degree
NODES − 1 that have the values of f and Q at the nodes. Then p² q − 1 vanishes at all of them: it is T_16 R,
and R, of degree 3 · 15 − 16 = 29, is known by its values at 32 other nodes, where |T_16| = √½. Q is c² K/(π
Z)², with no root and no division by what may be small: where |Q| ≤ M in the ellipse ρ of the panel,

.. math:: |Q - q| \le 4 M ρ^{-15}/(ρ - 1), \qquad |p/f - 1| \le \sqrt{1 + η} - 1,
          \quad η = \sum |R_k| + \max p² \max|Q - q|.

The ellipse lies in a disc of radius (ρ + 1/ρ)/2 about the middle of the panel, on which the formula is
bounded (:mod:`compiled.discs.rows`). Between rest points v = m − h cos θ, θ = πu, and K = P/(h² sin² θ):
by the maximum principle |h² sin² θ| counts on the circle only, also where it vanishes inside.
"""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.solution.dense_output import EPSILON
from workers.solvers.compiled.discs.rows import SAME_POWER, derivatives_on_discs, put_disc, put_squares
from workers.solvers.compiled.evaluation.curve import is_of_low_degree, place, radicands_with_bounds
from workers.solvers.compiled.kernels import inlined, kernel
from workers.solvers.compiled.records import MAX_PANELS, NODES, Formula, Loop, Panel, Records
from workers.solvers.compiled.time_map.panels import build_panels, distance, larger, slope_at
from workers.solvers.compiled.workspace import LANES, POINTS, DiscWorkspace, Places, Workspace

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
DEGREE = 15
ELLIPSES = np.array([4.5, 6.0, 8.0, 11.0])
PANELS_TOGETHER = LANES // len(ELLIPSES)
"""Number of panels that are bounded together."""
ROUNDING_FACTOR = 1.0 + 2.0**-40
"""Factor that covers the roundings of a few bounds that are multiplied."""
LARGEST_ETA = 0.25
"""The largest η of which the theorem is used."""
SERIES_ROUNDING = 2.0**-51
"""Relative, of a series at a place. Coefficients below it are rounding, which is counted once."""
_HALF = 16
_NODES = np.sin(np.pi * (2 * np.arange(_HALF) + 1) / 64)
"""The positive zeros of T_32, growing."""
_T = np.polynomial.chebyshev.chebvander(_NODES, 31)
EVEN = np.ascontiguousarray(_T[:, 0:16:2].T)
ODD = np.ascontiguousarray(_T[:, 1:16:2].T)
"""T_k at the nodes, for even and for odd k < 16: shape (8, 16)."""
_TO_R = _T / (8.0 * _T[:, 16:17])
TO_EVEN = np.ascontiguousarray(_TO_R[:, 0::2])
TO_ODD = np.ascontiguousarray(_TO_R[:, 1::2])
"""Matrices from even and odd parts of T_16 R at the nodes to coefficients of R: shape (nodes 16, 16)."""
ATTEMPTS = 40
"""To cut panels on which the bounds do not prove enough."""
TIME_SLACK, TIME_SLACK_BY_ROOTS, RATE_SLACK = 2.0, 0.25, 50.0
"""Errors that bounds may leave, in tolerances: of a time on a panel, the second by roots, and of dt/du."""


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


_TO_R[:, 0] *= 0.5


@kernel
def seen_between(p: FloatArray, q: FloatArray) -> float:
    """Return Σ|R_k| of two series of degree DEGREE, and what rounding may do to it."""
    a, b, c, d = np.zeros(_HALF), np.zeros(_HALF), np.zeros(_HALF), np.zeros(_HALF)
    for k in range(8):
        s, t, u, w = p[2 * k], p[2 * k + 1], q[2 * k], q[2 * k + 1]
        for i in range(_HALF):
            a[i] += EVEN[k, i] * s
            b[i] += ODD[k, i] * t
            c[i] += EVEN[k, i] * u
            d[i] += ODD[k, i] * w
    for i in range(_HALF):
        right, left = a[i] + b[i], a[i] - b[i]
        right, left = right * right * (c[i] + d[i]) - 1.0, left * left * (c[i] - d[i]) - 1.0
        a[i], b[i] = 0.5 * (right + left), 0.5 * (right - left)
        c[i], d[i] = 0.0, 0.0
    for i in range(_HALF):
        s, t = a[i], b[i]
        for k in range(_HALF):
            c[k] += TO_EVEN[i, k] * s
            d[k] += TO_ODD[i, k] * t
    total = 0.0
    for k in range(_HALF):
        total += max(abs(c[k]) - SERIES_ROUNDING, 0.0) + max(abs(d[k]) - SERIES_ROUNDING, 0.0)
    return total + 4.0 * SERIES_ROUNDING


@inlined
def _least_sine(theta: float, radius: float) -> float:
    """Return a lower bound of |sin| on the circle around a real centre, 0 if it is not known."""
    least = math.inf
    for k in range(-1, 3):
        # |sin δ| ≥ sin |δ| for |δ| ≤ π/2, and more further off.
        least = min(least, abs(abs(theta - k * math.pi) - radius))
    return math.sin(min(least, 0.5 * math.pi)) if radius < 3.0 else 0.0


@kernel
def _size_by_roots(loop: Loop, square: float, square_r: float) -> float:
    """Return a bound of |P| from its roots in x = G sin² v; see :func:`.factor_by_roots`."""
    size = loop.g
    x, wide = size * square, size * square_r
    kind, mu = loop.ends, loop.mu
    first, second = size * loop.s_lower**2, size * loop.s_upper**2
    low, high = (min(first, second), max(first, second)) if kind else (0.0, size)
    if kind == 1:
        high = size
    elif kind == 2:
        low = 0.0
    value = loop.leading
    if kind == 1 or kind >= 3:
        value *= abs(x - low) + wide
    if kind >= 2:
        value *= abs(x - high) + wide
    if mu > 0.0:
        value *= (x - wide) ** -mu if x > wide else math.nan
    elif mu < 0.0:
        value *= (x + wide) ** -mu
    for k in range(loop.reals):
        away = loop.roots[k, 1]
        root = low - away if loop.roots[k, 0] < 0.0 else high + away
        value *= abs(x - root) + wide
    for k in range(loop.reals, loop.reals + loop.pairs):
        away = abs(x - loop.roots[k, 0]) + wide
        value *= away * away + loop.roots[k, 1] * loop.roots[k, 1]
    return float(value)


@kernel
def bound_left_out(
    formula: Formula, loop: Loop, middles: FloatArray, count: int, discs: DiscWorkspace, left_out: FloatArray
) -> None:
    """Fill in a bound of |Q − q| on panels given by rows (anchor, w in the middle, half width); inf: none."""
    number = len(ELLIPSES)
    rotates, by_roots = loop.rotates, loop.by_roots
    least = np.ones(LANES)
    for n in range(count):
        anchor, w = int(middles[n, 0]), middles[n, 1]
        _, _, sine, cosine, _ = place(loop, anchor, w)
        theta = math.pi * (0.5 * anchor + w)
        for k in range(number):
            rho = ELLIPSES[k]
            radius = 0.5 * (rho + 1.0 / rho) * math.pi * middles[n, 2] * ROUNDING_FACTOR
            lane = number * n + k
            if not rotates:
                h = loop.half_width
                sine_least = h * _least_sine(theta, radius)
                least[lane] = sine_least * sine_least
                even = 2.0 * math.sinh(0.5 * radius) ** 2
                radius = (
                    h
                    * (abs(math.cos(theta)) * even + abs(math.sin(theta)) * math.sinh(radius))
                    * ROUNDING_FACTOR
                )
            put_disc(discs, lane, sine, cosine, radius)
    lanes = number * count
    row = 0
    leading = 0.0
    if by_roots:
        put_squares(loop, discs, lanes)
    else:
        row = derivatives_on_discs(formula, loop, discs, lanes)
        leading = formula.discs.powers[row] + 1.0 - loop.alpha
    unit = 1.0 / (math.pi * loop.z) ** 2
    for n in range(count):
        best = math.inf
        for k in range(number):
            m = number * n + k
            if by_roots:
                s = discs.s_centre[m]
                size = _size_by_roots(loop, s * s, discs.t_radius[m])
            else:
                size = (abs(formula.discs.centres[row, m]) + formula.discs.radii[row, m]) * _scale(
                    discs.s_centre[m], discs.s_radius[m], leading
                )
                size *= loop.factor * loop.z / loop.g
            size *= (discs.square[m] + discs.square_radius[m]) * unit / least[m] * ROUNDING_FACTOR
            rho = ELLIPSES[k]
            bound = 4.0 * size * rho**-DEGREE / (rho - 1.0)
            if bound < best:
                best = bound
        left_out[n] = best


@inlined
def _scale(s: float, radius: float, exponent: float) -> float:
    """Return a bound of |s^exponent| on a disc, NaN where it is not analytic."""
    if abs(exponent) <= SAME_POWER:
        return 1.0
    if exponent > 0.0:
        return (s + radius) ** exponent if radius < s or exponent == math.floor(exponent) else math.nan
    return (s - radius) ** exponent if radius < s else math.nan


@kernel
def build_time_map(
    formula: Formula, loop: Loop, tolerance: float, panels: Records, workspace: Workspace
) -> tuple[int, float]:
    """Fill the table of panels; return their number and the length of time.

    For a libration they cover 0 ≤ u ≤ 1, half a period. The number is 0 if dt/du is not resolved, or if
    that is not proved on the whole of each panel. For a V of low degree the last coefficients of each series
    decide, which is no proof, and what they leave out is seen later: bounds would cost several times the map.
    """
    proves = loop.by_roots or not is_of_low_degree(formula)
    squares = np.empty((MAX_PANELS if proves else 0, NODES))
    forced = 0
    kept = panels[:0]
    for _ in range(ATTEMPTS):
        number, length = build_panels(formula, loop, tolerance, panels, workspace, forced, kept, squares)
        if number == 0 or not proves:
            return number, length
        before = forced
        forced = _prove(formula, loop, tolerance, length, panels, number, squares, workspace, forced)
        if forced == before:
            return number, length
        if forced < 0:
            break
        kept = panels[:number].copy()
    return 0, math.nan


@kernel
def _prove(
    formula: Formula,
    loop: Loop,
    tolerance: float,
    length: float,
    panels: Records,
    number: int,
    squares: FloatArray,
    workspace: Workspace,
    forced: int,
) -> int:
    """Fill in PROVED; put panels on which it is too large among the coarse ones; return how many there are.

    The number is −1 if there are too many.
    """
    middles, left_out = np.empty((PANELS_TOGETHER, 3)), np.empty(PANELS_TOGETHER)
    at_once = np.empty(PANELS_TOGETHER, dtype=np.int64)
    here = 0
    for n in range(number):
        panel = panels[n]
        if math.isnan(panel.proved):
            middles[here, 0], middles[here, 1] = panel.anchor, 0.5 * (panel.low + panel.high)
            middles[here, 2] = 0.5 * (panel.high - panel.low)
            at_once[here] = n
            here += 1
        if here < PANELS_TOGETHER and n < number - 1:
            continue
        bound_left_out(formula, loop, middles, here, workspace.discs, left_out)
        for k in range(here):
            panel = panels[at_once[k]]
            unseen, seen = _prove_one(panel, middles[k, 2], left_out[k], squares[at_once[k]])
            slack = TIME_SLACK_BY_ROOTS if loop.by_roots else TIME_SLACK
            is_good = unseen * panel.length <= slack * tolerance * length and unseen <= RATE_SLACK * tolerance
            if not ((is_good or unseen <= seen) and seen + unseen < LARGEST_ETA):
                if forced == MAX_PANELS:
                    return -1
                cut = workspace.coarse[forced]
                cut.anchor, cut.low, cut.high = panel.anchor, panel.low, panel.high
                forced += 1
        here = 0
    return forced


@kernel
def _prove_one(panel: Panel, half: float, left_out: float, squares: FloatArray) -> tuple[float, float]:
    """Fill in PROVED; return what the bounds leave open, and what is seen between the nodes."""
    rates_here = panel.slopes / half
    largest = 0.0
    for k in range(NODES):
        largest += abs(rates_here[k])
    seen, unseen = seen_between(rates_here, squares), largest * largest * left_out
    eta = seen + unseen
    # (1 − η)^(−1/2) − 1 ≤ η/2 (1 + η) up to η = 1/4.
    panel.proved = 0.5 * eta * (1.0 + eta) if eta < LARGEST_ETA else math.inf
    return unseen, seen
