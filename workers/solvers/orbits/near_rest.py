r"""A phase for periodic motions that nearly come to rest, which keeps its digits there.

Next to a place v_m where P ≈ K (w² ± ρ²), w = |v − v_m|, the motion lingers for a time like
log(1/ρ). With

.. math:: w = \rho\sinh y \;\text{(it passes)},\qquad w = \rho\cosh y \;\text{(it turns back)},\qquad
          \frac{dt}{dy} = \frac{Z}{c\,\sqrt{P/(w^2 \pm \rho^2)}} ,

dt/dy tends to the constant Z/(c √K), and y grows like log(1/ρ) only: however small ρ is, a few
panels resolve t(y). The way is cut into stretches with such a phase each. They
get shares of the turn in proportion to make dv/du continuous.

An end where the motion turns back at once has v = v_r ± y².
Within a zone about v_m, where P'' is constant to 2^-70 by its ball, P/(w² ± ρ²) = ½ P'' needs no
value of P, which all but cancels there.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Literal

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.reduction.geometry.loop import Loop, LoopPoint
from service.dynamics.reduction.root_finding.gap import NearRest, box_about, factor_R, slopes
from service.dynamics.reduction.window import Arc, StartingPoint
from workers.solvers.orbits.orbit import RATE_NUDGE, STATE_NUDGE, six_variables

CURVATURE_BITS = 70
WIDEST_ZONE_BITS = 80
NARROWEST_ZONE_BITS = 1024
"""−log2 of the zones' radii."""


@dataclass(frozen=True, slots=True)
class Slow:
    """A near rest on the way."""

    v: arb
    """Unrolled."""
    reach: arb
    turns: bool
    zone: arb
    """w up to which dt/dy is constant."""
    K: arb
    at: LoopPoint


@dataclass(frozen=True, slots=True)
class LoopStretch:
    """A part of the way, v from ``first`` to ``last``, with a phase y of its own."""

    kind: Literal["turn", "slow turn", "pass"]
    side: int
    """Side of an end: 1 if the stretch lies above it, −1 below. A pass has 1."""
    origin: arb
    """Where the motion turns, or the near rest that is passed."""
    slow: Slow | None
    first: arb
    last: arb
    """y at both ends, in the order of growing v."""

    def offset(self, y: arb) -> arb:
        """Return v − origin."""
        if self.slow is None:
            return self.side * y * y
        rho = self.slow.reach
        if self.slow.turns:
            half = (y / 2).sinh()
            return self.side * 2 * rho * half * half
        return rho * y.sinh()

    def slope(self, y: arb) -> arb:
        """Return |dv/dy|."""
        if self.slow is None:
            return 2 * abs(y)
        return self.slow.reach * abs(y.sinh() if self.slow.turns else y.cosh())

    def width(self, y: arb) -> arb:
        """Return w, the distance from the near rest."""
        if self.slow is None:
            return arb(1)
        return self.slow.reach * (y.cosh() if self.slow.turns else abs(y.sinh()))

    def phase(self, v: arb) -> arb:
        """Return y at v."""
        away = (v - self.origin).mid()
        if self.slow is None:
            return self.side * arb(0).max(self.side * away).sqrt()
        if self.slow.turns:
            return self.side * 2 * (arb(0).max(self.side * away) / (2 * self.slow.reach)).sqrt().asinh()
        return (away / self.slow.reach).asinh()


def zone_depth(loop: Loop, near: NearRest) -> int:
    """Return −log2 of a radius in v about the place, within which P''/2 is constant to 2^-CURVATURE_BITS."""
    depth = WIDEST_ZONE_BITS
    while depth <= NARROWEST_ZONE_BITS:
        with ctx.workprec(4 * depth):
            if _stiffness(loop.refined(), near, depth).rel_accuracy_bits() >= CURVATURE_BITS:
                return depth
        depth += 24
    return depth


def _stiffness(loop: Loop, near: NearRest, depth: int) -> arb:
    """Return P/(w² ± ρ²) within 2^-depth of the place: R f''/(2 μ²) on a box about it.

    f is its value at the place plus ½ f''(ξ) τ², and w = μ(ξ') τ.
    """
    radius = 2 * arb(2) ** -depth / abs(ball(loop.C) * near.at.c * near.v.sin())
    box = box_about(loop, near.at, radius)
    sine = near.v.sin() + arb(0, arb(2) ** (1 - depth))
    mu = ball(loop.C) * box.c * sine
    second = slopes(loop, box)[1]
    return factor_R(loop, box) * second / (2 * mu * mu)


def make_slow(loop: Loop, near: NearRest, depth: int) -> Slow:
    """Return the near rest with its zone of radius 2^-depth, at the current precision."""
    K = _stiffness(loop, near, depth)
    # The reach is that of the place's own P'': of P'' elsewhere in the zone it is the same up to its ball.
    widened = K * arb(1, arb(2) ** (2 - CURVATURE_BITS))
    return Slow(near.v, near.reach, bool(near.square < 0), arb(2) ** -depth, widened, near.at)


