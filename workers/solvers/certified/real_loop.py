"""The loop of a planar motion at real v, in real balls, for many points of one motion."""

from collections.abc import Sequence

from flint import arb, ctx

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
from workers.solvers.complex_plane.complex_loop import MAX_WHOLE_ALPHA, geometric

MIN_SINE_OR_COSINE = 2.0**-10


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
