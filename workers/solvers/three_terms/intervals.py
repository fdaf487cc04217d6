r"""Finds the intervals of x = |g1| that motions in a potential of three terms fill.

With nu = g3²/|g1| > 0 and a1 standing for a1 sign(g1),

.. math::

    \dot x^2 = \frac{2}{C}\,(x_1 - x)(x - x_2)(-P), \quad
    P = \frac{2 b_1}{\nu^2} + a_1 x + 2 c_1 x^2,

where x1 > 0 > x2 = −1/x1 are the roots of 1 − nu x − x², x1 being the equator.
All functions work at the current precision.
Motions of x are where the function on the right is positive, between its zeros.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Literal

from flint import arb

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.recognition import ThreeTerms


class RootsUndecidedError(DynamicsError):
    """The precision does not suffice, or two of the roots coincide (a separatrix, an equilibrium)."""

    code = "undecided_roots"


@dataclass(frozen=True, slots=True)
class Between:
    """lo ≤ x ≤ hi with a positive function inside."""

    lo: arb
    hi: arb
    low_is_root: bool
    """Else lo = 0, the pole."""
    high_is_root: bool
    """Else hi is the equator."""


def positive_stretches(
    roots: Sequence[arb], equator: arb, function: Callable[[arb], arb]
) -> tuple[Between, ...]:
    """Return all stretches of 0 ≤ x ≤ ``equator`` on which ``function`` is positive, by growing x.

    ``roots`` are all its simple real zeros but 0, in any order.

    Raises
    ------
    RootsUndecidedError
        Two of 0, the roots and the equator cannot be told apart, or a sign between them is not certain.
    """
    # As balls: doubles may not tell two roots apart.
    inner = sorted((root for root in roots if _is_inside(root, equator)), key=arb.mid)
    if any(not one < other for one, other in pairwise(inner)):
        raise RootsUndecidedError("two roots cannot be told apart")
    edges = [arb(0), *inner, equator]
    found = []
    for index, (lo, hi) in enumerate(pairwise(edges)):
        value = function(((lo + hi) / 2).mid())
        if not (value > 0 or value < 0):
            raise RootsUndecidedError("the sign between two roots")
        if value > 0:
            found.append(Between(lo, hi, index > 0, index < len(edges) - 2))
    return tuple(found)


def _is_inside(root: arb, equator: arb) -> bool:
    if root > 0 and root < equator:
        return True
    if root < 0 or root > equator:
        return False
    raise RootsUndecidedError("a root is at the pole or at the equator")


LowEnd = Literal["pole", "rest", "collision"]
HighEnd = Literal["equator", "rest"]


@dataclass(frozen=True, slots=True)
class ThreeTermCurve:
    """A curve g3² = nu |g1| of a body with this C, in a potential of three terms."""

    terms: ThreeTerms
    """With a1 changed in sign where g1 < 0."""
    C: Fraction
    nu: arb
    x1: arb

    @property
    def x2(self) -> arb:
        """Return the negative root of 1 − nu x − x²."""
        return -1 / self.x1

    @property
    def factor(self) -> arb:
        """Return 2/C."""
        return 2 / ball(self.C)

    @property
    def constant(self) -> arb:
        """Return P(0)."""
        return 2 * ball(self.terms.b1) / (self.nu * self.nu)

    @property
    def linear(self) -> arb:
        """Return P'(0)."""
        return ball(self.terms.a1)

    @property
    def quadratic(self) -> arb:
        """Return P''/2."""
        return ball(2 * self.terms.c1)

    @property
    def energy(self) -> arb:
        """Return the energy h of every motion on the curve."""
        return ball(self.terms.constant - self.terms.c1) - self.linear * self.nu / 2 - self.constant

    @property
    def discriminant(self) -> arb:
        """Return the discriminant of P."""
        return self.linear * self.linear - 4 * self.quadratic * self.constant

    def P(self, x: arb) -> arb:
        """Return P(x): motion is where it is negative."""
        return self.constant + (self.linear + self.quadratic * x) * x

    def roots(self) -> tuple[arb, ...]:
        """Return the real roots of P other than 0, without cancellation; raises RootsUndecidedError."""
        a1, b1, c1 = self.terms.a1, self.terms.b1, self.terms.c1
        if c1 == 0:
            return () if a1 == 0 or b1 == 0 else (-self.constant / self.linear,)
        if b1 == 0:
            return () if a1 == 0 else (-self.linear / self.quadratic,)
        discriminant = self.discriminant
        if discriminant < 0:
            return ()
        if not discriminant > 0:
            raise RootsUndecidedError("the roots of P are real or complex")
        larger = -(self.linear + (1 if a1 >= 0 else -1) * discriminant.sqrt()) / 2
        return larger / self.quadratic, self.constant / larger


@dataclass(frozen=True, slots=True)
class MotionInterval:
    """lo ≤ x ≤ hi with P < 0 inside."""

    curve: ThreeTermCurve
    lo: arb
    hi: arb
    lo_end: LowEnd
    hi_end: HighEnd

    @property
    def is_periodic(self) -> bool:
        """Say whether the motion comes back: no collision, no pole reached in infinite time."""
        return self.lo_end == "rest" or (self.lo_end == "pole" and self.curve.terms.a1 != 0)

    @property
    def trips(self) -> int:
        """Return how often g1 goes to and fro in one period of all six variables."""
        return 1 if (self.lo_end, self.hi_end) == ("rest", "rest") else 2

    def linear_factors(self) -> tuple[tuple[arb, arb], tuple[arb, arb]]:
        """Return L1 and L2, each at lo and at hi, of a periodic motion: x'² = (2/C) (x − lo)(hi − x) L1 L2.

        L1 is −P/(x − lo) if hi is the equator and 2 c1 (x1 − x) if it is a
        rest point; L2 is x − x2.
        """
        curve, lo, hi = self.curve, self.lo, self.hi
        if self.hi_end == "equator":
            constant = -(curve.linear + curve.quadratic * lo)
            first = constant - curve.quadratic * lo, constant - curve.quadratic * hi
        else:
            first = curve.quadratic * (curve.x1 - lo), curve.quadratic * (curve.x1 - hi)
        return first, (lo - curve.x2, hi - curve.x2)


def make_curve(terms: ThreeTerms, C: Fraction, nu: arb, g1_sign: int) -> ThreeTermCurve:
    """Return the curve with nu = g3²/|g1| > 0 on the side of this sign of g1."""
    signed = ThreeTerms(g1_sign * terms.a1, terms.b1, terms.c1, terms.constant)
    return ThreeTermCurve(signed, C, nu, 2 / (nu + (nu * nu + 4).sqrt()))


def intervals(curve: ThreeTermCurve) -> tuple[MotionInterval, ...]:
    """Return all intervals in the order of growing x, periodic or not.

    Raises
    ------
    RootsUndecidedError
        Two of 0, the roots of P and x1 cannot be told apart.
    """
    return tuple(
        MotionInterval(
            curve,
            at.lo,
            at.hi,
            "rest" if at.low_is_root else ("collision" if curve.terms.b1 else "pole"),
            "rest" if at.high_is_root else "equator",
        )
        for at in positive_stretches(curve.roots(), curve.x1, lambda x: -curve.P(x))
    )
