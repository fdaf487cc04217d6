r"""V = a1 g1 + b1/g3² + c1 (g1² − g2²) of a body with A = 2C in balls of any precision: the reference.

With x = g1 > 0 and nu = g3²/g1 the motion is

.. math::

    \dot x^2 = (x - lo)(hi - x)\,k_2(x), \qquad x = lo\cos^2 v + hi\sin^2 v,

k2 a quadratic. With kl = k2(lo), kh = k2(hi), Ω = (kl kh)^{1/4} and
S = 2 k₂ lo hi + k₁ (lo + hi) + 2 k₀ it takes

.. math::

    T = \frac{2\pi}{M(\sqrt{(S + 2Ω^2)/4}, Ω)}, \quad m = \frac12 - \frac{S}{4Ω^2}, \quad
    \tan v = (kl/kh)^{1/4} \tan\tfrac12\operatorname{am}(Ω t | m)

from lo to lo. Written from these formulas alone, it shares no code with the
solvers. Made with BITS bits; period and state work at the current precision.
"""

from dataclasses import dataclass
from fractions import Fraction

from flint import acb, arb, ctx, fmpq

BITS = 4000
"""Gaps of 2^-1600 to a separatrix and 1e15 periods leave hundreds of them."""


def ball(value: Fraction | arb) -> arb:
    return value if isinstance(value, arb) else arb(fmpq(value.numerator, value.denominator))


@dataclass(frozen=True)
class Elliptic:
    """The motion that starts at x = hi with g3 > 0: at the equator with s > 0, or at rest with g2 > 0."""

    C: arb
    nu: arb
    c1: arb
    ends: str
    """"WE", "PE", "WW" or "PW": P the pole, W rest, E the equator."""
    lo: arb
    hi: arb
    width: arb
    x2: arb
    k: tuple[arb, arb, arb]
    """k2 by growing powers of x."""
    L: tuple[arb, arb]
    """−P/(x − lo) by growing powers of x, where hi is the equator."""

    @property
    def trip(self) -> arb:
        """Return the time of g1 from lo to hi and back."""
        kl, kh, S = self._ends_of_k()
        square = (kl * kh).sqrt()
        return 2 * arb.pi() / ((S + 2 * square) / 4).sqrt().agm(square.sqrt())

    @property
    def period(self) -> arb:
        """Return the period of all six variables."""
        return self.trip if self.ends == "WW" else 2 * self.trip

    def state(self, t: arb) -> list[arb]:
        """Return p, q, r, g1, g2, g3 at t."""
        kl, kh, S = self._ends_of_k()
        square = (kl * kh).sqrt()
        t = t + self.trip / 2
        t = t - self.period * (t / self.period).mid().floor()
        half = _amplitude(square.sqrt() * t, (S + 2 * square) / (4 * square)) / 2
        turns = (half / arb.pi() + arb(1) / 2).mid().floor()
        rest = half - turns * arb.pi()
        sine, cosine = (kl / kh).sqrt().sqrt() * rest.sin(), rest.cos()
        length = (sine * sine + cosine * cosine).sqrt() * (-1 if int(float(turns)) % 2 else 1)
        sine, cosine = sine / length, cosine / length
        x = self.hi - self.width * cosine * cosine if abs(sine) > 0.7 else self.lo + self.width * sine * sine
        f = (2 / self.C).sqrt() / self.nu
        if self.ends[1] == "E":
            g2 = cosine * (self.width * (x - self.x2)).sqrt()
            r = f * (self.L[0] + self.L[1] * x).sqrt() * self.width.sqrt() * sine
        else:
            g2 = (1 - self.nu * x - x * x).sqrt()
            r = f * self.nu * (2 * self.c1).sqrt() * self.width * sine * cosine
            if self.ends[0] == "P":
                r = r * (self.hi / self.width).sqrt()
        if self.ends[0] == "P":
            g3 = (self.nu * self.hi).sqrt() * sine
            p = -r * (self.nu / self.hi).sqrt() / (2 * sine)
        else:
            g3 = (self.nu * x).sqrt()
            p = -r * (self.nu / x).sqrt() / 2
        return [p, arb(0), r, x, g2, g3]

    def _ends_of_k(self) -> tuple[arb, arb, arb]:
        k0, k1, k2 = self.k
        kl, kh = (k0 + k1 * x + k2 * x * x for x in (self.lo, self.hi))
        return kl, kh, 2 * k2 * self.lo * self.hi + k1 * (self.lo + self.hi) + 2 * k0


