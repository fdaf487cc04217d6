"""Arcs of a loop on which p² > 0, windows made of them, and the kinds of their ends.

A planar motion lives in one window of its curve. Ends that the quadrature cannot handle are refused here.
"""

from dataclasses import dataclass, field
from typing import Literal

from flint import arb, ctx

from service.dynamics.errors import DynamicsError
from service.dynamics.reduction.geometry.loop import Loop
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
