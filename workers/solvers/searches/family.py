r"""A family of planar motions over numbers that are unknown, for complex ones in balls.

The numbers are λ, moments, and parameters of the potential. Periods, energies and precessions are analytic
in them as long as the ends of a window stay simple zeros. So a bound M of one of them on a polydisc bounds
its derivatives (Cauchy), and a few values prove what it does on a whole box.

On the loop of :mod:`service.dynamics.reduction.geometry.point` (primed axes, A > C)

.. math:: \frac{dt}{dv} = \frac{Z}{c\sqrt{W N}},\qquad N = h - V = \frac{Q D}{2 (A - C) g_1 g_3},

and between two simple zeros N = (v - v₋)(v₊ - v) K, where v = v₋ + (v₊ - v₋) sin²(θ/2) makes
dt/dθ = Z / (c √(W K)) analytic in θ and of period 2π.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from flint import acb, arb

from service.dynamics.formula.algebras.ball import ComplexBallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets, Jet, SecondOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.point import (
    CurvePlace,
    LoopNumbers,
    bends_of,
    gamma_of,
    rates_of,
    speed_factor,
)
from workers.solvers.complex_plane.complex_loop import MAX_WHOLE_ALPHA, geometric, tighter
from workers.solvers.errors import PrecisionNeededError

Slot = Fraction | int
"""A number that is given, or the place of the unknown that it is."""

NEWTON_TRIES = 24
EQUATOR_COSINE_SQUARED = 2.0**-6
ENERGY_V = 0.9
"""|v| of the place at which energies are taken."""
POINT_MAX_RADIUS = 2.0**-30
"""Radius of v below which it is a point, and N is known well enough."""
LAST_STEP_RELATIVE_LENGTH = 2.0**-40
WIDER, TINY = 1.25, 2.0**-200
"""A ball in which a zero is looked for is so much wider than what the last one suggests."""

UNKNOWN = acb(arb.nan())
ALGEBRA = ComplexBallAlgebra(analytic=True)
_JETS = FirstOrderJets(ALGEBRA, 1)
_BENDS = SecondOrderJets(ALGEBRA, 1)


@dataclass(frozen=True, slots=True)
class ProblemFamily:
    """Problems that differ in their unknown numbers; in the client's axes."""

    tape: Tape
    """The potential, of g1, g2, g3 and further variables."""
    extra: tuple[int, ...]
    """The unknown that each further variable is."""
    A: Slot
    C: Slot
    size: Slot
    """λ, or |nu| = λ²."""
    is_square: bool
    """``size`` is λ²."""
    mirrored: bool
    """A < C."""
    g1_sign: int
    """The sign of the primed g1."""