def elliptic(
    ends: str,
    *,
    nu: Fraction,
    a1: Fraction,
    b1: Fraction,
    c1: Fraction | arb,
    C: Fraction = Fraction(1),
    bits: int = BITS,
) -> Elliptic:
    """Return the motion between these ends; the caller knows that there is one."""
    with ctx.workprec(bits):
        return _elliptic(ends, nu, a1, b1, c1, C)


def time_to_collision(*, nu: Fraction, a1: Fraction, b1: Fraction, c1: Fraction, bits: int = BITS) -> arb:
    r"""Return the time from the equator to the collision with the pole, C = 1, where P has no real root.

    With the roots x1, x2 of 1 - nu x - x² and z, z̄ of P it is (Carlson 1995, equation 3.1)

    .. math:: \int_0^{x_1} \frac{dx}{\sqrt{-4 c_1 (x_1-x)(x-x_2)(x-z)(x-\bar z)}}
              = \frac{R_F(U_{12}^2, U_{13}^2, U_{14}^2)}{\sqrt{-c_1}} .
    """
    with ctx.workprec(bits):
        n, a, b, c = (ball(value) for value in (nu, a1, b1, c1))
        x1 = 2 / (n + (n * n + 4).sqrt())
        # P = 2 b1 + nu² a1 x + 2 nu² c1 x².
        turn, away = -a / (4 * c), (b / (n * n * c) - (a / (4 * c)) ** 2).sqrt()
        z = acb(turn, away)
        factors = [(acb(x1), -1), (acb(1 / x1), 1), (-z, 1), (-z.conjugate(), 1)]
        upper, lower = ([(free + slope * x).sqrt() for free, slope in factors] for x in (x1, 0))
        # x1 − x is 0 at x1, to the last bit.
        upper[0] = acb(0)
        squares = []
        for j in (1, 2, 3):
            k, m = (other for other in (1, 2, 3) if other != j)
            ends = upper[0] * upper[j] * lower[k] * lower[m] + lower[0] * lower[j] * upper[k] * upper[m]
            squares.append((ends / x1) ** 2)
        return (acb.elliptic_rf(*squares) / (-c).sqrt()).real


def _elliptic(
    ends: str, nu: Fraction, a1: Fraction, b1: Fraction, c1: Fraction | arb, C: Fraction
) -> Elliptic:
    moment, n, a, b, c = (ball(value) for value in (C, nu, a1, b1, c1))
    x1 = 2 / (n + (n * n + 4).sqrt())
    x2, f = -1 / x1, 2 / (moment * n * n)
    roots = _roots(2 * b, n * n * a, 2 * n * n * c, is_linear=not c1, has_no_constant=not b1)
    hi = x1 if ends[1] == "E" else roots.pop()
    lo = arb(0) if ends[0] == "P" else max((root for root in roots if root < x1), key=arb.mid)
    L0, L1 = -(n * n * a + 2 * n * n * c * lo), -2 * n * n * c
    if ends[1] == "E":
        k = (-f * L0 * x2, f * (L0 - L1 * x2), f * L1)
    else:
        k = tuple(f * 2 * n * n * c * factor for factor in (1, -n, -1))
    return Elliptic(moment, n, c, ends, lo, hi, hi - lo, x2, k, (L0, L1))


def _roots(
    constant: arb, linear: arb, quadratic: arb, *, is_linear: bool, has_no_constant: bool
) -> list[arb]:
    """Return the positive roots of P, growing."""
    if has_no_constant:
        found = [] if is_linear else [-linear / quadratic]
    elif is_linear:
        found = [-constant / linear]
    else:
        larger = (
            -(linear + (1 if linear >= 0 else -1) * (linear * linear - 4 * quadratic * constant).sqrt()) / 2
        )
        found = [larger / quadratic, constant / larger]
    return sorted((root for root in found if root > 0), key=arb.mid)


def _amplitude(u: arb, complement: arb) -> arb:
    """Return am(u | m) from 1 − m, which may be tiny, by Gauss's descent; u within a few 2K."""
    a, b, ratios = arb(1), complement.sqrt(), []
    while not ratios or not abs(ratios[-1]) < arb(2) ** (-ctx.prec // 2):
        c, a, b = (a - b) / 2, (a + b) / 2, (a * b).sqrt()
        ratios.append(c / a)
    K = arb.pi() / (2 * a)
    turns = (u / (2 * K) + arb(1) / 2).mid().floor()
    u = u - 2 * K * turns
    phase = a * u * arb(2) ** len(ratios)
    for ratio in reversed(ratios):
        phase = (phase + (ratio * phase.sin()).asin()) / 2
    return phase + turns * arb.pi()
