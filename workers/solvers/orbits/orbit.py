r"""Parametrisations that make time a smooth function: libration and rotation.

Libration between two rest points v₋ < v₊ (simple zeros of P):

.. math:: v = m - h\cos\theta,\quad P = (v-v_-)(v_+-v)K(v),\quad
          \frac{dt}{d\theta} = \frac{Z}{c\sqrt K},\quad p = -h\sin\theta\sqrt K .

Rotation around the whole loop, in the direction σ:

.. math:: v = v_0 + \sigma\theta,\qquad \frac{dt}{d\theta} = \frac{Z}{c\sqrt P},\qquad p = -\sigma\sqrt P .

θ grows for ever; one turn of it is one period of all six variables. Values are
balls, so nothing is lost where numerator and denominator vanish together: at
such a point the (even) functions are taken a hair beside it.

The phase of an orbit through poles is graded where that helps: next to a pole it is a power of one in which
all is smooth. Where F is a sum of powers of w, V next to a pole is a sum of powers of \|sin v\| whose
exponents have a common denominator n. With u = u_p ± δ (n xⁿ − (n − 1) xⁿ⁺¹) on either side of the pole at
u_p everything is analytic in x ≥ 0, and du/dx goes on as it was at x = 1. Logarithms, and what comes from
other F, are as smooth as n is large.
"""

from dataclasses import dataclass, field
from itertools import pairwise
from math import copysign, lcm
from typing import Protocol, TypeVar

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.potentials.angular_part.along_curve import smooth_unit
from service.dynamics.reduction.geometry.loop import Loop, LoopPoint
from service.dynamics.reduction.window import Arc, StartingPoint

FloatArray = NDArray[np.float64]
Number = TypeVar("Number", float, arb, FloatArray)
RATE_NUDGE = arb(2) ** -30
"""dt/dθ is even about a turning point: 2^-30 beside it, it differs by 2^-60 of itself."""
STATE_NUDGE = arb(2) ** -60
"""A state 2^-60 beside a point differs by less than an ulp."""
_GENERIC_V = arb(1)
"""A v that is neither a pole nor the equator."""
MAX_POLE_DISTANCE = 0.25
"""Largest δ."""
MAX_HALVINGS = 60
MAX_LOGARITHMIC_UNIT = 8
"""Largest n where there are logarithms: at the nodes next to a pole xⁿ is known to half of 160 bits."""


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


@dataclass(frozen=True, slots=True)
class Graded:
    """An orbit in its graded phase, an :class:`Orbit` too."""

    orbit: Libration | Rotation
    unit: int
    """n."""
    reach: float
    """δ, of u."""

    @property
    def start(self) -> float:
        """Return u at t = 0."""
        for pole in self.corners:
            off = self.orbit.start - pole
            if abs(off) < self.reach:
                low, high = 0.0, 1.0
                for _ in range(MAX_HALVINGS):
                    x = 0.5 * (low + high)
                    low, high = (x, high) if self._power(x) * self.reach < abs(off) else (low, x)
                return pole + copysign(self.reach * high, off)
        return self.orbit.start

    @property
    def is_even(self) -> bool:
        """See Orbit.is_even."""
        return self.orbit.is_even

    @property
    def corners(self) -> tuple[float, ...]:
        """See Orbit.corners."""
        return self.orbit.corners

    @property
    def junctions(self) -> tuple[float, ...]:
        """See Orbit.junctions."""
        return tuple(pole + off for pole in self.corners for off in (-self.reach, self.reach))

    def somewhere(self) -> arb:
        """See Orbit.somewhere."""
        return self.orbit.somewhere()

    def rate(self, theta: arb) -> arb:
        """See Orbit.rate; it is 0 at a pole."""
        own, slope = self._graded(theta)
        return slope if slope == 0 else slope * self.orbit.rate(own)

    def state(self, theta: arb) -> tuple[arb, ...]:
        """See Orbit.state."""
        return self.orbit.state(self._graded(theta)[0])

    def sines(self, u: FloatArray) -> FloatArray:
        """Return sin v in doubles as exactly as they have it, next to poles; NaN elsewhere.

        And NaN where it is not small: a power has as many roundings as its exponent is large.
        """
        found, orbit = np.full(u.shape, np.nan), self.orbit
        for pole in self.corners:
            x = np.abs(u - pole) / self.reach
            off = np.pi * np.copysign(self.reach * self._power(x), u - pole)
            if isinstance(orbit, Rotation):
                v, apart = orbit.origin + orbit.direction * arb.pi() * pole, orbit.direction * off
            else:
                width, half = orbit.upper - orbit.lower, arb.pi() * pole / 2
                v = orbit.lower + width * half.sin() ** 2
                apart = float(width) * np.sin(0.5 * off) * np.sin(2.0 * float(half) + 0.5 * off)
            is_small = (x < 1.0) & (self.unit * np.abs(apart) < 1.0)
            found = np.where(is_small, (-1.0) ** round(float(v / arb.pi())) * np.sin(apart), found)
        return found

    def _graded(self, theta: arb) -> tuple[arb, arb]:
        """Return the phase of the orbit, and how fast it grows with ``theta``."""
        u = theta / arb.pi()
        for pole in self.corners:
            x = abs(u - pole) / self.reach
            if x.contains(0):
                return arb.pi() * pole, arb(0)
            if x < 1:
                n, off = self.unit, self.reach * self._power(x)
                slope = x ** (n - 1) * (n * n - (n * n - 1) * x)
                return arb.pi() * (pole + off if u > pole else pole - off), slope
        return theta, arb(1)

    def _power(self, x: Number) -> Number:
        return x**self.unit * (self.unit - (self.unit - 1) * x)


