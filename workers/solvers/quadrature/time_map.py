"""Time as a function of the phase: t(θ) = ∫ (dt/dθ) dθ, and back.

The phase is counted in half turns, u = θ/π: a turn is exactly 0 ≤ u ≤ 2 in
doubles, and the period is not off by the rounding of π.

dt/dθ is resolved by Chebyshev series on panels, halved where the series does not converge or
what it leaves out is not proved to be small (:mod:`.panel`): near a separatrix and near a pole that
is passed without smoothness panels shrink geometrically, elsewhere a handful serves. Lengths of
the panels are summed in balls, so the period has more digits than a double.

What is a theorem: every panel has a bound of its error, from the bounds of :mod:`.squared_speed` on an
ellipse, or, where V is not analytic (a jump, a pole that is passed without smoothness), from an
enclosure of the rate on the whole of a panel that is so short that this suffices. At kinks panels end
(:mod:`.squared_speed`), and one as short as the roundings of u has each of them in it.

What is not: without a formula of V (the family of integrals), or without bounds, panels are judged by
the decay of their series and by half of their nodes. A panel at a place of which nothing is enclosed
is halved down to MIN_PANEL_WIDTH; then its whole length is charged as its error, and it is counted in
the evidence.

The phase and the time map together tell the six variables as a function of time.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import (
    Period,
    chebyshev_coefficients,
    chebyshev_points,
    phase_error,
    split_time,
)
from workers.solvers.assembly.dense import (
    BALL_CHECKED_POINTS,
    UNSEEN_DEPARTURE_FACTOR,
    VARIABLE_RELATIVE_ROUNDING,
    Sampler,
    TimeMap,
    sum_series,
)
from workers.solvers.errors import PrecisionLostError, QuadratureNotConvergedError, WindowBlockedError
from workers.solvers.orbits.orbit import Graded, Orbit, refine_near_poles
from workers.solvers.quadrature.panel import (
    PANEL_DEGREE,
    BranchedSpeed,
    Panel,
    PhaseSpeed,
    find_ellipse,
    make_panel,
)

FloatArray = NDArray[np.float64]
RESOLVED_RELATIVE_TAIL = 4e-16
"""Largest tail of a resolved panel's series against its largest term: the rounding of doubles."""
RESOLVED_RELATIVE_CHANGE = 3e-13
"""Largest relative change of a resolved panel's length when its nodes were last doubled:
demanded on top, since it sees below the rounding of the series."""
ALIASED_SHARE_OF_TAIL = 1.0 / 16.0
"""Share of the series' tail that can reach the length: T_k integrates to 2/(1 − k²), and what
is beyond the degree n is taken for T_(2n−k), both about 1/500 next to n = 32; a factor 30 is kept."""
NEGLIGIBLE_SHARE = 1e-17
"""Panels whose unresolved tail, or proved error, is below this share of the longest are not halved for it."""
MAX_TRUSTED_ERROR = 1e-3
"""Proved error of a length, in parts of it, up to which others are compared with it."""
MIN_PANEL_WIDTH = 1e-15
SHORT_PANEL_WIDTH = 1e-3
"""Panels shorter than this may be near a place where the rate is not analytic: it is enclosed as a whole."""
MAX_PANELS = 4000
KNOWN_BITS, KNOWN = 54, 2.0**-54
"""Least relative accuracy of a variable's ball, or largest radius: either will do."""


def make_time_map(
    rate: Callable[[arb], arb],
    corners: tuple[float, ...],
    *,
    is_even: bool,
    speed: PhaseSpeed | BranchedSpeed | None = None,
) -> TimeMap:
    """Integrate ``rate``, dt/dθ as a function of θ, over one turn.

    Parameters
    ----------
    corners
        u where the rate may not be smooth; panels end there.
    is_even
        The rate at 2π − θ is that at θ: only half a turn is computed.
    speed
        Bounds of its inverse square, from which every panel is proved; without, errors are estimates.

    Raises
    ------
    QuadratureNotConvergedError
        The rate is not resolved by the largest number of panels, or its error not proved.
    WindowBlockedError
        The inverse square of the rate is negative at a place.
    PrecisionLostError
        The rate is not known to a double's precision.
    """
    end = 1.0 if is_even else 2.0
    kinks = speed.kinks if isinstance(speed, BranchedSpeed) else ()
    starts = {0.0, end, *np.linspace(0.0, end, 3).tolist(), *(c for c in corners if 0.0 < c < end)}
    for left, right in kinks:
        # A stretch that holds a kink is one panel, however the others are cut.
        starts = {u for u in starts if not left < u < right}
    if isinstance(speed, BranchedSpeed):
        starts.update(speed.edges)
    waiting = list(pairwise(sorted(starts)))[::-1]
    done: list[Panel] = []
    scale, nodes = 0.0, 0
    while waiting:
        left, right = waiting.pop()
        on_panel = speed.on(left, right) if isinstance(speed, BranchedSpeed) else speed
        panel = _panel(rate, on_panel, left, right)
        if panel is not None:
            nodes += panel.nodes
            # The nodes of a panel with a peak at its end say nothing of its length.
            if speed is None or panel.error <= MAX_TRUSTED_ERROR * float(panel.length):
                scale = max(scale, float(panel.length))
        if panel is not None and (
            right - left < MIN_PANEL_WIDTH or _is_good(panel, scale, speed is not None)
        ):
            done.append(panel)
        else:
            middle = 0.5 * (left + right)
            waiting.extend([(middle, right), (left, middle)])
        if len(done) + len(waiting) > MAX_PANELS:
            last = "its error on the last of them is not bounded"
            if panel is not None:
                last = f"the last tail was {panel.tail:.1e}, the longest panel takes {scale:.1e}"
            raise QuadratureNotConvergedError(
                f"{MAX_PANELS} panels of degree {PANEL_DEGREE} do not resolve the integrand; {last}"
            )
    return _assemble(done, nodes, kinks, is_even=is_even, is_proof_wanted=speed is not None)