SLOW_PHASE_RELATIVE_REACH = 2.0**-24
"""Reach, against the distance from the pole, below which other phases lose digits."""
SPARE_BITS = 256


@dataclass(frozen=True, slots=True)
class SlowOrbit:
    """A libration or rotation as stretches; u from 0 to 1 (there) or 2 (round) in the order of v."""

    loop: Loop
    stretches: tuple[LoopStretch, ...]
    edges: tuple[float, ...]
    """u where stretches begin and end."""
    start: float
    corners: tuple[float, ...]
    direction: int
    """Direction of a rotation; 1 for a libration, which goes up first."""
    is_even: bool
    precision: int

    @property
    def junctions(self) -> tuple[float, ...]:
        """Return u in (0, 2) where one stretch follows another."""
        inner = self.edges[1:-1]
        if self.is_even:
            return inner + tuple(2.0 - u for u in inner)
        return inner if self.direction > 0 else tuple(2.0 - u for u in inner)

    def somewhere(self) -> arb:
        """Return a v of the orbit at which nothing special happens."""
        stretch = self.stretches[0]
        return stretch.origin + stretch.offset((2 * stretch.first + stretch.last) / 3)

    def rate(self, theta: arb) -> arb:
        """Return dt/dθ > 0."""
        with ctx.workprec(max(ctx.prec, self.precision)):
            stretch, y, scale, _ = self._place(theta)
            at, K, _ = self._beside(stretch, y, RATE_NUDGE)
            return self.loop.Z * scale / (at.c * K.sqrt() * arb.pi())

    def state(self, theta: arb) -> tuple[arb, ...]:
        """Return the six variables."""
        with ctx.workprec(max(ctx.prec, self.precision)):
            stretch, y, _, way = self._place(theta)
            at, K, y = self._beside(stretch, y, STATE_NUDGE)
            return six_variables(self.loop, at, -way * stretch.slope(y) * K.sqrt())

    def _place(self, theta: arb) -> tuple[LoopStretch, arb, arb, int]:
        """Return the stretch, y, |dy/du| and the sign of dv/dt at a phase."""
        u, way = theta / arb.pi(), 1
        if (self.is_even and u > 1) or self.direction < 0:
            u, way = 2 - u, -1
        k = bisect_right(self.edges[1:-1], float(u))
        stretch, left, right = self.stretches[k], arb(self.edges[k]), arb(self.edges[k + 1])
        scale = (stretch.last - stretch.first) / (right - left)
        return stretch, stretch.first + (u - left) * scale, scale, way

    def _beside(self, stretch: LoopStretch, y: arb, nudge: arb) -> tuple[LoopPoint, arb, arb]:
        at, K = self._at(stretch, y)
        if at.c.is_finite() and K.is_finite():
            return at, K, y
        # At a pole or the equator nothing cancels, and the rate need not be even.
        y = y + (nudge if stretch.kind != "pass" and y.contains(0) else STATE_NUDGE)
        return *self._at(stretch, y), y

    def _at(self, stretch: LoopStretch, y: arb) -> tuple[LoopPoint, arb]:
        """Return the place and P/(dv/dy)²."""
        slow = stretch.slow
        if slow is not None and stretch.width(y) < slow.zone:
            return slow.at, slow.K
        at = self.loop.point(stretch.origin + stretch.offset(y))
        return at, at.P / stretch.slope(y) ** 2


def slow_orbit(start: StartingPoint) -> SlowOrbit | None:
    """Return the orbit through a starting point of a periodic arc, None if it is nowhere next to rest."""
    arc = start.arc
    if not is_slow(arc):
        return None
    depth = max(zone_depth(arc.loop, near) for near in arc.slow if _is_close(near))
    precision = 2 * depth + SPARE_BITS
    with ctx.workprec(max(ctx.prec, precision)):
        loop = arc.loop.refined()
        slow = [make_slow(loop, near, depth) for near in arc.slow if _is_close(near)]
    # An end and the place beyond it may agree in far more digits than the time depends on.
    known = max(v.bits() for v in (arc.lower, arc.upper, *(each.v for each in slow)))
    with ctx.workprec(max(precision, known) + SPARE_BITS):
        places = sorted(_on(arc, slow), key=lambda each: float(each.v))
        if not places:
            return None
        stretches = _rotation(places) if arc.is_whole_loop else _libration(arc, places)
        edges = _shares(stretches, 2.0 if arc.is_whole_loop else 1.0)
        direction = start.direction if arc.is_whole_loop else 1
        orbit = SlowOrbit(loop, stretches, edges, 0.0, (), direction, not arc.is_whole_loop, precision)
        return _started(orbit, start)


def is_slow(arc: Arc) -> bool:
    """Tell whether the arc's loop has a place next to rest, which the arc may pass."""
    return any(_is_close(near) for near in arc.slow)


def _is_close(near: NearRest) -> bool:
    return bool(near.reach < SLOW_PHASE_RELATIVE_REACH * abs(near.v.sin()))


