r"""Parametrisations that make time a smooth function: libration and rotation.

Libration between two rest points v₋ < v₊ (simple zeros of P):

.. math:: v = m - h\cos\theta,\quad P = (v-v_-)(v_+-v)K(v),\quad
          \frac{dt}{d\theta} = \frac{Z}{c\sqrt K},\quad p = -h\sin\theta\sqrt K .

Rotation around the whole loop, in the direction σ:

.. math:: v = v_0 + \sigma\theta,\qquad \frac{dt}{d\theta} = \frac{Z}{c\sqrt P},\qquad p = -\sigma\sqrt P .

θ grows for ever; one turn of it is one period of all six variables. Values are
balls, so nothing is lost where numerator and denominator vanish together: at
such a point the (even) functions are taken a hair beside it.
"""

from dataclasses import dataclass, field
from typing import Protocol

from flint import arb, ctx

from service.dynamics.reduction.geometry.loop import Loop, LoopPoint
from service.dynamics.reduction.window import Arc, StartingPoint

RATE_NUDGE = arb(2) ** -30
"""dt/dθ is even about a turning point: 2^-30 beside it, it differs by 2^-60 of itself."""
STATE_NUDGE = arb(2) ** -60
"""A state 2^-60 beside a point differs by less than an ulp."""
_GENERIC_V = arb(1)
"""A v that is neither a pole nor the equator."""


