r"""Bounds of (dθ/dt)² along a libration, a rotation and a flight, for one formula of the potential.

Regions are chains of rectangles that are symmetric about the real axis. On complex v it is c² P that is
bounded, and proved to be holomorphic; P is C g3 D / ((A − C) A g1), as the solver has it. Next to a turning
point P and the divisor vanish together, and about a pole that is passed with a finite P so do D g3 and the
power of sin v that g1 is; by the maximum principle

.. math:: \sup_R \Bigl|\frac{f}{g}\Bigr| \le \frac{\sup_R |f|}{\min_{\partial R} |g|}

if f/g is holomorphic on R: the divisors are elementary, and their least values on the border are known. A
rectangle with a pole near its border is left to W N, from the energy
(:mod:`workers.solvers.complex_plane.complex_loop`): the same for a potential that is admissible on the curve.
By Taylor's formula that is closer on small rectangles next to the zeros of P, too.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Generic, TypeVar  # Any: a question is answered in every algebra

from flint import acb, arb

from service.dynamics.formula.algebra import Algebra
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import LoopNumbers, speed_factor
from workers.solvers.complex_plane.complex_loop import (
    ComplexLoop,
    ComplexPlace,
    PlaneQuestion,
    Values,
    drops_matter,
)
from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.quadrature.flight import Flight

T = TypeVar("T")
Place = TypeVar("Place", arb, acb)
UNKNOWN = arb.nan()
POLE_MIN_COS_V = 0.9
"""|cos v| beyond which the drop 1 − |g2| is a small number."""


def border(chain: Sequence[acb]) -> tuple[arb, arb, arb]:
    """Return the real parts of the outer vertical sides and the least height."""
    heights = [part.imag.rad() for part in chain]
    return chain[0].real.lower(), chain[-1].real.upper(), min(heights)


def least_sine_squared(chain: Sequence[acb]) -> arb:
    """Return a lower bound of |sin θ|² on the border, or everywhere if it has no zero inside.

    It is sin² x + sinh² y, and between two zeros sin² x is least at an end.
    """
    left, right, height = border(chain)
    ends = (left.sin() ** 2).min(right.sin() ** 2)
    is_between = (right - left < arb.pi()) and (left / arb.pi()).floor() == (right / arb.pi()).floor()
    return (ends if is_between else ends.min(height.sinh() ** 2)).lower()


@dataclass(frozen=True, slots=True)
class ComplexRadicand:
    """c² P on symmetric rectangles of complex v."""

    northern: ComplexLoop
    """For sin v > 0."""
    southern: ComplexLoop
    """For sin v < 0."""
    both: ComplexLoop
    """For rectangles that hold a pole."""
    passed: frozenset[int] | None
    """The poles v/π at which P is known to be finite, since the motion passes them; None if all."""
    near: Mapping[tuple[int, int], ComplexLoop]
    """Next to a pole, by the signs of sin v and cos v; none where formulas do as they are."""

    @property
    def loop(self) -> Loop:
        """Return the real loop."""
        return self.both.loop

    def bound(self, v: acb, *, is_close: bool) -> arb:
        """Return an upper bound of |c² P|; not finite unless it is holomorphic on the rectangle."""
        curve = self._curve(v)
        if curve is None:
            return UNKNOWN
        loop, at = curve.loop, curve.place(v, analytic=True)
        if is_close:
            return abs(at.c_squared * curve.W(at) * curve.expanded_N(v)).upper()
        found = abs(at.c_squared * _turned(curve, at)) * abs(ball(loop.factor)) * loop.Z / loop.G
        if curve.side:
            return (found / abs(at.power)).upper()
        divided = (found / least_sine_squared([v]).sqrt() ** (loop.alpha.numerator - 1)).upper()
        from_energy = abs(at.c_squared * curve.W(at) * curve.N(at, analytic=True)).upper()
        if not (divided.is_finite() and from_energy.is_finite()):
            return divided if divided.is_finite() else from_energy
        return divided.min(from_energy)

    def enclosed(self, v: arb) -> arb:
        """Return an enclosure of c² P on a real stretch that the motion passes, poles included."""
        loop = self.loop
        sine, cosine = v.sin_cos()
        if not (sine.contains(0) or cosine.contains(0)):
            at = loop.point_from(sine, cosine)
            return at.c * at.c * at.P
        if not sine.contains(0):
            return UNKNOWN
        A, C, G, Z = ball(loop.A), ball(loop.C), loop.G, loop.Z
        size, alpha = abs(sine).upper(), ball(loop.alpha)
        power, first, square = (arb(0).union(size**exponent) for exponent in (alpha - 1, alpha, 2 * alpha))
        c_squared = Z * Z + G * G * (1 - square) / (cosine * cosine)
        curve = LoopNumbers(loop.g1_sign * G, Z, alpha, alpha - 1, A, C, loop.mirrored)
        # Not by its sine: g1 keeps its sign at the pole, which a product of balls about 0 does not tell.
        g1, g2, g3 = curve.first * first, c_squared.sqrt() * cosine, Z * sine
        gamma = (g3, g2, g1) if loop.mirrored else (g1, g2, g3)
        N = self.both.h - self.both.tape.evaluate(_WhereDefined(), gamma)
        return c_squared * speed_factor(curve, power) * N

    def limit(self, v: arb) -> arb:
        """Return c² P at a pole or on the equator; not finite if the formula has no value there."""
        curve = self._curve(acb(v))
        if curve is None:
            return UNKNOWN
        at = curve.place(acb(v), analytic=False)
        return (at.c_squared * curve.W(at) * curve.N(at, analytic=False)).real

    def slope(self, v: arb) -> arb:
        """Return c² |dP/dv| at a zero of P."""
        curve = self._curve(acb(v))
        if curve is None:
            return UNKNOWN
        at = curve.place(acb(v), analytic=False)
        return abs((at.c_squared * curve.W(at) * curve.slope(at, analytic=False)).real)

    def gamma(self, v: arb) -> tuple[arb, arb, arb] | None:
        """Return an enclosure of g1, g2, g3 in the client's axes on a real stretch; None if there is none."""
        curve = self._curve(acb(v))
        if curve is None:
            return None
        g1, g2, g3 = (value.real for value in curve.gamma(curve.place(acb(v), analytic=False)))
        return g1, g2, g3

    def _curve(self, v: acb) -> ComplexLoop | None:
        sine, cosine = (value.real for value in v.sin_cos())
        side = 1 if sine > 0 else -1 if sine < 0 else 0
        if self.near and cosine.abs_lower() > POLE_MIN_COS_V:
            return self.near.get((side, 1 if cosine > 0 else -1))
        if side:
            return self.northern if side > 0 else self.southern
        pole = v.real / arb.pi()
        is_one = self.passed is None or pole.unique_fmpz() in self.passed
        return self.both if is_one and self.loop.alpha.denominator == 1 else None


