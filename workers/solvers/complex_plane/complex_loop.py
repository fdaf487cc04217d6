r"""The loop of a planar motion for complex v, in balls.

The formulas are those of :mod:`service.dynamics.reduction.geometry.point`, with powers of w = sin²v and
N = h − V. Nothing in them vanishes together with its denominator, except at the equator u = cos²v = 0, where

.. math:: \frac{1-w^\alpha}{1-w} = \alpha\int_0^1 (1-su)^{\alpha-1} ds

lies in the convex hull of the integrand.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache, partial
from typing import NamedTuple, TypeVar

from flint import acb, arb, ctx

from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import ComplexBallAlgebra, ball
from service.dynamics.formula.algebras.power_sums import PowerAlgebra, PowerSum, Small
from service.dynamics.formula.programs import MANY_EVALUATIONS, Kind, Traced, Tracer, Way
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import LoopNumbers, bends_of, gamma_of, rates_of, speed_factor
from workers.solvers.complex_plane.angular_part import AngularSeries
from workers.solvers.complex_plane.questions import BEND, SLOPE, VALUE, PlaneQuestion

T = TypeVar("T")
Ball = TypeVar("Ball", arb, acb)

MAX_WHOLE_ALPHA = 32
"""Integers α up to this are summed as powers; all where a pole is passed."""
MANY_EVALUATIONS_ABOUT_POLES = 4
"""As MANY_EVALUATIONS of programs: sums of powers are dearer."""
EQUATOR_COSINE_SQUARED = 2.0**-8
NEAR_POLE_SINE = 2.0**-3
_UNKNOWN = acb(arb.nan())


class ComplexPlace(NamedTuple):
    """A ball of the loop, a :class:`.PlaceOnLoop` of it; primed axes."""

    sine: acb
    cosine: acb
    power: acb
    """It has the sign of sin v where the motion passes poles and α is even."""
    turn: acb
    c_squared: acb
    c: acb
    root: acb
    """sin v, or |sin v|^(1/unit) next to a pole (:mod:`service.dynamics.formula.algebras.power_sums`)."""


@dataclass(frozen=True, slots=True)
class ComplexLoop:
    """The curve and N = h − V on it.

    ``side`` is the sign of sin v on the half that is meant, 0 for a motion that
    passes poles: α is an integer then, and where it is odd g1 alone is not holomorphic.
    ``unit`` is that of a half that reaches a pole (:mod:`.passage`), else 0; next to the pole g2 = ``pole``
    = ±1 it is 1 or more, and formulas know the drop 1 − |g2| = (g1² + g3²)/(1 + |g2|) as a power of sin v.
    """

    loop: Loop
    tape: Tape
    h: arb
    side: int
    unit: int = 0
    pole: int = 0
    angular: AngularSeries | None = None
    """The part beside the formula, of a potential that has an integral too."""
    known: dict[int, LoopNumbers[acb]] = field(default_factory=dict, init=False, compare=False, repr=False)
    """The numbers of the loop, by precision: every place needs them."""
    about: tuple[object, ...] = field(init=False, compare=False, repr=False)
    """The part of a key that tells the programs of a formula about a pole from those about another."""

    def __post_init__(self) -> None:
        """Put together what is asked at every place."""
        loop = self.loop
        about = (*loop.alpha.as_integer_ratio(), loop.mirrored, loop.g1_sign, self.side, self.unit, self.pole)
        object.__setattr__(self, "about", about if self._has_poles else ())

    def place(self, v: acb, *, analytic: bool) -> ComplexPlace:
        """Return the place; not finite if ``analytic`` and the curve is not holomorphic on the ball."""
        loop = self.loop
        sine, cosine = v.sin_cos()
        if self.side and sine.abs_upper() < NEAR_POLE_SINE:
            # Its ball is as wide as that of v, where cos v changes by |sin v| times this.
            narrow = (1 - sine * sine).sqrt(analytic)
            cosine = narrow if cosine.real > 0 else -narrow
        alpha, u = loop.alpha, cosine * cosine
        turn = acb(self.side or 1)
        root = sine if self.side >= 0 or not self.unit else -sine
        if self.unit and analytic:
            # Balls of powers by logarithms are far narrower than those of products, on regions.
            log = root.log(analytic)
            power, root = (self.numbers().beyond * log).exp(), (log / self.unit).exp()
        elif alpha.denominator != 1:
            power = (self.side * sine).pow(acb(ball(alpha - 1)), analytic=analytic)
        else:
            power = (sine if self.side >= 0 else -sine) ** (alpha.numerator - 1)
            if self.side == 0 and alpha.numerator % 2:
                turn = sine.real_sgn(analytic)
        if alpha.denominator == 1 and (alpha <= MAX_WHOLE_ALPHA or self.side == 0):
            quotient = geometric(sine * sine, alpha.numerator)
        else:
            quotient = self._quotient(sine, u, analytic=analytic)
        c_squared = loop.Z * loop.Z + loop.G * loop.G * quotient
        if self.unit > 1 and not analytic:
            root = (root.log() / self.unit).exp()
        return ComplexPlace(sine, cosine, power, turn, c_squared, self.root_of(c_squared, analytic), root)

    def root_of(self, value: acb, analytic: bool) -> acb:
        """Return √value; on regions by logarithms, whose balls are narrower, if there is a unit."""
        return (value.log(analytic) / 2).exp() if self.unit and analytic else value.sqrt(analytic)

    def gamma(self, at: ComplexPlace) -> tuple[acb, acb, acb]:
        """Return g1, g2, g3 in the client's axes."""
        return gamma_of(self.numbers(), at)

    def N(self, at: ComplexPlace, *, analytic: bool) -> acb:
        """Return h − V."""
        found = self.h - self.ask(VALUE, at, (), analytic=analytic)[0]
        return found if self.angular is None else found - self.angular.value(self._log_sigma(at))

    def slope(self, at: ComplexPlace, *, analytic: bool) -> acb:
        """Return dN/dv; not finite if ``analytic`` and N is not holomorphic, though its derivative may be."""
        value, rate = self.ask(SLOPE, at, rates_of(self.numbers(), at), analytic=analytic)
        if self.angular is not None:
            rate += self.angular.slope(self._log_sigma(at), at.cosine / at.sine)
        return _UNKNOWN if analytic and not value.is_finite() else -rate

    def slope_and_curvature(self, at: ComplexPlace, *, analytic: bool) -> tuple[acb, acb]:
        """Return dN/dv and d²N/dv²: rough, for wide balls."""
        numbers, alpha, sine = self.numbers(), self.loop.alpha, at.sine
        if self.side and not (self.side * sine).real > 0:
            # Powers of 1 − u are those of w only as long as |arg w| < π.
            return _UNKNOWN, _UNKNOWN
        below = at.power / sine
        if alpha.denominator == 1:
            below = (self.side or 1) * ((self.side or 1) * sine) ** (alpha.numerator - 2)
        mean = acb(1).union(sine * sine).pow(numbers.alpha - 2, analytic=analytic)
        rates = zip(rates_of(numbers, at), bends_of(numbers, at, below, mean), strict=True)
        beside = [part for pair in rates for part in pair]
        value, rate, bend = self.ask(BEND, at, beside, analytic=analytic)
        if self.angular is not None:
            log_sigma, cotangent = self._log_sigma(at), at.cosine / sine
            rate += self.angular.slope(log_sigma, cotangent)
            bend += self.angular.curvature(log_sigma, cotangent)
        if analytic and not value.is_finite():
            return _UNKNOWN, _UNKNOWN
        return -rate, -bend

    def expanded_N(self, v: acb, *, analytic: bool) -> acb:
        """Return N on a wide ball, by Taylor's formula of order two about its centre."""
        centre = v.mid()
        middle = self.place(centre, analytic=False)
        bend = self.slope_and_curvature(self.place(v, analytic=analytic), analytic=analytic)[1]
        offset = v - centre
        slope = self.slope(middle, analytic=False)
        return self.N(middle, analytic=False) + offset * (slope + bend * offset / 2)

    def W(self, at: ComplexPlace) -> acb:
        """Return P / N."""
        return speed_factor(self.numbers(), at.power)

    def ask(
        self, question: PlaneQuestion, at: ComplexPlace, beside: Sequence[acb], *, analytic: bool
    ) -> tuple[acb, ...]:
        """Return the answers at a place."""
        loop, second = self.loop, at.c * at.cosine
        kind: Kind = "analytic" if analytic else "complex"
        # About a pole formulas have sin v, G and Z for g1 and g3.
        inputs: tuple[acb, ...]
        if not self._has_poles:
            inputs = self.gamma(at)
        else:
            drop = (loop.Z * loop.Z + (loop.G * at.power) ** 2) / (1 + self.pole * second)
            inputs = at.root, drop if self.pole else second, acb(loop.G), acb(loop.Z)
        name = (question.name, kind, self.about)
        run = self.tape.program(name, Way(kind, partial(self._traced, question), often=self._often))
        if run is not None:
            return run(*inputs, *beside)
        return self._answer(question, self.tape, _plain(analytic), inputs, beside)

    def _log_sigma(self, at: ComplexPlace) -> acb:
        """Return log |sin v|."""
        return self.unit * at.root.log(True) if self.unit else (self.side * at.sine).log(True)

    def numbers(self) -> LoopNumbers[acb]:
        """Return the numbers of the loop at the current precision."""
        found = self.known.get(ctx.prec)
        if found is None:
            loop = self.loop
            alpha, A, C = (acb(ball(number)) for number in (loop.alpha, loop.A, loop.C))
            first, Z = acb(loop.G * loop.g1_sign), acb(loop.Z)
            found = self.known[ctx.prec] = LoopNumbers(first, Z, alpha, alpha - 1, A, C, loop.mirrored)
        return found

    @property
    def _often(self) -> int:
        return MANY_EVALUATIONS_ABOUT_POLES if self._has_poles else MANY_EVALUATIONS

    @property
    def _has_poles(self) -> bool:
        return self.side == 0 or self.unit > 0

    def _traced(
        self, question: PlaneQuestion, tape: Tape, tracer: Tracer
    ) -> tuple[Sequence[Traced], Sequence[Traced]]:
        names = ("root", "second", "G", "Z") if self._has_poles else ("g1", "g2", "g3")
        inputs = [tracer.variable(name) for name in names]
        beside = [tracer.variable(f"beside {k}") for k in range(question.beside)]
        return (*inputs, *beside), self._answer(question, tape, tracer, inputs, beside)

    def _answer(
        self, question: PlaneQuestion, tape: Tape, base: Algebra[T], inputs: Sequence[T], beside: Sequence[T]
    ) -> tuple[T, ...]:
        if not self._has_poles:
            return question.answer(tape, base, inputs, beside)
        root, second, G, Z = inputs
        algebra = PowerAlgebra(base, Small(root, max(1, self.unit), self.side))
        g1, g3 = algebra.loop(G, Z, self.loop.alpha, self.loop.g1_sign)
        g2, known = algebra.of(second), [algebra.of(value) for value in beside]
        if self.pole:
            # The second input is the drop over sin²v.
            drop = PowerSum({(Fraction(2), 0): second})
            g2 = algebra.subtract(algebra.constant(Fraction(1)), drop)
            g2 = g2 if self.pole > 0 else algebra.negate(g2)
            known = [algebra.multiply(g2, g2)] if question.is_squared else known
        gamma = (g3, g2, g1) if self.loop.mirrored else (g1, g2, g3)
        answers = question.answer(tape, algebra, gamma, known)
        return tuple(algebra.value(answer) for answer in answers)

    def _quotient(self, sine: acb, u: acb, *, analytic: bool) -> acb:
        """Return (1 − w^α) / u for sin v of the sign ``side``."""
        alpha, beyond, signed = self.numbers().alpha, self.numbers().beyond, self.side * sine
        # Powers of 1 − u are those of w only as long as |arg w| < π.
        is_right = signed.real > 0
        log = (-u).log1p() if is_right and u.abs_upper() < 0.75 else 2 * signed.log(analytic)
        direct = -(alpha * log).expm1() / u
        # The direct quotient is rough where u is small, and on balls about as wide as u.
        if not (is_right and u.abs_lower() < arb(EQUATOR_COSINE_SQUARED).max(4 * u.real.rad())):
            return direct
        hull = acb(1).union(1 - u)
        if self.unit and analytic:
            return tighter(direct, alpha * (beyond * hull.log(analytic)).exp())
        return tighter(direct, alpha * hull.pow(beyond, analytic=analytic))


def geometric(ratio: Ball, count: int) -> Ball:
    """Return 1 + x + … + x^(count − 1)."""
    if count > MAX_WHOLE_ALPHA:
        half = geometric(ratio, count // 2)
        total = half * (1 + ratio ** (count // 2))
        return total * ratio + 1 if count % 2 else total
    total = ratio * 0 + 1
    for _ in range(count - 1):
        total = total * ratio + 1
    return total


def tighter(one: acb, two: acb) -> acb:
    """Return the ball of the smaller radius: a finite one, if there is one."""
    if not one.is_finite():
        return two
    if not two.is_finite():
        return one
    return one if _size(one) < _size(two) else two


def _size(value: acb) -> arb:
    return value.real.rad() + value.imag.rad()


@cache
def _plain(analytic: bool) -> ComplexBallAlgebra:
    return ComplexBallAlgebra(analytic=analytic)
