"""The loop of a planar motion at real v, in real balls, for many points of one motion."""

from collections.abc import Sequence

from flint import arb, ctx

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.programs import Way, traced_program
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.traces import Traced, Tracer
from service.dynamics.potentials.potential import VALUE
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import BALLS, make_equator
from workers.solvers.complex_plane.angular_part import AngularSeries
from workers.solvers.complex_plane.complex_loop import MANY, geometric

NEAR = 2.0**-10


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
        self._is_summed = alpha.denominator == 1 and (alpha <= MANY or side == 0)
        self._alpha, self._first, self._third = ball(alpha), loop.g1_sign * loop.G, loop.Z
        self._equator = make_equator(loop.Z, loop.G, self._alpha)
        self._Z_squared, self._G_squared = self._equator.Z_squared, self._equator.G_squared
        A, C = ball(loop.A), ball(loop.C)
        # With E = C + A (G/Z)² w^(α−1) is 1/P = A E / (2 C N).
        self._C, self._steepness = C, A * self._G_squared / self._Z_squared
        self._factor = self._Z_squared * A / (2 * C)

    def V(self, v: arb) -> arb:
        """Return the potential."""
        sine, cosine = v.sin_cos()
        _, size, c_squared = self._powers(sine, cosine)
        return self._value(sine, self._gamma(sine, cosine, size, c_squared.sqrt()))

    def squared_rate(self, v: arb, h: arb) -> arb:
        """Return (dt/dv)² = Z²/(c² P)."""
        sine, cosine = v.sin_cos()
        power, size, c_squared = self._powers(sine, cosine)
        N = h - self._value(sine, self._gamma(sine, cosine, size, c_squared.sqrt()))
        return self._factor * (self._C + self._steepness * power * power) / (c_squared * N)

    def slope(self, v: arb) -> arb:
        """Return dV/dv."""
        sine, cosine = v.sin_cos()
        power, size, c_squared = self._powers(sine, cosine)
        c = c_squared.sqrt()
        # d|sin v|/dv is cos v with the sign of sin v.
        rising = cosine if sine > 0 else -cosine
        first = self._first * self._alpha * power * rising
        second = -sine * self._Z_squared * (self._C + self._steepness * power * power) / (self._C * c)
        rates = (first, second, self._third * cosine)
        gamma, along = self._gamma(sine, cosine, size, c), rates[::-1] if self._mirrored else rates
        slope: arb = self._slope(*gamma, *along)[0]
        return slope if self._angular is None else slope + self._angular.slope(abs(sine).log(), cosine / sine)

    def gamma(self, v: arb) -> tuple[arb, arb, arb]:
        """Return g1, g2, g3 in the client's axes."""
        sine, cosine = v.sin_cos()
        _, size, c_squared = self._powers(sine, cosine)
        return self._gamma(sine, cosine, size, c_squared.sqrt())

    def state(self, v: arb, speed: arb) -> tuple[arb, ...]:
        """Return (p, q, r, g1, g2, g3) in the client's axes from v and dv/dt."""
        sine, cosine = v.sin_cos()
        power, size, c_squared = self._powers(sine, cosine)
        c = c_squared.sqrt()
        p = -self._third * speed / c
        # r/p = −A g1 / (C g3).
        r = -self._alpha * self._first / self._third * power * sine.sgn() * p
        g1, g2, g3 = self._gamma(sine, cosine, size, c)
        return (-r, arb(0), -p, g1, g2, g3) if self._mirrored else (p, arb(0), r, g1, g2, g3)

    def _value(self, sine: arb, gamma: Sequence[arb]) -> arb:
        value: arb = self._potential(*gamma)[0]
        return value if self._angular is None else value + self._angular.value(abs(sine).log())

    def _gamma(self, sine: arb, cosine: arb, size: arb, c: arb) -> tuple[arb, arb, arb]:
        g1, g2, g3 = self._first * size, c * cosine, self._third * sine
        return (g3, g2, g1) if self._mirrored else (g1, g2, g3)

    def loses_digits(self, v: arb) -> bool:
        """Say whether v is too near the equator, or a pole, for the formulas here."""
        sine, cosine = v.sin_cos()
        near = sine if self._is_summed else cosine
        return not abs(near) > NEAR

    def _powers(self, sine: arb, cosine: arb) -> tuple[arb, arb, arb]:
        """Return |sin v|^(α−1), |sin v|^α and c²."""
        size = sine if self._side > 0 else -sine if self._side else abs(sine)
        if self._is_summed:
            power, quotient = size**self._power, geometric(sine * sine, self._power + 1)
            c_squared = self._Z_squared + self._G_squared * quotient
        else:
            u = cosine * cosine
            log = BALLS.log_sine(size, u)
            power = ((self._alpha - 1) * log).exp()
            c_squared = BALLS.c_squared(self._equator, log, u)
        return power, power * size, c_squared
