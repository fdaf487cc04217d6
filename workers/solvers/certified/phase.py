r"""Time as an analytic function of the phase: libration and rotation, for complex θ in balls.

The phases are those of :mod:`workers.solvers.orbits.orbit`. With N = h − V
a libration between the zeros v₋ < v₊ of N has

.. math:: \frac{dt}{d\theta} = \frac{Z}{\sqrt{c^2 W q}},\qquad q = \frac{N}{(v-v_-)(v_+-v)},

and near a zero the mean value theorem encloses the quotient:

.. math:: \frac{N(v)}{v-v_-} = \int_0^1 N'(v_- + s(v-v_-))\,ds .

That q has no zero proves that the zeros are simple and the only ones on the way.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

from flint import acb, arb, ctx

from service.dynamics.reduction.geometry.point import r_over_p
from workers.solvers.certified.real_loop import RealLoop
from workers.solvers.complex_plane.complex_loop import ComplexLoop, ComplexPlace, tighter

TURN_SINE = 0.0625
"""|sin(θ/2)| or |cos(θ/2)| from which on the direct quotient is good enough."""

POINT_MAX_RADIUS = 2.0**-36
"""Half the real width of a ball of θ that is a region, not a point."""


class TimedPhase(Protocol):
    """A planar motion, or a stretch of it, as a function of θ, which grows with time."""

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """Return dt/dθ; not finite if ``analytic`` and it is not holomorphic on the ball."""

    def state(self, theta: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""

    def phase(self, v: arb) -> arb:
        """Return θ at a place of it."""


class SmoothPhase(TimedPhase, Protocol):
    """One that is holomorphic."""

    def motion(self, theta: acb) -> tuple[acb, ...]:
        """Return dt/dθ and the six variables."""

    def largest_rate(self, theta: float) -> arb | None:
        """Return a bound of dt/dθ on the reals between 0 and θ, if it need not be holomorphic at 0."""
        return None


@dataclass(frozen=True, slots=True)
class PhaseStretch:
    """The part first ≤ θ ≤ last of a phase, on which its rate is holomorphic."""

    phase: SmoothPhase
    first: arb
    last: arb
    shift: arb
    """Added to θ to give the phase of the whole motion."""

    @property
    def begin(self) -> arb:
        """Return the phase of the whole motion at which the stretch begins."""
        return self.first + self.shift

    @property
    def end(self) -> arb:
        """Return the phase of the whole motion at which the stretch ends."""
        return self.last + self.shift


class MotionPhase(TimedPhase, Protocol):
    """A periodic planar motion as a function of θ."""

    @property
    def is_even(self) -> bool:
        """Say whether it comes back by the same way: dt/dθ is even about 0 and the length."""

    @property
    def length(self) -> arb:
        """Return θ after one period of all six variables, half of it if it comes back by the same way."""

    @property
    def stretches(self) -> tuple[PhaseStretch, ...]:
        """Return stretches from 0 to the length."""

    def rates(self, count: int) -> Iterator[arb]:
        """Yield dt/dθ at equidistant θ halfway between multiples of 2π/count, up to π if it is even."""
        ...


@dataclass(frozen=True, slots=True)
class LibrationPhase(SmoothPhase):
    """Motion to and fro between two simple zeros of N, v = m − h cos θ."""

    curve: ComplexLoop
    real: RealLoop
    lower: arb
    upper: arb
    is_even: bool = True

    @property
    def length(self) -> arb:
        """See MotionPhase.length."""
        return arb.pi()

    @property
    def stretches(self) -> tuple[PhaseStretch, ...]:
        """See MotionPhase.stretches."""
        return (PhaseStretch(self, arb(0), self.length, arb(0)),)

    def phase(self, v: arb) -> arb:
        """See TimedPhase.phase."""
        return 2 * arb.atan2((v - self.lower).sqrt(), (self.upper - v).sqrt())

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """See TimedPhase.rate."""
        at, quotient = self._at(theta, analytic=analytic)
        return self.curve.loop.Z * (self.curve.W(at) * quotient).rsqrt(analytic) / at.c

    def rates(self, count: int) -> Iterator[arb]:
        """Yield dt/dθ at equidistant θ halfway between multiples of 2π/count, up to π."""
        real, h, width = self.real, self.curve.h, self.upper - self.lower
        for share in _shares(count, ctx.prec):
            below = width * share
            yield (real.squared_rate(self.lower + below, h) * below * (width - below)).sqrt()

    def state(self, theta: arb, rate: arb | None = None) -> tuple[arb, ...]:
        """See TimedPhase.state."""
        if rate is not None:
            sine, cosine = (theta / 2).sin_cos()
            v = self.lower + (self.upper - self.lower) * sine * sine
            if not self.real.loses_digits(v):
                return self.real.state(v, (self.upper - self.lower) * sine * cosine / rate)
        return tuple(value.real for value in self.motion(acb(theta))[1:])

    def motion(self, theta: acb) -> tuple[acb, ...]:
        """See SmoothPhase.motion."""
        at, quotient = self._at(theta, analytic=False)
        half, root = (self.upper - self.lower) / 2, (self.curve.W(at) * quotient).sqrt()
        return self.curve.loop.Z / (at.c * root), *six_variables(self.curve, at, -half * theta.sin() * root)

    def _at(self, theta: acb, *, analytic: bool) -> tuple[ComplexPlace, acb]:
        """Return the place and q."""
        width = self.upper - self.lower
        sine, cosine = (theta / 2).sin_cos()
        above, below = width * sine * sine, width * cosine * cosine
        is_low = sine.abs_lower() < cosine.abs_lower()
        v = self.lower + above if is_low else self.upper - below
        at = self.curve.place(v, analytic=analytic)
        direct = self.curve.N(at, analytic=analytic) / (above * below)
        root, other = (self.lower, below) if is_low else (self.upper, -above)
        if theta.real.rad() > POINT_MAX_RADIUS:
            return at, direct if direct.real > 0 else self._expanded(v, acb(root), other, above * below)
        if not (sine if is_low else cosine).abs_lower() < TURN_SINE:
            return at, direct
        hull = self.curve.place(v.union(acb(root)), analytic=analytic)
        return at, tighter(direct, self.curve.slope(hull, analytic=analytic) / other)

    def _expanded(self, v: acb, root: acb, other: acb, product: acb) -> acb:
        """Return q on a wide ball where N is known too roughly; not finite unless holomorphic.

        ``product`` is (v − v₋)(v₊ − v), ``other`` is ± its factor that belongs to the root farther away.
        """
        curve = self.curve
        if not product.contains(0):
            found = curve.expanded_N(v, analytic=True) / product
            if found.real > 0:
                return found
        slope, bend = curve.slope_and_curvature(curve.place(v.union(root), analytic=True), analytic=True)
        start = curve.slope(curve.place(root, analytic=False), analytic=False)
        found = tighter(slope, start + bend * (v - root) / 2) / other
        if found.real > 0:
            return found
        # The second divided difference is an average of N''/2.
        hull = curve.place(v.union(acb(self.lower)).union(acb(self.upper)), analytic=True)
        return tighter(found, -curve.slope_and_curvature(hull, analytic=True)[1] / 2)


@dataclass(frozen=True, slots=True)
class RotationPhase(SmoothPhase):
    """Motion round the whole loop, v = v₀ + σθ."""

    curve: ComplexLoop
    real: RealLoop
    origin: arb
    direction: int
    is_even: bool = False

    @property
    def length(self) -> arb:
        """See MotionPhase.length."""
        return 2 * arb.pi()

    @property
    def stretches(self) -> tuple[PhaseStretch, ...]:
        """See MotionPhase.stretches."""
        return (PhaseStretch(self, arb(0), self.length, arb(0)),)

    def phase(self, v: arb) -> arb:
        """See TimedPhase.phase."""
        return self.direction * (v - self.origin)

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """See TimedPhase.rate."""
        at, P = self._at(theta, analytic=analytic)
        return self.curve.loop.Z / (at.c * self.curve.root_of(P, analytic))

    def rates(self, count: int) -> Iterator[arb]:
        """Yield dt/dθ at equidistant θ halfway between multiples of 2π/count."""
        real, h, step = self.real, self.curve.h, self.direction * arb.pi() / count
        for j in range(1, 2 * count, 2):
            yield real.squared_rate(self.origin + j * step, h).sqrt()

    def state(self, theta: arb, rate: arb | None = None) -> tuple[arb, ...]:
        """See TimedPhase.state."""
        v = self.origin + self.direction * theta
        if rate is not None and not self.real.loses_digits(v):
            return self.real.state(v, self.direction / rate)
        return tuple(value.real for value in self.motion(acb(theta))[1:])

    def motion(self, theta: acb) -> tuple[acb, ...]:
        """See SmoothPhase.motion."""
        at, P = self._at(theta, analytic=False)
        root = P.sqrt()
        return self.curve.loop.Z / (at.c * root), *six_variables(self.curve, at, -self.direction * root)

    def _at(self, theta: acb, *, analytic: bool) -> tuple[ComplexPlace, acb]:
        v = self.origin + self.direction * theta
        at = self.curve.place(v, analytic=analytic)
        N = self.curve.N(at, analytic=analytic)
        if theta.real.rad() > POINT_MAX_RADIUS and not N.real > 0:
            N = tighter(N, self.curve.expanded_N(v, analytic=True))
        return at, self.curve.W(at) * N


@lru_cache(maxsize=64)
def _shares(count: int, precision: int) -> tuple[arb, ...]:
    """Return sin²(θ/2) at the phases of ``rates`` up to π."""
    with ctx.workprec(precision):
        return tuple((arb(2 * j + 1) / (2 * count)).sin_pi() ** 2 for j in range(count // 2))


def six_variables(curve: ComplexLoop, at: ComplexPlace, p: acb) -> tuple[acb, ...]:
    """Return (p, q, r, g1, g2, g3) in the client's axes from a place and p."""
    r = r_over_p(curve.numbers(), at) * p
    return (-r, acb(0), -p, *curve.gamma(at)) if curve.loop.mirrored else (p, acb(0), r, *curve.gamma(at))