def refine_near_poles(loop: Loop, states: FloatArray, sines: FloatArray) -> None:
    """Give g1, g3 and r next to a pole the digits that ``sines``, sin v, have: relative to their own size.

    ``states`` have the shape (n, 6) and are overwritten; where a sine, shape (n,), is NaN they stay. Series
    know small variables to the rounding of large ones, and next to a pole forces may depend on g1 without
    bound.
    """
    near = np.flatnonzero(np.isfinite(sines))
    Z, G, alpha = float(loop.Z), loop.g1_sign * float(loop.G), float(loop.alpha)
    # Primed axes: g1 = ±G |sin v|^α, g3 = Z sin v, r = −α g1 p / g3.
    p, r, g1, g3 = (2, 0, 5, 3) if loop.mirrored else (0, 2, 3, 5)
    sine, size = sines[near], np.abs(sines[near])
    states[near, g1], states[near, g3] = G * size**alpha, Z * sine
    states[near, r] = -alpha * G / Z * size ** (alpha - 1.0) * np.sign(sine) * states[near, p]


def graded(orbit: Libration | Rotation) -> Graded | None:
    """Return the graded phase; None where no pole is passed, or none is needed."""
    loop, marks = orbit.loop, sorted((0.0, *orbit.corners, 2.0))
    unit = _unit(loop, 1 if float(orbit.somewhere().sin()) > 0.0 else -1)
    reach = min(MAX_POLE_DISTANCE, *(0.5 * (right - left) for left, right in pairwise(marks)))
    return Graded(orbit, unit, reach) if orbit.corners and unit > 1 and reach > 0.0 else None


def _unit(loop: Loop, side: int) -> int:
    """Return n: of |sin v| there are the powers α(2 − 2m) for every w^m, and those of the curve.

    It is large where there are logarithms, too, or where F is no sum of powers; 1 where V has a formula, but
    for one with logarithms below A/C = 2, where they leave r, a power of time below the first, no digits.
    """
    if loop.potential.has_formula:
        logs = any(made.name == "log" for made in loop.potential.tape.instructions)
        return min(smooth_unit(loop.alpha), MAX_LOGARITHMIC_UNIT) if logs and loop.alpha < 2 else 1
    alpha, signs = loop.alpha, (loop.g1_sign, side)
    client = 1 / alpha if loop.mirrored else alpha
    powers = loop.potential.powers_of_w(*(signs[::-1] if loop.mirrored else signs))
    # |g1|^(2 − 2m) next to g1 = 0, and |g3|^(2αm + 2) next to g3 = 0; a logarithm for m, or −αm, = 1, 2, ...
    own = [(2 * client * m + 2 if loop.mirrored else 2 - 2 * m) * alpha for m in powers]
    resonant = [-client * m if loop.mirrored else m for m in powers]
    divisor = lcm(alpha.denominator, *(exponent.denominator for exponent in own))
    has_logarithms = not powers or any(m > 0 and m.denominator == 1 for m in resonant)
    return min(smooth_unit(alpha), MAX_LOGARITHMIC_UNIT) if has_logarithms else divisor