class FamilyCurve:
    """The curve at balls of the unknown numbers; ``side`` is the sign of sin v, 0 where poles are passed.

    Raises
    ------
    PrecisionNeededError
        The balls are too wide; or it is not analytic, since poles are passed and A/C is no even integer.
    """

    def __init__(self, family: ProblemFamily, numbers: Sequence[acb], side: int) -> None:
        self.family, self.numbers, self.side = family, tuple(numbers), side
        one, three = (family.C, family.A) if family.mirrored else (family.A, family.C)
        self.A, self.C = self._number(one), self._number(three)
        self.alpha = self.A / self.C
        self.exact_alpha = exact = None
        if isinstance(one, Fraction) and isinstance(three, Fraction):
            self.exact_alpha = exact = one / three
        is_whole = exact is not None and exact.denominator == 1 and exact <= MAX_WHOLE_ALPHA
        self._whole = int(exact or 0) if is_whole else 0
        if side == 0 and (not self._whole or self._whole % 2):
            raise PrecisionNeededError("a way through a pole")
        log = self._number(family.size).log(True) / (2 if family.is_square else 1)
        self._log = -log / self.alpha if family.mirrored else log
        self.Z, self.G, *self._slopes = self._equator(self._log)
        first, beyond = family.g1_sign * self.G, self.alpha - 1
        self._curve = LoopNumbers(first, self.Z, self.alpha, beyond, self.A, self.C, family.mirrored)
        self.parameters = tuple(self.numbers[k] for k in family.extra)

    def _number(self, slot: Slot) -> acb:
        return self.numbers[slot] if isinstance(slot, int) else ALGEBRA.constant(slot)

    def _equator(self, log_lambda: acb) -> tuple[acb, acb, acb, acb]:
        """Return Z, G, and the derivatives of log Z by log λ and by α, from Z² + (Z/λ)^{2α} = 1."""
        a, middle, log = self.alpha.mid(), log_lambda.mid(), log_lambda

        def excess(u: acb) -> acb:
            return (2 * u).exp() + (2 * a * (u - middle)).exp() - 1

        def rise(u: acb) -> acb:
            return 2 * (2 * u).exp() + 2 * a * (2 * a * (u - middle)).exp()

        def slopes(u: acb) -> tuple[acb, acb]:
            by_log = inverse(1 + ((2 - 2 * self.alpha) * u + 2 * self.alpha * log).exp() / self.alpha)
            return by_log, (log - u) / self.alpha * by_log

        start = near_zero(excess, rise, middle if middle.real < 0 else acb(0))
        u = found = enclosed_zero(excess, rise, start)
        # On the way from the middle to any other numbers log Z stays in a ball that the slopes keep it in.
        for _ in range(NEWTON_TRIES):
            by_log, by_alpha = slopes(u)
            moved = found + by_log * (log - middle) + by_alpha * (self.alpha - a)
            if u.contains(moved):
                Z = moved.exp()
                return Z, root(1 - Z * Z), by_log, by_alpha
            u = wider(moved)
            if not u.is_finite():
                break
        raise PrecisionNeededError("a curve")

    def place(self, v: acb) -> CurvePlace[acb]:
        """Return a place; not finite where the curve is not analytic on the ball."""
        sine, cosine = v.sin_cos()
        size = sine if self.side >= 0 else -sine
        square, u = sine * sine, cosine * cosine
        if self._whole:
            power, quotient = size ** (self._whole - 1), geometric(square, self._whole)
        else:
            log = size.log(True)
            power, quotient = ((self.alpha - 1) * log).exp(), self._quotient(log, u)
        c = root(self.Z * self.Z + self.G * self.G * quotient)
        return CurvePlace(sine, cosine, power, acb(self.side or 1), c)

    def _quotient(self, log: acb, u: acb) -> acb:
        """Return (1 − |sin v|^{2α}) / cos²v, which is an average of α (1 − su)^{α−1}."""
        direct = -(2 * self.alpha * log).expm1() / u
        if not u.abs_lower() < EQUATOR_COSINE_SQUARED:
            return direct
        hull = acb(1).union(1 - u)
        return tighter(direct, self.alpha * ((self.alpha - 1) * hull.log(True)).exp())

    @cached_property
    def h(self) -> acb:
        """The energy: the value of V + N at a place that is neither a pole nor the equator."""
        middle = self if self._middle is None else self._middle
        at = middle.place(self._quiet)
        g1, g2, g3 = gamma_of(middle._curve, at)
        seeds = [_JETS.seed(g1, (-g3,)), _JETS.seed(g2, (None,)), _JETS.seed(g3, (g1,))]
        beside = [_JETS.seed(value, (None,)) for value in middle.parameters]
        V = self.family.tape.evaluate(_JETS, (*seeds, *beside))
        A, C = (middle.C, middle.A) if self.family.mirrored else (middle.A, middle.C)
        (D,) = _JETS.gradient(V)
        h = V.value + (A * g1 * g1 + C * g3 * g3) * D / (2 * (A - C) * g1 * g3)
        return h if self._middle is None else self._moved(h, self._energy_slopes)

    def N(self, v: acb, at: CurvePlace[acb] | None = None) -> acb:
        """Return h − V; about the middle of the numbers, if these are wide."""
        at = self.place(v) if at is None else at
        plain = self.h - self.family.tape.evaluate(ALGEBRA, (*gamma_of(self._curve, at), *self.parameters))
        if self._middle is None:
            return plain
        jets, beside = self._jets, [self._numbers[k] for k in self.family.extra]
        V = self.family.tape.evaluate(jets, (*self._gamma_jets(v), *beside))
        slopes = [h - V for h, V in zip(self._energy_slopes, jets.gradient(V), strict=True)]
        return tighter(plain, self._moved(self._middle.N(v), slopes))

    def _moved(self, value: acb, slopes: Sequence[acb]) -> acb:
        for slope, number in zip(slopes, self.numbers, strict=True):
            value += slope * (number - number.mid())
        return value

    @cached_property
    def _middle(self) -> "FamilyCurve | None":
        """The curve at the middle of the numbers; None if they are points."""
        if all(number.rad() < POINT_MAX_RADIUS for number in self.numbers):
            return None
        return FamilyCurve(self.family, [number.mid() for number in self.numbers], self.side)

    @property
    def _quiet(self) -> acb:
        return acb(ENERGY_V if self.side >= 0 else -ENERGY_V)

    @cached_property
    def _energy_slopes(self) -> Sequence[acb]:
        """The derivatives of the energy by the numbers."""
        jets = self._jets
        g1, g2, g3 = self._gamma_jets(self._quiet)
        turned = FirstOrderJets(jets, 1)
        inputs = [turned.seed(g1, (jets.negate(g3),)), turned.seed(g2, (None,)), turned.seed(g3, (g1,))]
        beside = [turned.seed(self._numbers[k], (None,)) for k in self.family.extra]
        V = self.family.tape.evaluate(turned, (*inputs, *beside))
        (D,) = turned.gradient(V)
        A, C = (self._slot_jet(slot) for slot in (self.family.A, self.family.C))
        Q = jets.add(jets.multiply(A, jets.multiply(g1, g1)), jets.multiply(C, jets.multiply(g3, g3)))
        twice = jets.multiply(jets.constant(Fraction(2)), jets.subtract(A, C))
        below = jets.multiply(twice, jets.multiply(g1, g3))
        return jets.gradient(jets.add(V.value, jets.divide(jets.multiply(Q, D), below)))

    @cached_property
    def _jets(self) -> FirstOrderJets[acb]:
        return FirstOrderJets(ALGEBRA, len(self.numbers))

    @cached_property
    def _numbers(self) -> tuple[Jet[acb], ...]:
        return self._jets.variables(self.numbers)

    def _slot_jet(self, slot: Slot) -> Jet[acb]:
        return self._numbers[slot] if isinstance(slot, int) else self._jets.constant(slot)

    @cached_property
    def _curve_jets(self) -> tuple[Jet[acb], Jet[acb], Jet[acb]]:
        """α, Z and G with their derivatives by the numbers."""
        family, jets = self.family, self._jets
        log = jets.call("log", self._slot_jet(family.size))
        if family.is_square:
            log = jets.multiply(jets.constant(Fraction(1, 2)), log)
        one, three = (family.C, family.A) if family.mirrored else (family.A, family.C)
        alpha = jets.divide(self._slot_jet(one), self._slot_jet(three))
        if family.mirrored:
            log = jets.negate(jets.divide(log, alpha))
        by_log, by_alpha = self._slopes
        rates = [
            by_log * x + by_alpha * y for x, y in zip(jets.gradient(log), jets.gradient(alpha), strict=True)
        ]
        Z = jets.seed(self.Z, [self.Z * rate for rate in rates])
        return alpha, Z, jets.seed(self.G, [-self.Z * self.Z / self.G * rate for rate in rates])

    def _gamma_jets(self, v: acb) -> tuple[Jet[acb], Jet[acb], Jet[acb]]:
        """Return g1, g2, g3 with their derivatives by the numbers, at a place that stays.

        It is :func:`.point.gamma_of` over jets, in which Z, G, α and c depend on the numbers.
        """
        jets, none = self._jets, [None] * len(self.numbers)
        alpha, Z, G = self._curve_jets
        sine, cosine = v.sin_cos()
        square = cosine * cosine
        if self._whole:
            power = jets.seed(((self.side or 1) * sine) ** self._whole, none)
            quotient = jets.seed(geometric(sine * sine, self._whole), none)
        else:
            power = jets.call("exp", jets.multiply(alpha, jets.seed((self.side * sine).log(True), none)))
            left = jets.subtract(jets.constant(Fraction(1)), jets.multiply(power, power))
            quotient = jets.divide(left, jets.seed(square, none))
        c_squared = jets.add(jets.multiply(Z, Z), jets.multiply(jets.multiply(G, G), quotient))
        half_log = jets.multiply(jets.constant(Fraction(1, 2)), jets.call("log", c_squared))
        first = jets.multiply(jets.seed(acb(self.family.g1_sign), none), jets.multiply(G, power))
        second = jets.multiply(jets.call("exp", half_log), jets.seed(cosine, none))
        third = jets.multiply(Z, jets.seed(sine, none))
        return (third, second, first) if self.family.mirrored else (first, second, third)

    def W(self, at: CurvePlace[acb]) -> acb:
        """Return p² / N."""
        return speed_factor(self._curve, at.power)

    def _beside(self, jets: FirstOrderJets[acb]) -> list[Jet[acb]]:
        return [jets.seed(value, (None,)) for value in self.parameters]

    def slope(self, v: acb) -> acb:
        """Return dN/dv."""
        found = self._slope(v)
        if v.rad() < POINT_MAX_RADIUS:
            return found
        middle = v.mid()
        return tighter(found, self._slope(middle) + self.bend(v) * (v - middle))

    def _slope(self, v: acb) -> acb:
        at = self.place(v)
        gamma, rates = gamma_of(self._curve, at), rates_of(self._curve, at)
        seeds = [_JETS.seed(value, (rate,)) for value, rate in zip(gamma, rates, strict=True)]
        found = self.family.tape.evaluate(_JETS, (*seeds, *self._beside(_JETS)))
        return -_JETS.gradient(found)[0] if found.value.is_finite() else UNKNOWN

    def bend(self, v: acb) -> acb:
        """Return d²N/dv²: rough, for wide balls."""
        at = self.place(v)
        hull = acb(1).union(at.sine * at.sine)
        if self._whole:
            below = at.turn * (at.turn * at.sine) ** (self._whole - 2)
            mean = hull ** (self._whole - 2)
        else:
            below, mean = at.power / at.sine, ((self.alpha - 2) * hull.log(True)).exp()
        bends = bends_of(self._curve, at, below, mean)
        places = zip(gamma_of(self._curve, at), rates_of(self._curve, at), bends, strict=True)
        seeds = [Jet(value, (rate,), (bend,)) for value, rate, bend in places]
        found = self.family.tape.evaluate(_BENDS, (*seeds, *self._beside(_BENDS)))
        return -_BENDS.hessian(found)[0][0] if found.value.is_finite() else UNKNOWN


