r"""Bounds c² P on rectangles of complex v, and proves that it is holomorphic there.

P is C g3 D / ((A − C) A g1), as the solver has it. About a pole, which the motion passes with a finite
P, D g3 is divided by the power of sin v that g1 is: both vanish there, and by the maximum principle

.. math:: \sup_R \Bigl|\frac{f}{g}\Bigr| \le \frac{\sup_R |f|}{\min_{\partial R} |g|}

if f/g is holomorphic on R; the least value of |sin v| on the border is known. A rectangle with a pole near
its border is left to W N, from the energy (:mod:`workers.solvers.complex_plane.complex_loop`): the same for a
potential that is admissible on the curve. By Taylor's formula that is closer on small rectangles next to the
zeros of P, too.
"""

from collections.abc import Mapping, Sequence
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
from workers.solvers.complex_plane.complex_loop import ComplexLoop, ComplexPlace
from workers.solvers.complex_plane.passage import drops_matter
from workers.solvers.complex_plane.questions import PlaneQuestion, Values

T = TypeVar("T")
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
            return abs(at.c_squared * curve.W(at) * curve.expanded_N(v, analytic=True)).upper()
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
