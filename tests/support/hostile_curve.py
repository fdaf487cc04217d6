"""p² along the curve |g3| = λ|g1|^(C/A) of a potential with known parts, by formulas of its own.

For A > C (a body with A < C is mirrored first). With g3 = Z s, |g1| = G s^α, s = sin v,
Z² + G² = 1, α = A/C = n/m and τ = s^(1/m) everything is rational in τ and cos v:

    g2 = c cos v,   c² = Z² + G² (1 + σ + … + σ^(n−1))/(1 + … + σ^(m−1)),   σ = τ²,

and for V = (A g1² + C g3²) g(g2) + b|g1|^(2(α−1)/α) + c|g3|^(−2(α−1))

    p² = −(2C/A) (g3² g(g2) + bλ²/A + c λ^(−2α) g3²/(C g1²)),    dt = Z dv/(c p).
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import partial

from flint import arb

from tests.support.hostile_features import exact
from tests.support.jets import Value, cos, power, root, sin

OfG2 = Callable[[Value, tuple[int, ...]], Value]
"""A function of g2; the second argument has the sides of the kinks, as :meth:`Feature.value` takes them."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A curve and the potential on it, at the precision at which it was made."""

    A: arb
    C: arb
    n: int
    m: int
    Z: arb
    G: arb
    b: arb
    """bλ²/A."""
    c: arb
    """cλ^(−2α) Z²/(C G²)."""
    of_g2: OfG2
    weighted: OfG2 | None = None
    """The same times :attr:`weight`, where that leaves nothing infinite."""
    weight: OfG2 | None = None
    """A product of powers of distances from the places where the function is infinite."""

    def tau(self, v: Value) -> Value:
        """Return (sin v)^(1/m)."""
        return root(sin(v), self.m)

    def c_of(self, tau: Value) -> Value:
        """Return c > 0, g2 = c cos v."""
        sigma = tau * tau
        upper, lower = arb(1), arb(1)
        term: Value = sigma
        for k in range(1, self.n):
            upper = term + upper
            if k < self.m:
                lower = term + lower
            term = term * sigma
        return root((upper / lower) * (self.G * self.G) + self.Z * self.Z, 2)

    def g2(self, v: Value) -> Value:
        return self.c_of(self.tau(v)) * cos(v)

    def p_squared(self, tau: Value, y: Value, sides: tuple[int, ...]) -> Value:
        n, m = self.n, self.m
        total = self.of_g2(y, sides) * (self.Z * self.Z) * power(tau, 2 * m) + self.b
        if self.c != 0:
            total = total + self.c / power(tau, 2 * n - 2 * m)
        return total * (-2 * self.C / self.A)

    def p_squared_at(self, v: Value, sides: tuple[int, ...]) -> Value:
        tau = self.tau(v)
        return self.p_squared(tau, self.c_of(tau) * cos(v), sides)

    def sign_function(self, tau: Value, y: Value, sides: tuple[int, ...]) -> Value:
        """Return p² times a positive number and a power of τ that leaves it finite and not 0 at the poles."""
        n, m = self.n, self.m
        b, c, of_g2 = self.b, self.c, self.of_g2
        if self.weighted is not None and self.weight is not None:
            weight = self.weight(y, sides)
            b, c, of_g2 = b * weight, c * weight, self.weighted
        g = of_g2(y, sides) * (self.Z * self.Z)
        if self.c != 0:
            return -(power(tau, 2 * n) * g + power(tau, 2 * n - 2 * m) * b + c)
        if self.b != 0:
            return -(power(tau, 2 * m) * g + b)
        return -g

    def weighted_p_squared(self, tau: Value, y: Value, sides: tuple[int, ...]) -> Value:
        """Return p² times the weight, between the poles."""
        n, m = self.n, self.m
        found = self.sign_function(tau, y, sides) * (2 * self.C / self.A)
        if self.c != 0:
            return found / power(tau, 2 * n - 2 * m)
        return found if self.b != 0 else found * power(tau, 2 * m)

    @property
    def at_pole(self) -> str:
        """Say what a motion does that comes to a pole."""
        if self.c != 0:
            return "collision"
        return "passed" if self.b != 0 else "approached"


def make_curve(A: Fraction, C: Fraction, size: arb, b: Fraction, c: Fraction, of_g2: OfG2) -> Curve:
    """Return the curve λ = ``size`` of a body with A > C."""
    alpha = A / C
    Z = largest_g3(size, exact(alpha))
    G = (Z / size) ** exact(alpha)
    scaled_b = exact(b) * size * size / exact(A)
    scaled_c = exact(c) * size ** (-2 * exact(alpha)) / exact(C) * (Z / G) ** 2
    return Curve(exact(A), exact(C), alpha.numerator, alpha.denominator, Z, G, scaled_b, scaled_c, of_g2)


def largest_g3(size: arb, alpha: arb) -> arb:
    """Return Z with Z² + (Z/λ)^(2α) = 1; the sum grows with Z."""
    return root_between(partial(_excess, size, alpha), arb(2) ** -200, arb(1))


def _excess(size: arb, alpha: arb, z: arb) -> arb:
    return z * z + (z / size) ** (2 * alpha) - 1


def root_between(f: Callable[[arb], arb], low: arb, high: arb) -> arb:
    """Return a ball about the zero of a function with different signs at two exact points, by bisection
    and the secant rule; as narrow as the signs of ``f`` can be told.
    """
    at_low, at_high = f(low), f(high)
    rises = bool(at_high > 0)
    assert (at_low < 0 and at_high > 0) or (at_low > 0 and at_high < 0)
    for k in range(400):
        if k % 3 == 2 or not (at_low.is_finite() and at_high.is_finite()):
            middle = arb(((low + high) / 2).mid())
        else:
            # A little beyond the zero of the secant, alternately to both sides, so that both ends move.
            guess = low - at_low * (high - low) / (at_high - at_low)
            width = high - low
            middle = arb((guess + (width * arb(2) ** -12 if k % 3 else -width * arb(2) ** -12)).mid())
            if not (middle > low and middle < high):
                middle = arb(((low + high) / 2).mid())
        value = f(middle)
        if (value > 0) == rises and (value > 0 or value < 0):
            high, at_high = middle, value
        elif value > 0 or value < 0:
            low, at_low = middle, value
        else:
            break
        if high - low < abs(high) * arb(2) ** -170:
            break
    return low.union(high)
