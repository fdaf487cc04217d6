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
(:mod:`.kinks`), and one as short as the roundings of u has each of them in it.

What is not: without a formula of V (the family of integrals), or without bounds, panels are judged by
the decay of their series and by half of their nodes. A panel at a place of which nothing is enclosed
is halved down to MIN_PANEL_WIDTH; then its whole length is charged as its error, and it is counted in
the evidence.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from math import isfinite

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import Period, chebyshev_points
from workers.solvers.assembly.time_map import TimeMap
from workers.solvers.errors import PrecisionLostError
from workers.solvers.quadrature.ellipse import PANEL_DEGREE, BranchedSpeed, PhaseSpeed, find_ellipse
from workers.solvers.quadrature.errors import QuadratureNotConvergedError, WindowBlockedError
from workers.solvers.quadrature.panel import Panel, make_panel

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
    kinks = () if speed is None or isinstance(speed, PhaseSpeed) else speed.kinks
    starts = {0.0, end, *np.linspace(0.0, end, 3).tolist(), *(c for c in corners if 0.0 < c < end)}
    for left, right in kinks:
        # A stretch that holds a kink is one panel, however the others are cut.
        starts = {u for u in starts if not left < u < right}
    if speed is not None and not isinstance(speed, PhaseSpeed):
        starts.update(speed.edges)
    waiting = list(pairwise(sorted(starts)))[::-1]
    done: list[Panel] = []
    scale, nodes = 0.0, 0
    while waiting:
        left, right = waiting.pop()
        on_panel = speed if speed is None or isinstance(speed, PhaseSpeed) else speed.on(left, right)
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