def _on(arc: Arc, slow: Sequence[Slow]) -> list[Slow]:
    """Return the near rests that the arc passes, or turns back at, unrolled."""
    found = []
    for each in slow:
        for turn in (-1, 0, 1):
            v = each.v + 2 * arb.pi() * turn
            moved = replace(each, v=v)
            if each.turns:
                ends = [(arc.upper, v - each.reach), (arc.lower, v + each.reach)]
                if not arc.is_whole_loop and any(abs(end - at) < each.reach / 4 for end, at in ends):
                    found.append(moved)
            elif turn == 0 if arc.is_whole_loop else arc.lower < v and v < arc.upper:
                found.append(moved)
    return found


def _rotation(places: Sequence[Slow]) -> tuple[LoopStretch, ...]:
    """Return the stretches of a whole turn, which begins half way between two near rests."""
    around = [*places, replace(places[0], v=places[0].v + 2 * arb.pi())]
    cuts = [((one.v + two.v) / 2).mid() for one, two in pairwise(around)]
    cuts.insert(0, cuts[-1] - 2 * arb.pi())
    return tuple(
        _pass(place, lower, upper) for place, (lower, upper) in zip(places, pairwise(cuts), strict=True)
    )


def _pass(slow: Slow, lower: arb, upper: arb) -> LoopStretch:
    stretch = LoopStretch("pass", 1, slow.v, slow, arb(0), arb(0))
    return replace(stretch, first=stretch.phase(lower).mid(), last=stretch.phase(upper).mid())


def _libration(arc: Arc, places: Sequence[Slow]) -> tuple[LoopStretch, ...]:
    passed = [place for place in places if not place.turns]
    special = [arc.lower, *(place.v for place in passed), arc.upper]
    cuts = [((one + two) / 2).mid() for one, two in pairwise(special)]
    below, above = (_end(places, end, side) for end, side in ((arc.lower, 1), (arc.upper, -1)))
    return (
        _turn(arc.lower, below, 1, cuts[0]),
        *(_pass(place, lower, upper) for place, (lower, upper) in zip(passed, pairwise(cuts), strict=True)),
        _turn(arc.upper, above, -1, cuts[-1]),
    )


def _end(places: Sequence[Slow], end: arb, side: int) -> Slow | None:
    """Return the near rest that the motion turns back at, just beyond this end."""
    turning = (place for place in places if place.turns)
    return next((p for p in turning if abs(p.v + side * p.reach - end) < p.reach / 4), None)


def _turn(end: arb, slow: Slow | None, side: int, other: arb) -> LoopStretch:
    make = partial(LoopStretch, "turn" if slow is None else "slow turn", side, end, slow)
    far = make(arb(0), arb(0)).phase(other).mid()
    return make(arb(0), far) if side > 0 else make(far, arb(0))


def _shares(stretches: Sequence[LoopStretch], whole: float) -> tuple[float, ...]:
    """Return u at the ends, such that dv/du is continuous where stretches meet."""
    sizes = [arb(1)]
    for one, two in pairwise(stretches):
        left = one.slope(one.last) * (one.last - one.first) / sizes[-1]
        sizes.append((two.slope(two.first) * (two.last - two.first) / left).mid())
    total, u = sum(sizes, arb(0)), arb(0)
    edges = [0.0]
    for size in sizes[:-1]:
        u += size
        edges.append(float(whole * u / total))
    return (*edges, whole)


def _started(orbit: SlowOrbit, start: StartingPoint) -> SlowOrbit:
    """Return the orbit with u at the start and at the poles."""
    u = _phase_of(orbit, start.v)
    arc = start.arc
    poles = [arb.pi() * k for k in range(-4, 6)] if arc.is_whole_loop else arc.poles
    corners = sorted({_phase_of(orbit, pole) for pole in poles} - {-1.0})
    if arc.is_whole_loop:
        u, corners = (u, corners) if start.direction > 0 else (2.0 - u, [2.0 - c for c in corners])
    else:
        u = 2.0 - u if start.direction < 0 else u
        corners = [*corners, *(2.0 - c for c in corners)]
    return replace(orbit, start=u, corners=tuple(corners))


def _phase_of(orbit: SlowOrbit, v: arb) -> float:
    """Return u at v, unrolled into the orbit's turn; −1 if it is not on the way."""
    turns = (-1, 0, 1) if not orbit.is_even else (0,)
    quarters = 2 * v / arb.pi()
    if quarters.contains_integer():
        # The place is a pole, or on the equator, to all the bits that are at work here.
        v = arb.pi() * round(float(quarters)) / 2
    for turn in turns:
        moved = v + 2 * arb.pi() * turn
        for k, stretch in enumerate(orbit.stretches):
            ends = [stretch.origin + stretch.offset(y) for y in (stretch.first, stretch.last)]
            small = abs(stretch.last - stretch.first) * arb(2) ** -60
            if ends[0] - small <= moved.mid() <= ends[1] + small:
                share = (stretch.phase(moved) - stretch.first) / (stretch.last - stretch.first)
                left, right = arb(orbit.edges[k]), arb(orbit.edges[k + 1])
                return min(max(float(left + share * (right - left)), orbit.edges[k]), orbit.edges[k + 1])
    return -1.0