class Orbit(Protocol):
    """A periodic planar motion as a function of the phase θ."""

    @property
    def start(self) -> float:
        """Return u = θ/π at t = 0, in [0, 2)."""
        ...

    @property
    def is_even(self) -> bool:
        """Say whether dt/dθ takes the same value at θ and 2π − θ."""
        ...

    @property
    def corners(self) -> tuple[float, ...]:
        """Return u = θ/π in (0, 2) where the motion passes a pole."""
        ...

    @property
    def junctions(self) -> tuple[float, ...]:
        """Return the other u in (0, 2) where dt/dθ is not smooth."""
        ...

    def somewhere(self) -> arb:
        """Return a v of the orbit at which nothing special happens."""
        ...

    def rate(self, theta: arb) -> arb:
        """Return dt/dθ > 0."""
        ...

    def state(self, theta: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""
        ...


@dataclass(frozen=True, slots=True)
class Libration:
    """Motion to and fro between two rest points."""

    loop: Loop
    lower: arb
    upper: arb
    start: float
    corners: tuple[float, ...]
    is_even: bool = True
    junctions: tuple[float, ...] = ()
    wholes: dict[int, arb] = field(default_factory=dict, init=False, compare=False, repr=False)
    """v₊ − v₋, by precision: every state needs it."""

    def somewhere(self) -> arb:
        """Return a v at an odd share of the way between the rest points."""
        return _between(self.lower, self.upper)

    def rate(self, theta: arb) -> arb:
        """Return Z / (c √K)."""
        # At a pole or the equator the rate need not be even, and nothing cancels.
        turning = (theta / arb.pi()).contains_integer()
        at, K, _ = self._beside(theta, RATE_NUDGE if turning else STATE_NUDGE)
        return self.loop.Z / (at.c * K.sqrt())

    def state(self, theta: arb) -> tuple[arb, ...]:
        """Return the six variables."""
        at, K, product = self._beside(theta, STATE_NUDGE)
        return six_variables(self.loop, at, -product * K.sqrt())

    def _whole(self) -> arb:
        whole = self.wholes.get(ctx.prec)
        if whole is None:
            whole = self.wholes[ctx.prec] = self.upper - self.lower
        return whole

    def _beside(self, theta: arb, nudge: arb) -> tuple[LoopPoint, arb, arb]:
        found = self._at(theta)
        if found[0].c.is_finite() and found[1].is_finite():
            return found
        return self._at(theta + nudge)

    def _at(self, theta: arb) -> tuple[LoopPoint, arb, arb]:
        """Return the point, K, and h sin θ, whose square is (v − v₋)(v₊ − v)."""
        sine, cosine = (theta / 2).sin_cos()
        along = self._whole() * sine
        product = along * cosine
        is_near_lower = -0.75 < sine < 0.75
        v = self.lower + along * sine if is_near_lower else self.upper - self._whole() * cosine * cosine
        at = self.loop.point(v)
        return at, at.P / (product * product), product


@dataclass(frozen=True, slots=True)
class Rotation:
    """Motion round the whole loop, through both poles."""

    loop: Loop
    origin: arb
    direction: int
    corners: tuple[float, ...]
    start: float = 0.0
    is_even: bool = False
    junctions: tuple[float, ...] = ()

    def somewhere(self) -> arb:
        """Return v = 1, which is neither a pole nor the equator."""
        return _GENERIC_V

    def rate(self, theta: arb) -> arb:
        """Return Z / (c √P)."""
        at = self._beside(theta, STATE_NUDGE)
        return self.loop.Z / (at.c * at.P.sqrt())

    def state(self, theta: arb) -> tuple[arb, ...]:
        """Return the six variables."""
        at = self._beside(theta, STATE_NUDGE)
        return six_variables(self.loop, at, -self.direction * at.P.sqrt())

    def _beside(self, theta: arb, nudge: arb) -> LoopPoint:
        at = self.loop.point(self.origin + self.direction * theta)
        if at.c.is_finite() and at.P.is_finite():
            return at
        return self.loop.point(self.origin + self.direction * (theta + nudge))


def somewhere_on(arc: Arc) -> arb:
    """Return what the orbit of :func:`make_orbit` on a periodic arc says of itself, without making one."""
    return _GENERIC_V if arc.is_whole_loop else _between(arc.lower, arc.upper)


def _between(lower: arb, upper: arb) -> arb:
    return (2 * lower + upper) / 3


def make_orbit(start: StartingPoint) -> Libration | Rotation:
    """Return the orbit through a starting point of a periodic arc."""
    arc = start.arc
    if arc.is_whole_loop:
        turn = 2 * arb.pi()
        poles = (-start.v * start.direction + arb.pi() * k for k in range(-4, 6))
        inside = tuple(float(theta / arb.pi()) for theta in poles if arb(0) < theta and theta < turn)
        return Rotation(arc.loop, start.v, start.direction, inside)
    u = _phase(arc.lower, arc.upper, start.v)
    if start.direction < 0:
        u = 2.0 - u
    corners = [_phase(arc.lower, arc.upper, pole) for pole in arc.poles]
    both = tuple(corners) + tuple(2.0 - corner for corner in corners)
    return Libration(arc.loop, arc.lower, arc.upper, u, both)


def starting_state(start: StartingPoint) -> tuple[arb, ...]:
    """Return (p, q, r, g1, g2, g3) at a starting point of any arc, periodic or not."""
    at = start.arc.loop.point(start.v)
    if not (at.c.is_finite() and at.P.is_finite()):
        at = start.arc.loop.point(start.v + STATE_NUDGE)
    p = -start.direction * at.P.sqrt() if start.direction else arb(0)
    return six_variables(start.arc.loop, at, p)


def six_variables(loop: Loop, at: LoopPoint, p: arb) -> tuple[arb, ...]:
    """Return (p, q, r, g1, g2, g3) in the client's axes from the primed point and p."""
    r = -loop.A.numerator * loop.C.denominator * at.g1 * p / (at.g3 * loop.C.numerator * loop.A.denominator)
    if loop.mirrored:
        return -r, arb(0), -p, at.g3, at.g2, at.g1
    return p, arb(0), r, at.g1, at.g2, at.g3


def _phase(lower: arb, upper: arb, v: arb) -> float:
    """Return θ/π in [0, 1] with v = m − h cos θ, accurate at both ends."""
    below, above = (v - lower).nonnegative_part(), (upper - v).nonnegative_part()
    return float(2 * arb.atan2(below.sqrt(), above.sqrt()) / arb.pi())
