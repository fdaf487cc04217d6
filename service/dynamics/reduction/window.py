"""Arcs of a loop on which p² > 0, windows made of them, the kinds of their ends, and where a motion starts.

A planar motion lives in one window of its curve. Ends that the quadrature cannot handle are refused here.
"""

from dataclasses import dataclass, field
from typing import Literal

from flint import arb, ctx

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.problem import PlanarMotion, StartAtEquator, StartAtPoint, StartAtRest
from service.dynamics.reduction.geometry.loop import Loop, start_g3_sign
from service.dynamics.reduction.root_finding.gap import NearRest
from service.dynamics.reduction.root_finding.zeros import MAX_ORDER
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN

ArcEnd = Literal["rest", "double", "standstill", "flat", "collision", "pole", "edge"]
"""A simple zero of P; a zero of order two or more; one of an order between these; one of no order that is
known; P → ∞, at a pole or elsewhere; a pole that is not passed; the edge of the potential's domain."""
BALL_AGREEMENT_DISTANCE = 2.0**-30
"""Distance between doubles at which balls agree about what is inside: more than these are rounded by."""


@dataclass(frozen=True, slots=True)
class Arc:
    """A maximal interval lower ≤ v ≤ upper with p² ≥ 0, or the whole loop."""

    loop: Loop
    lower: arb
    upper: arb
    lower_end: ArcEnd | None
    """None, with ``upper_end``, if the arc is the whole loop: p never vanishes."""
    upper_end: ArcEnd | None
    slow: tuple[NearRest, ...] = field(default=(), compare=False, repr=False)
    """Places of the whole loop, −π < v < π, where P nearly touches 0."""

    @property
    def is_whole_loop(self) -> bool:
        """Tell whether the motion goes round the loop."""
        return self.lower_end is None

    @property
    def poles(self) -> list[arb]:
        """Return the v inside the arc where it passes a pole: multiples of π."""
        return self._inside(0)

    @property
    def equators(self) -> list[arb]:
        """Return the v inside the arc where it crosses the equator: odd multiples of π/2."""
        return self._inside(1)

    def _inside(self, parity: int) -> list[arb]:
        # An arc lies within −2π ≤ v ≤ 2π.
        low, high = float(self.lower) - BALL_AGREEMENT_DISTANCE, float(self.upper) + BALL_AGREEMENT_DISTANCE
        quarters = [k for k in range(-4, 5) if k % 2 == parity and low < k * QUARTER_TURN < high]
        if not quarters:
            return []
        # An end next to one of them may be known to many more bits than the current precision.
        with ctx.workprec(max(ctx.prec, self.lower.bits(), self.upper.bits())):
            places = [arb.pi() * k / 2 for k in quarters]
            return [v for v in places if self.lower < v and v < self.upper]


EndKind = Literal["pole", "equator", "rest", "equilibrium", "standstill", "edge", "collision"]
"""At ``rest`` the motion turns back; an ``equilibrium`` it reaches in the limit t → ±∞ only; at a
``standstill`` it comes to rest after a finite time, and may go on at any later one; a ``collision``, where p²
grows without bound, is no pole, and the motion ends there."""
WindowKind = Literal["periodic", "separatrix", "equilibrium", "standstill", "collision", "pole", "edge"]


@dataclass(frozen=True, slots=True)
class Window:
    """One admissible window of |g3| = λ|g1|^(C/A).

    Two arcs that are mirror images under g2 → −g2 make one window.
    """

    index: int
    """Place in the order of growing largest |g1|; of equal ones the northern is first."""
    kind: WindowKind
    """How the motion in it ends: ``periodic``, or the reason why it never closes."""
    ends: tuple[EndKind, EndKind]
    """Where |g1| is smallest, where it is largest."""
    g1: tuple[float, float]
    """g1, with its sign, at the two ends."""
    g2: tuple[float, float]
    """Smallest and largest g2 of the (northern, if there are two) arc."""
    arcs: tuple[Arc, ...]
    """One arc of the loop, or two that are mirror images (northern first)."""


class LeavesDomainError(DynamicsError):
    """The motion runs into the edge of where the potential is defined."""

    code = "leaves_domain"


class FlatZeroError(DynamicsError):
    """p² vanishes at an end of the motion, and not as a power of the distance from it."""

    code = "flat_zero"


class StandstillError(DynamicsError):
    """The motion comes to rest after a finite time at a place that it may leave at any later one."""

    code = "standstill"


def require_known_ends(window: Window) -> None:
    """Refuse a motion whose end is not one that the quadrature knows the way to.

    Raises
    ------
    LeavesDomainError
        It runs out of the potential's domain.
    FlatZeroError
        p² vanishes at an end, but not as a power of the distance from it.
    StandstillError
        It vanishes there as a power below the second, and the motion has no one continuation.
    """
    still = [end for arc in window.arcs for end in _ends_of(arc, "standstill")]
    if still:
        raise StandstillError(
            f"p² vanishes at g2 = {still[0]:.15g} like a power of the distance below the second: the motion "
            "comes to rest there after a finite time, and may go on at any later one, so that the equations "
            "do not say where it is; accepted are windows without such an end",
            pointer="/potential",
        )
    flat = [end for arc in window.arcs for end in _ends_of(arc, "flat")]
    if flat:
        raise FlatZeroError(
            f"p² vanishes at g2 = {flat[0]:.15g}, where the motion ends, and is like no whole power of the "
            f"distance up to the {MAX_ORDER}th: when it comes near that place cannot be computed by "
            'quadrature; accepted there is the method "integration"',
            pointer="/potential",
        )
    if window.kind == "edge":
        raise LeavesDomainError(
            f"the potential is defined on the curve only for g2 between {window.g2[0]:.15g} and "
            f"{window.g2[1]:.15g}, and the motion does not turn back before",
            pointer="/potential",
        )


def height(loop: Loop, v: arb) -> float:
    """Return g2 at v, exactly ±1 or 0 where the loop passes a pole or the equator."""
    sine, cosine = v.sin_cos()
    if sine.contains(arb(0)):
        return 1.0 if cosine > 0 else -1.0
    if cosine.contains(arb(0)):
        return 0.0
    return float(loop.point_from(sine, cosine).g2)


def _ends_of(arc: Arc, kind: ArcEnd) -> list[float]:
    """Return g2 at the ends of this kind of an arc that is no point."""
    ends = ((arc.lower_end, arc.lower), (arc.upper_end, arc.upper))
    return [height(arc.loop, v) for end, v in ends if end == kind and arc.lower is not arc.upper]


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