def has_no_point(v: arb) -> bool:
    """Say whether v is a pole or the equator, where the real loop gives no point."""
    sine, cosine = v.sin_cos()
    return bool(sine.contains(0) or cosine.contains(0))


def complex_radicand(loop: Loop, tape: Tape, h: arb, passed: frozenset[int] | None) -> ComplexRadicand:
    """Return c² P of the loop with the potential's ``tape`` and the energy ``h``."""
    northern, southern, both = (ComplexLoop(loop, tape, h, side) for side in (1, -1, 0))
    near = {}
    if drops_matter(tape):
        near = {(s, pole): ComplexLoop(loop, tape, h, s, 1, pole) for s in (1, -1) for pole in (1, -1)}
    return ComplexRadicand(northern, southern, both, passed, near)


def _turned(curve: ComplexLoop, at: ComplexPlace) -> acb:
    """Return D = g1 V_3 − g3 V_1 in the client's axes; not finite unless it is holomorphic, and V too."""
    value, D = curve.ask(_TURN, at, (at.c_squared * at.cosine * at.cosine,), analytic=True)
    # The derivative of what jumps is 0 on either side.
    return D if value.is_finite() else acb(UNKNOWN)


def _turn(tape: Tape, algebra: Algebra[Any], gamma: Values, beside: Values) -> tuple[Any, ...]:
    (g1, g2, g3), (square,) = gamma, beside
    even: _EvenAlgebra[Any] = _EvenAlgebra(algebra, g2, square)
    jets = FirstOrderJets(even, 1)
    seeds = (jets.seed(g1, (even.negate(g3),)), jets.seed(g2, (None,)), jets.seed(g3, (g1,)))
    jet = tape.evaluate(jets, seeds)
    return jet.value, jets.gradient(jet)[0]


