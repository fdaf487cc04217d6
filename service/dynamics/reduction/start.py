"""Finds where on its arc a planar motion starts, and in which direction it moves."""

from dataclasses import dataclass

from flint import arb

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from service.dynamics.reduction.geometry.loop import start_g3_sign
from service.dynamics.reduction.window import Arc, Window

EQUILIBRIUM_DISTANCE = 1e-12
"""A requested start within this distance of the equilibrium is the equilibrium."""


class StartOutsideWindowError(DynamicsError):
    """The requested start is not in the window."""

    code = "start_outside_window"


class StartNeededError(DynamicsError):
    """The window has no point where a motion would start by itself."""

    code = "start_needed"


@dataclass(frozen=True, slots=True)
class StartingPoint:
    """A place on an arc."""

    arc: Arc
    v: arb
    direction: int
    """Sign of dv/dt; 0 at a rest point."""


def starting_point(window: Window, motion: PlanarMotion) -> StartingPoint:
    """Return the start of ``motion`` in ``window``, at the current precision.

    Without a wish: at the equator with s > 0 if the window reaches it, else at
    rest at the larger |g1|, with g2 > 0 if there is a northern arc. At an
    equilibrium every start is that point.

    Raises
    ------
    StartNeededError
        Nothing is asked, and the window has neither the equator nor a rest point:
        a separatrix between two equilibria, or from a pole to one.
    StartOutsideWindowError
        The window does not reach the equator, has no rest point in that
        hemisphere, or does not contain that g1.
    """
    g3_sign = start_g3_sign(window.arcs[0].loop, motion)
    if window.kind == "equilibrium":
        return _at_equilibrium(window, motion)
    if motion.start is None:
        if window.ends[1] == "equator":
            return _at_equator(window, StartAtEquator(), g3_sign)
        if not any("rest" in (arc.lower_end, arc.upper_end) for arc in window.arcs):
            raise StartNeededError(
                "the motion in this window neither crosses the equator nor comes to rest; accepted is "
                f'"start": {{"g1": x}} with x between {window.g1[0]:.6g} and {window.g1[1]:.6g}',
                pointer="/motion/start",
            )
        return _at_rest(window, StartAtRest(), g3_sign, any_hemisphere=True)
    if isinstance(motion.start, StartAtEquator):
        return _at_equator(window, motion.start, g3_sign)
    if isinstance(motion.start, StartAtRest):
        return _at_rest(window, motion.start, g3_sign, any_hemisphere=False)
    return _at_point(window, motion.start, motion, g3_sign)


def _at_equilibrium(window: Window, motion: PlanarMotion) -> StartingPoint:
    """Return the equilibrium in the requested hemisphere, by default the northern."""
    wanted = motion.start.g2_sign if isinstance(motion.start, StartAtRest | StartAtPoint) else 1
    arc = window.arcs[0] if len(window.arcs) == 1 or wanted > 0 else window.arcs[1]
    if isinstance(motion.start, StartAtRest) or motion.start is None:
        is_there = len(window.arcs) > 1 or motion.start is None or (arc.lower.cos() > 0) == (wanted > 0)
    elif isinstance(motion.start, StartAtEquator):
        is_there = abs(window.g2[0]) < EQUILIBRIUM_DISTANCE
    else:
        is_there = abs(float(motion.start.g1) - window.g1[0]) < EQUILIBRIUM_DISTANCE
    if not is_there:
        raise StartOutsideWindowError(
            f"the window is the equilibrium at g1 = {window.g1[0]:.17g}, g2 = {window.g2[0]:.17g} alone",
            pointer="/motion/start",
        )
    return StartingPoint(arc, arc.lower, 0)


def _at_equator(window: Window, start: StartAtEquator, g3_sign: int) -> StartingPoint:
    for arc in window.arcs:
        for v in _equators(arc):
            if (v.sin() > 0) == (g3_sign > 0):
                # dv/dt = c C s sin v.
                return StartingPoint(arc, v, start.s_sign * g3_sign)
    raise StartOutsideWindowError(
        f"the window does not reach the equator: its g2 lies in [{window.g2[0]:.6g}, {window.g2[1]:.6g}]",
        pointer="/motion/start",
    )


def _equators(arc: Arc) -> list[arb]:
    if arc.is_whole_loop:
        return [arc.lower + arb.pi() / 2, arc.lower + 3 * arb.pi() / 2]
    return arc.equators


def _at_rest(window: Window, start: StartAtRest, g3_sign: int, *, any_hemisphere: bool) -> StartingPoint:
    candidates = [
        (arc, v)
        for arc in window.arcs
        for v, end in ((arc.lower, arc.lower_end), (arc.upper, arc.upper_end))
        if end == "rest"
    ]
    # Wishes in the order of their weight: hemisphere, half of the loop, larger |g1|.
    ranked = sorted(
        candidates,
        key=lambda at: (
            _is_northern(at[1]) == (start.g2_sign > 0),
            (at[1].sin() > 0) == (g3_sign > 0),
            float(abs(at[1].sin())),
        ),
        reverse=True,
    )
    found = bool(ranked) and (any_hemisphere or _is_northern(ranked[0][1]) == (start.g2_sign > 0))
    if not found:
        raise StartOutsideWindowError(
            f"no rest point (p = r = 0) with g2 of sign {start.g2_sign} in this window",
            pointer="/motion/start",
        )
    arc, v = ranked[0]
    return StartingPoint(arc, v, 0)


def _is_northern(v: arb) -> bool:
    """Tell whether a place is in the northern hemisphere; one on the equator counts as such."""
    return not v.cos() < 0


def _at_point(window: Window, start: StartAtPoint, motion: PlanarMotion, g3_sign: int) -> StartingPoint:
    loop = window.arcs[0].loop
    size = abs(ball(start.g1))
    if start.g1 * motion.sign_of_g1 > 0:
        sine = size / loop.Z if loop.mirrored else ((size / loop.G).log() / ball(loop.alpha)).exp()
        if sine <= 1:
            quarter = sine.asin()
            v = (quarter if start.g2_sign > 0 else arb.pi() - quarter) * g3_sign
            for arc in window.arcs:
                for turned in (v - 2 * arb.pi(), v, v + 2 * arb.pi()):
                    if arc.lower < turned and turned < arc.upper:
                        return StartingPoint(arc, turned, start.s_sign * g3_sign)
    raise StartOutsideWindowError(
        f"g1 = {start.g1} with g2 of sign {start.g2_sign} is not inside the window, where g1 lies between "
        f"{window.g1[0]:.6g} and {window.g1[1]:.6g} (both excluded)",
        pointer="/motion/start/g1",
    )
