r"""The loop of a planar motion for complex v, in balls.

The formulas are those of :mod:`service.dynamics.reduction.geometry.point`, with powers of w = sin²v and
N = h − V. Nothing in them vanishes together with its denominator, except at the equator u = cos²v = 0, where

.. math:: \frac{1-w^\alpha}{1-w} = \alpha\int_0^1 (1-su)^{\alpha-1} ds

lies in the convex hull of the integrand.

On one side of the pole v = πk everything is smooth in a coordinate φ, a :class:`Passage`. With u = |v − πk|
and a whole number n, the unit,

.. math:: \tan\frac u2 = \tan^n\frac\varphi2,\qquad \frac{du}{d\varphi} = n\,\frac{\sin u}{\sin\varphi},

.. math:: |\sin v| = \frac{2X}{1+X^2},\quad X = \tan^n\frac\varphi2 .

So |sin v|^(1/n) is holomorphic about φ = 0 as well as between the poles, and with it |g1| = G |sin v|^α and
all powers of it if n is a multiple of their denominators: then V, p and time are. From a pole to the equator
φ runs from 0 to π/2, whatever n is, and where n is large the pieces of it that an analytic function takes
grow in number like log n.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache, partial
from math import lcm
from typing import Any, NamedTuple, TypeVar  # Any: a question is answered in every algebra

from flint import acb, arb, ctx

from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra, ComplexBallAlgebra, ball
from service.dynamics.formula.algebras.jets import FirstOrderJets, Jet, SecondOrderJets
from service.dynamics.formula.algebras.power_sums import Power, PowerAlgebra, PowerSum, Small
from service.dynamics.formula.programs import MANY_EVALUATIONS, Kind, Traced, Tracer, Way
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import LoopNumbers, bends_of, gamma_of, rates_of, speed_factor
from workers.solvers.complex_plane.angular_part import AngularSeries

Values = Sequence[Any]
T = TypeVar("T")
Ball = TypeVar("Ball", arb, acb)
MAX_WHOLE_ALPHA = 32
"""Integers α up to this are summed as powers; all where a pole is passed."""
MANY_EVALUATIONS_ABOUT_POLES = 4
"""As MANY_EVALUATIONS of programs: sums of powers are dearer."""
EQUATOR_COSINE_SQUARED = 2.0**-8
NEAR_POLE_SINE = 2.0**-3
GENERIC_ROOT_OF_SINE = Fraction(2, 3)
"""A value of |sin v|^(1/unit) at which a formula is asked for its powers."""
_UNKNOWN = acb(arb.nan())


@dataclass(frozen=True, slots=True)
class PlaneQuestion:
    """A question that needs so many inputs beside g1, g2, g3."""

    name: str
    beside: int
    answer: Callable[[Tape, Algebra[Any], Values, Values], tuple[Any, ...]]
    """Returns the answers, given the tape, the algebra, (g1, g2, g3) and the inputs beside."""
    is_squared: bool = False
    """The one input beside is g2²."""


def _value(tape: Tape, algebra: Algebra[Any], gamma: Values, beside: Values) -> tuple[Any, ...]:
    return (tape.evaluate(algebra, gamma),)


def _slope(tape: Tape, algebra: Algebra[Any], gamma: Values, beside: Values) -> tuple[Any, ...]:
    jets = FirstOrderJets(algebra, 1)
    seeds = [jets.seed(value, (rate,)) for value, rate in zip(gamma, beside, strict=True)]
    jet = tape.evaluate(jets, seeds)
    return jet.value, jets.gradient(jet)[0]


def _bend(tape: Tape, algebra: Algebra[Any], gamma: Values, beside: Values) -> tuple[Any, ...]:
    jets = SecondOrderJets(algebra, 1)
    seeds = [
        Jet(value, (rate,), (bend,))
        for value, rate, bend in zip(gamma, beside[::2], beside[1::2], strict=True)
    ]
    jet = tape.evaluate(jets, seeds)
    return jet.value, jets.gradient(jet)[0], jets.hessian(jet)[0][0]


VALUE = PlaneQuestion("value", 0, _value)
"""V."""
SLOPE = PlaneQuestion("slope", 3, _slope)
"""V and its derivative, from those of g1, g2 and g3."""
BEND = PlaneQuestion("bend", 6, _bend)
"""V and two derivatives, from the first and the second of g1, of g2 and of g3."""


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
    ``unit`` is that of a half that reaches a pole (:class:`Passage`), else 0; next to the pole g2 = ``pole``
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

    def expanded_N(self, v: acb) -> acb:
        """Return N on a wide ball, by Taylor's formula of order two about its centre."""
        centre = v.mid()
        middle = self.place(centre, analytic=False)
        bend = self.slope_and_curvature(self.place(v, analytic=True), analytic=True)[1]
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


