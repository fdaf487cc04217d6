r"""Time as an analytic function of the phase: libration and rotation, for complex θ in balls.

The phases are those of :mod:`workers.solvers.orbits.orbit`. With N = h − V
a libration between the zeros v₋ < v₊ of N has

.. math:: \frac{dt}{d\theta} = \frac{Z}{\sqrt{c^2 W q}},\qquad q = \frac{N}{(v-v_-)(v_+-v)},

and near a zero the mean value theorem encloses the quotient:

.. math:: \frac{N(v)}{v-v_-} = \int_0^1 N'(v_- + s(v-v_-))\,ds .

That q has no zero proves that the zeros are simple and the only ones on the way.
At real v, where most points of a motion are, the loop is one of real balls.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

from flint import acb, arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.programs import Traced, Tracer, Way, traced_program
from service.dynamics.formula.tape import Tape
from service.dynamics.potentials.potential import VALUE
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import (
    BALLS,
    CurvePlace,
    LoopNumbers,
    gamma_of,
    make_equator,
    r_over_p,
    rates_of,
    steepness_at,
)
from workers.solvers.complex_plane.angular_part import AngularSeries
from workers.solvers.complex_plane.complex_loop import (
    MAX_WHOLE_ALPHA,
    ComplexLoop,
    ComplexPlace,
    geometric,
    tighter,
)

MIN_SINE_OR_COSINE = 2.0**-10
TURN_SINE = 0.0625
"""|sin(θ/2)| or |cos(θ/2)| from which on the direct quotient is good enough."""
POINT_MAX_RADIUS = 2.0**-36
"""Half the real width of a ball of θ that is a region, not a point."""


def _trace_slope(tape: Tape, tracer: Tracer) -> tuple[Sequence[Traced], Sequence[Traced]]:
    """Trace dV from g1, g2, g3 and their derivatives."""
    values, rates = ([tracer.variable(f"{name}{k}") for k in (1, 2, 3)] for name in ("g", "rate"))
    jets = FirstOrderJets(tracer, 1)
    seeds = [jets.seed(value, (rate,)) for value, rate in zip(values, rates, strict=True)]
    return [*values, *rates], jets.gradient(tape.evaluate(jets, seeds))


SLOPE = Way("real", _trace_slope)


class RealLoop:
    """The functions of ComplexLoop at real v with sin v ≠ 0 and cos v ≠ 0; for one precision."""

    def __init__(self, loop: Loop, tape: Tape, side: int, angular: AngularSeries | None = None) -> None:
        self._angular = angular
        self._side, self._mirrored = side, loop.mirrored
        self._potential, self._slope = (traced_program(tape, way).at(ctx.prec) for way in (VALUE, SLOPE))
        alpha = loop.alpha
        self._power = alpha.numerator - 1
        self._is_summed = alpha.denominator == 1 and (alpha <= MAX_WHOLE_ALPHA or side == 0)
        self._equator = make_equator(loop.Z, loop.G, ball(alpha))
        moments, first = (ball(loop.A), ball(loop.C)), loop.g1_sign * loop.G
        self._curve = LoopNumbers(first, loop.Z, ball(alpha), ball(alpha) - 1, *moments, self._mirrored)
        self._factor = self._equator.Z_squared * moments[0] / (2 * moments[1])

    def V(self, v: arb) -> arb:
        """Return the potential."""
        return self._value(self._place(v)[0])

    def squared_rate(self, v: arb, h: arb) -> arb:
        """Return (dt/dv)² = Z²/(c² P), with P = 2 C N / (A E)."""
        at, c_squared = self._place(v)
        return self._factor * steepness_at(self._curve, at.power) / (c_squared * (h - self._value(at)))

    def slope(self, v: arb) -> arb:
        """Return dV/dv."""
        at, _ = self._place(v)
        slope: arb = self._slope(*gamma_of(self._curve, at), *rates_of(self._curve, at))[0]
        if self._angular is not None:
            slope += self._angular.slope(abs(at.sine).log(), at.cosine / at.sine)
        return slope

    def gamma(self, v: arb) -> tuple[arb, arb, arb]:
        """Return g1, g2, g3 in the client's axes."""
        return gamma_of(self._curve, self._place(v)[0])

    def state(self, v: arb, speed: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes from v and dv/dt."""
        at, _ = self._place(v)
        p = -self._curve.Z * speed / at.c
        r, gamma = r_over_p(self._curve, at) * p, gamma_of(self._curve, at)
        return (-r, arb(0), -p, *gamma) if self._mirrored else (p, arb(0), r, *gamma)

    def _value(self, at: CurvePlace[arb]) -> arb:
        value: arb = self._potential(*gamma_of(self._curve, at))[0]
        return value if self._angular is None else value + self._angular.value(abs(at.sine).log())

    def loses_digits(self, v: arb) -> bool:
        """Say whether v is too near the equator, or a pole, for the formulas here."""
        sine, cosine = v.sin_cos()
        near = sine if self._is_summed else cosine
        return not abs(near) > MIN_SINE_OR_COSINE

    def _place(self, v: arb) -> tuple[CurvePlace[arb], arb]:
        """Return the place, and c²."""
        sine, cosine = v.sin_cos()
        equator = self._equator
        size = sine if self._side > 0 else -sine if self._side else abs(sine)
        if self._is_summed:
            power, quotient = size**self._power, geometric(sine * sine, self._power + 1)
            c_squared = equator.Z_squared + equator.G_squared * quotient
        else:
            u = cosine * cosine
            log = BALLS.log_sine(size, u)
            power = (self._curve.beyond * log).exp()
            c_squared = BALLS.c_squared(equator, log, u)
        return CurvePlace(sine, cosine, power, sine.sgn(), c_squared.sqrt()), c_squared


class SmoothPhase(Protocol):
    """A planar motion, or a stretch of it, as a holomorphic function of θ, which grows with time."""

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """Return dt/dθ; not finite if ``analytic`` and it is not holomorphic on the ball."""

    def state(self, theta: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes."""

    def phase(self, v: arb) -> arb:
        """Return θ at a place of it."""

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
        """Return θ after one period of all six variables, or half of it if it comes back by the same way."""
        return arb.pi()

    @property
    def stretches(self) -> tuple[PhaseStretch, ...]:
        """Return stretches from 0 to the length."""
        return (PhaseStretch(self, arb(0), self.length, arb(0)),)

    def phase(self, v: arb) -> arb:
        """See SmoothPhase.phase."""
        return 2 * arb.atan2((v - self.lower).sqrt(), (self.upper - v).sqrt())

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """See SmoothPhase.rate."""
        at, quotient = self._at(theta, analytic=analytic)
        return self.curve.loop.Z * (self.curve.W(at) * quotient).rsqrt(analytic) / at.c

    def rates(self, count: int) -> Iterator[arb]:
        """Yield dt/dθ at equidistant θ halfway between multiples of 2π/count, up to π."""
        real, h, width = self.real, self.curve.h, self.upper - self.lower
        for share in _shares(count, ctx.prec):
            below = width * share
            yield (real.squared_rate(self.lower + below, h) * below * (width - below)).sqrt()

    def state(self, theta: arb, rate: arb | None = None) -> tuple[arb, ...]:
        """See SmoothPhase.state."""
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
            found = curve.expanded_N(v) / product
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
        """Return θ after one period of all six variables, or half of it if it comes back by the same way."""
        return 2 * arb.pi()

    @property
    def stretches(self) -> tuple[PhaseStretch, ...]:
        """Return stretches from 0 to the length."""
        return (PhaseStretch(self, arb(0), self.length, arb(0)),)

    def phase(self, v: arb) -> arb:
        """See SmoothPhase.phase."""
        return self.direction * (v - self.origin)

    def rate(self, theta: acb, *, analytic: bool) -> acb:
        """See SmoothPhase.rate."""
        at, P = self._at(theta, analytic=analytic)
        return self.curve.loop.Z / (at.c * self.curve.root_of(P, analytic))

    def rates(self, count: int) -> Iterator[arb]:
        """Yield dt/dθ at equidistant θ halfway between multiples of 2π/count."""
        real, h, step = self.real, self.curve.h, self.direction * arb.pi() / count
        for j in range(1, 2 * count, 2):
            yield real.squared_rate(self.origin + j * step, h).sqrt()

    def state(self, theta: arb, rate: arb | None = None) -> tuple[arb, ...]:
        """See SmoothPhase.state."""
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
            N = tighter(N, self.curve.expanded_N(v))
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
