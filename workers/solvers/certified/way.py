"""The way of a motion through poles, by phases of its own next to poles, next to rest points and between.

Where |g1| and V are no functions of sin v at a pole, time is a holomorphic function of the coordinate φ there
(:class:`~.complex_loop.Passage`) on one side and another one on the other side. About a rest
point it is one of the phase of the libration.
"""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from flint import acb, arb

from service.dynamics.reduction.window import StartingPoint
from workers.solvers.certified.phase import (
    POINT_MAX_RADIUS,
    LibrationPhase,
    PhaseStretch,
    RealLoop,
    RotationPhase,
    SmoothPhase,
    six_variables,
)
from workers.solvers.complex_plane.complex_loop import VALUE, ComplexLoop, Passage, drops_matter, tighter

POLE_DISTANCE = 0.3
"""Distance from a pole within which φ is the phase; beyond, v itself, whose balls are narrower there."""


@dataclass(frozen=True, slots=True)
class PassagePhase(SmoothPhase):
    """Motion on one side of a pole: φ = ±θ, θ growing with time and being 0 at the pole."""

    passage: Passage
    direction: int
    """Sign of dv/dt."""

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """See SmoothPhase.rate."""
        curve = self.passage.curve
        phi = self._sign * theta
        at, slope = self.passage.place(phi, analytic=analytic)
        N = curve.N(at, analytic=analytic)
        if theta.real.rad() > POINT_MAX_RADIUS and not N.real > 0 and phi.real > 0:
            plain = replace(curve, unit=0, pole=0)
            N = tighter(N, plain.expanded_N(self.passage.angle(phi)))
        return curve.loop.Z * slope / curve.root_of(at.c_squared * curve.W(at) * N, analytic)

    def state(self, theta: arb) -> tuple[arb, ...]:
        """See SmoothPhase.state."""
        return tuple(value.real for value in self.motion(acb(theta))[1:])

    def motion(self, theta: acb) -> tuple[acb, ...]:
        """See SmoothPhase.motion."""
        curve = self.passage.curve
        at, slope = self.passage.place(self._sign * theta, analytic=False)
        P = curve.W(at) * curve.N(at, analytic=False)
        rate = curve.loop.Z * slope * (at.c_squared * P).rsqrt()
        return rate, *six_variables(curve, at, -self.direction * P.sqrt())

    def largest_rate(self, theta: float) -> arb | None:
        """Return a bound of dt/dθ from the pole to θ where V1 is an integral, and time is not holomorphic.

        Not finite if there is none; None where V has a formula.
        """
        curve = self.passage.curve
        if curve.angular is None:
            return None
        at, slope = self.passage.place(acb(arb(0).union(arb(abs(theta)))), analytic=False)
        known = curve.ask(VALUE, at, (), analytic=False)[0].real
        N = curve.h - known - curve.angular.about_pole(self.passage.log_sigma(arb(abs(theta))))
        rate = curve.loop.Z * slope.real / (at.c_squared * curve.W(at)).real.sqrt() / N.sqrt()
        return arb(abs(rate).upper())

    def phase(self, v: arb) -> arb:
        """Return θ at v."""
        return self._sign * self.passage.phase(v)

    @property
    def _sign(self) -> int:
        return self.passage.way * self.direction


@dataclass(frozen=True, slots=True)
class PolarWay:
    """A libration from its lower rest point to the upper one, or a rotation from its start."""

    curve: ComplexLoop
    stretches: tuple[PhaseStretch, ...]
    is_even: bool

    @property
    def length(self) -> arb:
        """Return θ at its end."""
        return self.stretches[-1].end

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """See SmoothPhase.rate."""
        stretch = self.stretches[self.number(theta.real)]
        return stretch.phase.rate(theta - stretch.shift, analytic=analytic)

    def state(self, theta: arb) -> tuple[arb, ...]:
        """See SmoothPhase.state; on the way back of a libration θ is beyond the length."""
        if self.is_even and theta.mid() > self.length.mid():
            there = self.state(2 * self.length - theta)
            return (*(-rate for rate in there[:3]), *there[3:])
        # What is not known to be on one side of a pole may be on either.
        last = len(self.stretches) - 1
        found = [
            stretch.phase.state(theta - stretch.shift)
            for k, stretch in enumerate(self.stretches)
            if (k == 0 or not theta < stretch.begin) and (k == last or not theta > stretch.end)
        ]
        return found[0] if len(found) == 1 else tuple(_hull(values) for values in zip(*found, strict=True))

    def phase(self, v: arb) -> arb:
        """Return θ at v, on the way there of a libration."""
        for stretch in self.stretches:
            found = stretch.phase.phase(v) + stretch.shift
            if stretch.begin.mid() <= found.mid() <= stretch.end.mid():
                return found
        raise ValueError("no place of the way")

    def number(self, theta: arb) -> int:
        """Return the number of the stretch that has the phase θ."""
        return max(0, bisect_right([float(each.begin) for each in self.stretches], float(theta)) - 1)