def near_zero(value: Callable[[acb], acb], slope: Callable[[acb], acb], start: acb) -> acb:
    """Return about where ``value`` is 0, by Newton's method from ``start``."""
    at = start.mid()
    for _ in range(NEWTON_TRIES):
        step = (value(at) / slope(at)).mid()
        if not step.is_finite():
            break
        at = (at - step).mid()
        if step.abs_upper() < LAST_STEP_RELATIVE_LENGTH * (1 + at.abs_upper()):
            break
    return at


def enclosed_zero(value: Callable[[acb], acb], slope: Callable[[acb], acb], start: acb) -> acb:
    """Return the enclosure of the zero next to the point ``start``, for all numbers in balls.

    By the interval Newton method: there is one, and no other in the ball that it was proved with.

    Raises
    ------
    PrecisionNeededError
        Nothing is proved.
    """
    residual, guess = value(start), start
    for _ in range(NEWTON_TRIES):
        found = start - residual / slope(guess)
        if not found.is_finite():
            break
        if guess.contains(found):
            return found
        guess = wider(found.union(start))
    raise PrecisionNeededError("a zero")


def wider(value: acb) -> acb:
    """Return a ball that is somewhat larger."""
    parts = (arb(each.mid(), (each.rad() * WIDER + TINY).upper()) for each in (value.real, value.imag))
    return acb(*parts)


def inverse(value: acb) -> acb:
    """Return 1/value, not finite on the cut of the logarithm, by which wide balls of it are narrower."""
    return (-value.log(True)).exp()


def reciprocal_root(value: acb) -> acb:
    """Return 1/√value in the same way."""
    return (-value.log(True) / 2).exp()


def root(value: acb) -> acb:
    """Return √value, not finite on its cut; by the logarithm, since balls of it are far narrower."""
    return (value.log(True) / 2).exp()