def _panel(rate: Callable[[arb], arb], speed: PhaseSpeed | None, left: float, right: float) -> Panel | None:
    """Return the panel with its proof, if there are bounds; None if it has to be halved for one."""
    if speed is None:
        return make_panel(rate, left, right, None)
    middle, half = (arb(left) + arb(right)) / 2, (arb(right) - arb(left)) / 2
    middle_rate = arb.pi() * rate(arb.pi() * middle)
    if not middle_rate.is_finite():
        _require_open(speed, arb.pi() * middle)
    ellipse = find_ellipse(speed, left, right, middle_rate)
    if ellipse is not None:
        try:
            return make_panel(rate, left, right, ellipse, speed.limit)
        except PrecisionLostError:
            _require_open(
                speed, *(arb.pi() * (middle + half * x) for x in chebyshev_points(PANEL_DEGREE).tolist())
            )
            raise
    if right - left > SHORT_PANEL_WIDTH:
        return None
    square = speed.enclosed(arb.pi() * (middle + arb(0, half))) / arb.pi() ** 2
    if square > 0 and square.is_finite():
        return make_panel(rate, left, right, None).between(square.upper().rsqrt(), square.lower().rsqrt())
    return make_panel(rate, left, right, None) if right - left < MIN_PANEL_WIDTH else None


def _require_open(speed: PhaseSpeed, *phases: arb) -> None:
    """Raise WindowBlockedError if the motion does not reach one of the phases."""
    if any(speed.enclosed(theta) < 0 for theta in phases):
        raise WindowBlockedError


def _is_good(panel: Panel, scale: float, is_proof_wanted: bool) -> bool:
    is_resolved = panel.relative_tail <= RESOLVED_RELATIVE_TAIL and panel.change <= RESOLVED_RELATIVE_CHANGE
    is_proved = not is_proof_wanted or panel.error <= NEGLIGIBLE_SHARE * scale
    return is_proved and (is_resolved or panel.tail <= NEGLIGIBLE_SHARE * scale)


def _assemble(
    panels: list[Panel],
    nodes: int,
    kinks: Iterable[tuple[float, float]],
    *,
    is_even: bool,
    is_proof_wanted: bool,
) -> TimeMap:
    if is_even:
        signs = (-1.0) ** np.arange(PANEL_DEGREE + 1)
        turned = [replace(p, left=2.0 - p.right, right=2.0 - p.left, series=p.series * signs) for p in panels]
        panels = panels + turned[::-1]
    edges = np.array([panels[0].left, *(panel.right for panel in panels)])
    half = 0.5 * np.diff(edges)
    rates = np.stack([panel.series for panel in panels], axis=1)
    integrals = np.polynomial.chebyshev.chebint(rates, lbnd=-1.0, axis=0) * half
    total, times = arb(0), [0.0]
    for panel in panels:
        total = (total + panel.length).mid()
        times.append(float(total))
    hi = float(total)
    errors = [_error(panel, is_proof_wanted) for panel in panels]
    inner = largest(
        panel.inner_error if isfinite(panel.inner_error) else _error(panel, True) for panel in panels
    )
    error = sum(errors)
    period = Period(hi, float(total - arb(hi)), error)
    unproved = sum(not isfinite(panel.error) for panel in panels)
    if not is_proof_wanted:
        inner = 0.0
    at_kinks = [u for left, _ in kinks for u in ((left, 2.0 - left) if is_even else (left,))]
    cuts = np.interp(at_kinks, edges, times)
    return TimeMap(edges, rates, integrals, np.array(times), period, inner + error, nodes, unproved, cuts)