MotionPhase = LibrationPhase | RotationPhase | PolarWay
"""A periodic planar motion as a function of θ: it comes back by the same way, so that dt/dθ is even about 0
and the length, or goes round."""


def _hull(values: tuple[arb, ...]) -> arb:
    total = values[0]
    for value in values[1:]:
        total = total.union(value)
    return total


def way_of(curve: ComplexLoop, start: StartingPoint, ends: tuple[arb, arb]) -> PolarWay:
    """Return the way of a motion on a periodic arc with the energy of ``curve``, whose side is 0.

    ``ends`` are the rest points of a libration, proven.
    """
    arc, quarter = start.arc, arb.pi() / 2
    if arc.is_whole_loop:
        whole = start.v + 4 * quarter * start.direction
        return PolarWay(curve, _joined(_passages(curve, start.v, whole, start.direction)), is_even=False)
    poles = [arb.pi() * k for k in range(-2, 3)]
    inside = [pole for pole in poles if ends[0] < pole and pole < ends[1]]
    cuts = ((ends[0] + inside[0]) / 2).mid(), ((inside[-1] + ends[1]) / 2).mid()
    about = [_libration(curve, end, ends) for end in ends]
    first = about[0], arb(0), about[0].phase(cuts[0])
    last = about[1], about[1].phase(cuts[1]), arb.pi()
    return PolarWay(curve, _joined([first, *_passages(curve, *cuts, 1), last]), is_even=True)


_Part = tuple[SmoothPhase, arb, arb]


def _passages(curve: ComplexLoop, v: arb, other: arb, direction: int) -> list[_Part]:
    """Return the parts of the way from v to the other place, cut at poles and POLE_DISTANCE beside them."""
    poles = [arb.pi() * k for k in range(-4 * direction, 5 * direction, direction)]
    marks = [pole + direction * off for pole in poles for off in (-POLE_DISTANCE, 0, POLE_DISTANCE)]
    inside = [
        mark for mark in marks if direction * mark > direction * v and direction * mark < direction * other
    ]
    knows_drop = drops_matter(curve.tape)
    parts: list[_Part] = []
    for begin, end in pairwise([v, *inside, other]):
        middle = (begin + end) / 2
        pole = round(float(middle / arb.pi()))
        way = 1 if middle > arb.pi() * pole else -1
        side = -way if pole % 2 else way
        if abs(middle - arb.pi() * pole) < POLE_DISTANCE:
            beside = replace(curve, side=side, pole=(-1) ** pole if knows_drop else 0)
            phase: SmoothPhase = PassagePhase(Passage(beside, pole, way), direction)
        else:
            far = replace(curve, side=side)
            phase = RotationPhase(
                far, RealLoop(far.loop, far.tape, side, far.angular), begin.mid(), direction
            )
        first, last = (arb(0) if at.overlaps(arb.pi() * pole) else phase.phase(at) for at in (begin, end))
        parts.append((phase, first, last))
    return parts


def _libration(curve: ComplexLoop, end: arb, ends: tuple[arb, arb]) -> LibrationPhase:
    """Return the libration's own phase, to be used about one of its ends."""
    side = replace(curve, side=1 if end.sin() > 0 else -1, unit=0)
    return LibrationPhase(side, RealLoop(curve.loop, curve.tape, side.side, curve.angular), *ends)


def _joined(parts: Sequence[_Part]) -> tuple[PhaseStretch, ...]:
    stretches: list[PhaseStretch] = []
    at = arb(0)
    for phase, first, last in parts:
        stretches.append(PhaseStretch(phase, first, last, (at - first).mid()))
        at = stretches[-1].end
    return tuple(stretches)