_TURN = PlaneQuestion("turn", 1, _turn, is_squared=True)
"""V and D, from g2² beside."""


class _WhereDefined(BallAlgebra):
    """Balls of values along a way on which the formula is defined: what is under a root is not negative."""

    def power(self, base: arb, exponent: Fraction) -> arb:
        """Return base^exponent."""
        if exponent.denominator == 1 or exponent < 0 or not base.contains(0):
            return super().power(base, exponent)
        return arb(0).union(super().power(base.upper(), exponent))


class _EvenAlgebra(Generic[T]):
    """The algebra ``base`` where g2² is known: it is holomorphic where g2 is not, or is not seen to be."""

    def __init__(self, base: Algebra[T], g2: T, square: T) -> None:
        self._base, self._g2, self._square = base, g2, square
        self.constant, self.pi, self.negate = base.constant, base.pi, base.negate
        self.add, self.subtract, self.divide = base.add, base.subtract, base.divide
        self.general_power, self.call = base.general_power, base.call

    def multiply(self, left: T, right: T) -> T:
        """Return left · right."""
        return self._square if left is self._g2 and right is left else self._base.multiply(left, right)

    def power(self, base: T, exponent: Fraction) -> T:
        """Return base^exponent."""
        if base is self._g2 and exponent.denominator == 1 and exponent.numerator % 2 == 0:
            half = exponent / 2
            return self._square if half == 1 else self._base.power(self._square, half)
        return self._base.power(base, exponent)


@dataclass(frozen=True, slots=True)
class LibrationSpeed:
    """c² K / Z², K = P / (h² sin²θ)."""

    orbit: Libration
    radicand: ComplexRadicand

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """See PhaseSpeed.bound."""
        largest = _largest(self.radicand.bound(self.place(theta), is_close=is_close) for theta in chain)
        return largest / (self._factor * least_sine_squared(chain))

    def enclosed(self, theta: arb) -> arb:
        """See PhaseSpeed.enclosed."""
        return self.radicand.enclosed(self.place(theta)) / (self._factor * theta.sin() ** 2)

    def limit(self, theta: arb) -> arb | None:
        """See PhaseSpeed.limit."""
        v, loop = self.place(theta), self.orbit.loop
        if (theta / arb.pi()).contains_integer():
            return loop.Z * ((self.orbit.upper - self.orbit.lower) / self.radicand.slope(v)).sqrt()
        if not has_no_point(v):
            return None
        return (self._factor / self.radicand.limit(v)).sqrt() * abs(theta.sin())

    @property
    def _factor(self) -> arb:
        return ((self.orbit.upper - self.orbit.lower) / 2 * self.orbit.loop.Z) ** 2

    def place(self, theta: Place) -> Place:
        """Return v, from the nearer turning point: balls there are far smaller than those of θ."""
        sine, cosine = (theta / 2).sin_cos()
        width = self.orbit.upper - self.orbit.lower
        if abs(sine).mid() < abs(cosine).mid():
            return self.orbit.lower + width * sine * sine
        return self.orbit.upper - width * cosine * cosine


@dataclass(frozen=True, slots=True)
class RotationSpeed:
    """c² P / Z²."""

    orbit: Rotation
    radicand: ComplexRadicand

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """See PhaseSpeed.bound."""
        largest = _largest(self.radicand.bound(self.place(theta), is_close=is_close) for theta in chain)
        return largest / self.orbit.loop.Z**2

    def enclosed(self, theta: arb) -> arb:
        """See PhaseSpeed.enclosed."""
        return self.radicand.enclosed(self.place(theta)) / self.orbit.loop.Z**2

    def limit(self, theta: arb) -> arb | None:
        """See PhaseSpeed.limit."""
        v = self.place(theta)
        return self.orbit.loop.Z * self.radicand.limit(v).rsqrt() if has_no_point(v) else None

    def place(self, theta: Place) -> Place:
        """Return v."""
        return self.orbit.origin + self.orbit.direction * theta