def _error(panel: Panel, is_proof_wanted: bool) -> float:
    """Return the proved error of a panel's length, else an estimate; all of it where a proof was wanted."""
    if isfinite(panel.error):
        return panel.error
    if is_proof_wanted:
        return float(panel.length)
    is_resolved = panel.relative_tail <= RESOLVED_RELATIVE_TAIL and panel.change <= RESOLVED_RELATIVE_CHANGE
    return panel.tail * ALIASED_SHARE_OF_TAIL if is_resolved else panel.tail


@dataclass(frozen=True, slots=True)
class GradedSamples:
    """See :class:`workers.solvers.assembly.families.SamplesItself`: a motion through poles, at its own times.

    Next to a pole r is a power of time that may be far below the first: pieces claim there, and so
    everywhere, what the rounding of a time does to it. Each time that is asked for has the error that it has
    where it is.
    """

    on_period: Sampler
    """The six variables at times in [0, period]."""
    passages: FloatArray
    """Times in [0, period) at which a pole is passed."""
    period: Period
    time_error: float
    departures: Callable[[FloatArray], FloatArray]
    """Error of a sample at its own phase, of shape (n,)."""

    def resolved(self, pieces: int, atol: float) -> None:
        """Leave the function of time to :func:`workers.solvers.assembly.dense.resolve_motion`."""

    def sample(self, times: FloatArray, low_parts: FloatArray | None = None) -> FloatArray:
        """Return p, q, r, g1, g2, g3, shape (n, 6)."""
        return self.on_period(split_time(times, self.period, low_parts)[0])

    def error_at(self, times: FloatArray) -> float:
        """Return twice what the error of times does at these, where variables are monotone beside a pole."""
        late = phase_error(times, self.period) + self.time_error
        local = split_time(times, self.period)[0]
        here = self.on_period(local)
        moved = [np.abs(self.on_period((local + by) % self.period.hi) - here) for by in (-late, late)]
        away = np.abs(local[:, None] - self.passages)
        beside = np.minimum(away, self.period.hi - away) <= late
        at_poles = np.abs(self.on_period(self.passages) - here[:, None]) * beside[:, :, None]
        rounding = VARIABLE_RELATIVE_ROUNDING * np.abs(here).max(initial=0.0)
        worst = largest(float(each.max(initial=0.0)) for each in (*moved, at_poles))
        departures = (self.departures((local + by) % self.period.hi) for by in (-late, late))
        return 2.0 * worst + largest(float(each.max(initial=0.0)) for each in departures) + float(rounding)


def phase_sampler(orbit: Orbit, time_map: TimeMap) -> Sampler:
    """Return the six variables as a function of the time map's own times, from 0 to its total.

    It raises PrecisionLostError where the balls of a state are wider than the rounding of doubles.
    """

    def sample(times: FloatArray) -> FloatArray:
        panels, places = time_map.phase_at(times)
        return _states(orbit, time_map, zip(panels.tolist(), places.tolist(), strict=True))

    return sample


def series_sampler(orbit: Graded, time_map: TimeMap) -> tuple[Sampler, FloatArray]:
    """Return the same by series in the phase, in which everything is smooth on each panel; and their errors.

    A state costs a hundred times less. Next to a pole what is small is told relative to itself. The errors,
    one of each panel, are UNSEEN_DEPARTURE_FACTOR times the largest departure between the nodes.
    PrecisionLostError is raised at once.
    """
    panels, nodes = range(len(time_map.times) - 1), chebyshev_points(PANEL_DEGREE)
    series, departures = [], list[float]()
    for panel in panels:
        states = _states(orbit, time_map, [(panel, x) for x in (*nodes.tolist(), *BALL_CHECKED_POINTS)])
        series.append(chebyshev_coefficients(states[: len(nodes)]))
        told = np.polynomial.chebyshev.chebval(np.array(BALL_CHECKED_POINTS), series[-1]).T
        departures.append(float(np.abs(told - states[len(nodes) :]).max()))
    columns: FloatArray = np.stack(series, axis=2)

    def sample(times: FloatArray) -> FloatArray:
        panels, x = time_map.phase_at(times)
        left, right = time_map.edges[panels], time_map.edges[panels + 1]
        states = np.ascontiguousarray(sum_series(columns, panels, x).T)
        sines = orbit.sines(np.where(x < 0.0, left, right) + 0.5 * (right - left) * (x - np.copysign(1.0, x)))
        refine_near_poles(orbit.orbit.loop, states, sines)
        return states

    return sample, UNSEEN_DEPARTURE_FACTOR * np.array(departures)


def _states(orbit: Orbit, time_map: TimeMap, places: Iterable[tuple[int, float]]) -> FloatArray:
    rows = []
    for panel, x in places:
        state = orbit.state(time_map.theta(panel, x))
        rows.append([float(value) for value in state])
        if any(value.rel_accuracy_bits() < KNOWN_BITS and not value.rad() < KNOWN for value in state):
            raise PrecisionLostError("the variables are known to fewer digits than a double has")
    return np.array(rows)
