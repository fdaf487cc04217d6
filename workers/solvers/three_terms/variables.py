"""Motions in a potential of three terms: the phase θ, its time, and the six variables from sin v and cos v.

In θ the motions are elliptic functions. On an interval lo ≤ x ≤ hi with x = lo cos²v + hi sin²v the phase
grows uniformly with time: a quarter turn of θ is a quarter turn of v, and its rate is half of the
arithmetic-geometric mean of two numbers a and b. They are defined in
:mod:`workers.solvers.closed_form.family`.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import acb, arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.ball import ball
from workers.solvers.three_terms.intervals import MotionInterval

FloatArray = NDArray[np.float64]


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