def unit_at_poles(loop: Loop, tape: Tape) -> int:
    """Return the least n in which all powers of |sin v| in V and on the curve are whole powers.

    0 if n = 1 serves on both sides of a pole at once: V is a function of sin v there.
    """
    base, denominator = BallAlgebra(), loop.alpha.denominator
    number = base.constant(GENERIC_ROOT_OF_SINE)
    drop = PowerSum({(Fraction(2), 0): number})
    asked: set[Power] = set()
    for pole in (1, -1):
        algebra = PowerAlgebra(base, Small(number, denominator, 1))
        g1, g3 = algebra.loop(loop.G, loop.Z, loop.alpha, loop.g1_sign)
        g2 = algebra.subtract(algebra.constant(Fraction(1)), drop)
        g2 = g2 if pole > 0 else algebra.negate(g2)
        algebra.value(tape.evaluate(algebra, (g3, g2, g1) if loop.mirrored else (g1, g2, g3)))
        asked |= algebra.powers
    whole = Small(number, 1, 0)
    if denominator == 1 and all(whole.power_of_root(power) is not None for power in asked):
        return 0
    return lcm(denominator, *(exponent.denominator for exponent, _ in asked))


def drops_matter(tape: Tape) -> bool:
    """Say whether a formula may take a root or a logarithm of 1 − |g2|, which g2 does not tell well."""
    return any(
        made.operation == "general_power"
        or (made.operation == "call" and made.name == "log")
        or (made.operation == "power" and made.number is not None and made.number.denominator != 1)
        for made in tape.instructions
    )


@dataclass(frozen=True, slots=True)
class Passage:
    """One side of the pole v = πk."""

    curve: ComplexLoop
    """Its side is the sign of sin v here, and its unit n."""
    pole: int
    """k."""
    way: int
    """The sign of v − πk."""

    def place(self, phi: acb, *, analytic: bool) -> tuple[ComplexPlace, acb]:
        """Return the place at φ, and du/dφ; not finite if ``analytic`` and not holomorphic on the ball."""
        curve, loop = self.curve, self.curve.loop
        n, side = curve.unit, curve.side
        cosine, tangent = (phi / 2).cos(), (phi / 2).tan()
        below = _raised(tangent, n - 1)
        X = below * tangent
        square = X * X
        total = 1 + square
        slope = n * below / (cosine * cosine * total)
        root = tangent * ((2 / total).log(analytic) / n).exp()
        whole = loop.alpha * n
        quotient = (1 - _raised(root, 2 * whole.numerator)) / (1 - _raised(root, 2 * n))
        c_squared = loop.Z * loop.Z + loop.G * loop.G * quotient
        at = ComplexPlace(
            sine=side * 2 * X / total,
            cosine=(-1) ** self.pole * (1 - square) / total,
            power=_raised(root, whole.numerator - n),
            turn=acb(side),
            c_squared=c_squared,
            c=curve.root_of(c_squared, analytic),
            root=root,
        )
        return at, slope

    def angle(self, phi: acb) -> acb:
        """Return v at φ."""
        return acb.pi() * self.pole + self.way * 2 * _raised((phi / 2).tan(), self.curve.unit).atan()

    def log_sigma(self, phi: arb) -> arb:
        """Return log |sin v| at a real φ."""
        X = (phi / 2).tan() ** self.curve.unit
        return (2 * X / (1 + X * X)).log()

    def phase(self, v: arb) -> arb:
        """Return φ at a real v on this side; not finite elsewhere."""
        tangent = ((v - arb.pi() * self.pole) * self.way / 2).tan()
        return 2 * (tangent.log() / self.curve.unit).exp().atan() if tangent > 0 else arb.nan()


def _raised(base: acb, exponent: int) -> acb:
    """Return a whole power; by logarithms, which keep wide balls narrower, where their branch is certain."""
    return (exponent * base.log()).exp() if base.real > 0 else base**exponent