@dataclass(frozen=True, slots=True)
class FlightSpeed:
    """16 c² P cosh⁴(y/2) / (Z L)²; with a rest point c² P cosh⁶(y/2) / (Z L sinh(y/2))²."""

    flight: Flight
    radicand: ComplexRadicand

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        """See PhaseSpeed.bound."""
        phases = [self._phase(theta) for theta in chain]
        largest = _largest(self._share(y, is_close=is_close) for y in phases)
        return largest / (
            self._divisor * _least_sinh_squared(phases) if self.flight.has_rest else self._divisor
        )

    def enclosed(self, theta: arb) -> arb:
        """See PhaseSpeed.enclosed."""
        y = self._phase(theta)
        found = self.radicand.enclosed(self._place(y)) * self._power(y)
        return found / (self._divisor * (y / 2).sinh() ** 2 if self.flight.has_rest else self._divisor)

    def limit(self, theta: arb) -> arb | None:
        """See PhaseSpeed.limit."""
        y = self._phase(theta)
        v = self._place(y)
        if self.flight.has_rest and y.contains(0):
            length = self.flight.arc.upper - self.flight.arc.lower
            return self.flight.loop.Z * self._scale * (length / self.radicand.slope(v)).sqrt()
        if not has_no_point(v):
            return None
        squared = self.radicand.limit(v) * self._power(y) / self._divisor
        return (squared / (y / 2).sinh() ** 2 if self.flight.has_rest else squared).rsqrt()

    def _share(self, y: acb, *, is_close: bool) -> arb:
        return self.radicand.bound(self._place(y), is_close=is_close) * abs(self._power(y))

    @property
    def _scale(self) -> arb:
        return (arb(self.flight.last) - arb(self.flight.first)) / (2 * arb.pi())

    @property
    def _divisor(self) -> arb:
        length = self.flight.arc.upper - self.flight.arc.lower
        return (self.flight.loop.Z * length * self._scale) ** 2

    def _phase(self, theta: Place) -> Place:
        return self.flight.first + self._scale * theta

    def _power(self, y: Place) -> Place:
        return (y / 2).cosh() ** 6 if self.flight.has_rest else 16 * (y / 2).cosh() ** 4

    def place(self, theta: arb) -> arb:
        """Return v."""
        return self._place(self._phase(theta))

    def _place(self, y: Place) -> Place:
        """Return v, from the nearer end of the arc."""
        flight = self.flight
        if flight.has_rest:
            # 1/cosh² and tanh² of y/2: by one exponential, whose balls are close.
            decay = (-y if y.real > 0 else y).exp() if isinstance(y, acb) else (-abs(y)).exp()
            left, gone = 4 * decay / (1 + decay) ** 2, ((1 - decay) / (1 + decay)) ** 2
            above, below = (gone, left) if flight.direction > 0 else (left, gone)
        else:
            share = (flight.direction * y).exp()
            above, below = 1 / (1 + 1 / share), 1 / (1 + share)
        lower, length = flight.arc.lower, flight.arc.upper - flight.arc.lower
        is_low = abs(above.mid()) < abs(below.mid())
        return lower + length * above if is_low else flight.arc.upper - length * below


Speed = LibrationSpeed | RotationSpeed | FlightSpeed
"""The bounds along an orbit or a flight for one formula, each a :class:`.panel.PhaseSpeed`."""


def _largest(bounds: Iterable[arb]) -> arb:
    """Return the largest; not finite if one of them is not, and the others are not asked."""
    largest = arb(0)
    for found in bounds:
        if not found.is_finite():
            return UNKNOWN
        largest = largest.max(found)
    return largest


def _least_sinh_squared(chain: Sequence[acb]) -> arb:
    """Return a lower bound of |sinh(y/2)|² on the border, or everywhere if it has no zero inside.

    It is sinh² + sin² of the halves of the real and the imaginary part, the latter below π/2.
    """
    left, right, height = (value / 2 for value in border(chain))
    ends = (left.sinh() ** 2).min(right.sinh() ** 2)
    if left > 0 or right < 0:
        return ends.lower()
    if not all(part.imag.rad() < arb.pi() for part in chain):
        return UNKNOWN
    return ends.min(height.sin() ** 2).lower()
