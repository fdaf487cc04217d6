r"""Motions in a potential of three terms: the intervals of x = |g1| that they fill, phase and variables.

With nu = g3²/|g1| > 0 and a1 standing for a1 sign(g1),

.. math::

    \dot x^2 = \frac{2}{C}\,(x_1 - x)(x - x_2)(-P), \quad
    P = \frac{2 b_1}{\nu^2} + a_1 x + 2 c_1 x^2,

where x1 > 0 > x2 = −1/x1 are the roots of 1 − nu x − x², x1 being the equator.
All functions work at the current precision.
Motions of x are where the function on the right is positive, between its zeros.

In the phase θ the motions are elliptic functions. On an interval lo ≤ x ≤ hi with x = lo cos²v + hi sin²v the
phase grows uniformly with time: a quarter turn of θ is a quarter turn of v, and its rate is half of the
arithmetic-geometric mean of two numbers a and b, defined in :mod:`workers.solvers.closed_form`. The six
variables follow from sin v and cos v.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Literal

import numpy as np
from flint import acb, arb
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.potentials.recognition import ThreeTerms

LowEnd = Literal["pole", "rest", "collision"]
HighEnd = Literal["equator", "rest"]
FloatArray = NDArray[np.float64]


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


def R_F(x: arb, y: arb, z: arb) -> arb:
    """Return R_F of three numbers ≥ 0, of which at most one is 0."""
    return acb.elliptic_rf(x, y, z).real


def incomplete_first_kind(square: arb, parameter: arb) -> arb:
    """Return F(φ | m) for 0 ≤ φ ≤ π/2 with ``square`` = sin²φ and m < 1."""
    s = square.nonnegative_part()
    return s.sqrt() * R_F((1 - s).nonnegative_part(), 1 - parameter * s, arb(1))


def primed_nu(lambda_squared: Fraction, *, mirrored: bool) -> arb:
    """Return nu = λ² in primed axes: λ is raised to −A/C = −1/2 where they are mirrored."""
    return ball(lambda_squared).rsqrt() if mirrored else ball(lambda_squared)


def trip_time(interval: MotionInterval) -> arb:
    """Return the time in which g1 goes from lo to hi and back."""
    a, b = moduli(interval)
    return 2 * arb.pi() / a.agm(b)


def phase_at(interval: MotionInterval, sine: arb, cosine: arb) -> arb:
    """Return θ, where sin v and cos v are these: a quarter turn of θ is a quarter turn of v."""
    a, b = moduli(interval)
    (low, high), _ = interval.linear_factors()
    # tan χ = tan v · √(L1(hi)/L1(lo)).
    s, c = abs(sine) * high.sqrt(), abs(cosine) * low.sqrt()
    norm = s * s + c * c
    x = (b * b * c * c).nonnegative_part()
    quarter = a.agm(b) * s * R_F(x, x + a * a * s * s, b * b * norm)
    theta = arb.pi() - quarter if cosine < 0 else quarter
    return -theta if sine < 0 else theta


def moduli(interval: MotionInterval) -> tuple[arb, arb]:
    """Return a and b, of which half the arithmetic-geometric mean is the rate of the phase."""
    first, second = interval.linear_factors()
    factor = interval.curve.factor
    return (factor * first[0] * second[1]).sqrt(), (factor * first[1] * second[0]).sqrt()


@dataclass(frozen=True, slots=True)
class MirrorImage:
    """One of the mirror images of a motion, by the signs of g1, of g2 and of g3.

    Where g2 changes sign (``hi`` the equator) it is that of cos v, and ``g2``
    is 1; where g3 does (``lo`` the pole) it is that of ``g3`` · sin v.
    """

    g1: int
    g2: int
    g3: int
    is_mirrored: bool = False
    """The first and third axes are exchanged (C = 2A)."""


@dataclass(frozen=True, slots=True)
class Variables:
    """The data of the six variables, in doubles: x = lo cos²v + hi sin²v, L1 and L2 linear in x."""

    C: float
    nu: float
    a1: float
    b1: float
    c1: float
    lo: float
    hi: float
    width: float
    """hi − lo."""
    first: tuple[float, float]
    second: tuple[float, float]
    """L1 and L2 at lo and hi."""
    above: float
    """x1 − hi: 0 at the equator."""
    reaches_pole: bool
    reaches_equator: bool

    def state(self, sine: FloatArray, cosine: FloatArray, branch: MirrorImage) -> FloatArray:
        """Return p, q, r, g1, g2, g3 (not mirrored) where sin v and cos v are these, shape (n, 6)."""
        up, down = sine * sine, cosine * cosine
        x = self.lo * down + self.hi * up
        second = self.second[0] * down + self.second[1] * up
        if self.reaches_equator:
            g2 = cosine * np.sqrt(self.width * second)
            amplitude = np.sqrt(self.first[0] * down + self.first[1] * up)
        else:
            g2 = branch.g2 * np.sqrt((self.above + self.width * down) * second)
            # L1 at lo is 2 c1 (x1 − lo).
            steepness = self.first[0] / (self.above + self.width)
            amplitude = branch.g2 * np.sqrt(steepness * self.width) * cosine
        r = np.sqrt(2.0 * self.width / self.C) * amplitude * sine
        p = -branch.g3 * np.sqrt(self.nu / (2.0 * self.C)) * amplitude
        if self.reaches_pole:
            g3 = branch.g3 * np.sqrt(self.nu * self.hi) * sine
        else:
            g3 = branch.g3 * np.sqrt(self.nu * x)
            p = p * np.sqrt(self.width / x) * sine
        return np.stack([p, np.zeros_like(p), branch.g1 * r, branch.g1 * x, g2, g3], axis=1)

    def slope(self, state: FloatArray, branch: MirrorImage) -> FloatArray:
        """Return the time derivative of ``state``, by the Euler-Poisson equations with q = 0."""
        p, _, r, g1, g2, g3 = state.T
        V_1 = branch.g1 * self.a1 + 4.0 * self.c1 * g1
        V_3 = 2.0 * self.c1 * g3
        if self.b1:
            V_3 = V_3 - 2.0 * self.b1 / g3**3
        columns = [
            g2 * V_3 / (2.0 * self.C),
            np.zeros_like(p),
            -g2 * V_1 / self.C,
            r * g2,
            p * g3 - r * g1,
            -p * g2,
        ]
        return np.stack(columns, axis=1)

    def phase_speed(self, sine: FloatArray, cosine: FloatArray) -> FloatArray:
        """Return dv/dt."""
        up, down = sine * sine, cosine * cosine
        first = self.first[0] * down + self.first[1] * up
        second = self.second[0] * down + self.second[1] * up
        speed: FloatArray = np.sqrt(first * second / (2.0 * self.C))
        return speed
