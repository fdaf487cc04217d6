"""Golden motions that no Taylor series follows: through a singular pole; in a V that is an integral.

Both are integrals over the curve g3 = Z cos u, g1 = G cos(u)^alpha (theory.md,
section 3), u counted from the equator; they are taken by mpmath.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from mpmath import mp, mpf

DIGITS = 60
KEPT = mpf(10) ** -48
"""What may be left out of a series, and by how much twice as many nodes may change it."""


@dataclass(frozen=True)
class Found:
    period: mpf
    energy: mpf
    states: dict[Fraction, list[mpf]]


@dataclass(frozen=True)
class Curve:
    A: mpf
    C: mpf
    lam: mpf
    Z: mpf
    G: mpf

    @classmethod
    def of(cls, A: Fraction, C: Fraction, lam: Fraction) -> "Curve":
        a, c, number = (mpf(each.numerator) / each.denominator for each in (A, C, lam))
        G = mp.findroot(lambda x: x * x + (number * x ** (c / a)) ** 2 - 1, mpf("0.6"))
        return cls(a, c, number, number * G ** (c / a), G)

    @property
    def alpha(self) -> mpf:
        return self.A / self.C

    def c(self, u: mpf) -> mpf:
        """Return g2/sin u; nothing cancels at the equator."""
        sine = mp.sin(u) ** 2
        if not sine:
            return mp.sqrt(self.Z**2 + self.alpha * self.G**2)
        return mp.sqrt(self.Z**2 - self.G**2 * mp.expm1(self.alpha * mp.log1p(-sine)) / sine)

    def state(self, u: mpf, p: mpf) -> list[mpf]:
        """Return the six variables; at a pole g1 keeps its sign."""
        g1, g3 = self.G * abs(mp.cos(u)) ** self.alpha, self.Z * mp.cos(u)
        r = -p * self.A * g1 / (self.C * g3)
        return [p, mpf(0), r, g1, self.c(u) * mp.sin(u), g3]


def through_the_pole(times: tuple[Fraction, ...]) -> Found:
    """V = -|g1|^(2(alpha-1)/alpha), A = 17/10, C = 1, lambda = 1: p is constant, g3' = -p g2.

    By equations (1) and (2) of theory.md p² = 2 C lambda²/A² and h = lambda²/alpha.
    """
    with mp.workdps(DIGITS):
        curve = Curve.of(Fraction(17, 10), Fraction(1), Fraction(1))
        p = -curve.lam * mp.sqrt(2 * curve.C) / curve.A

        def time(u: mpf) -> mpf:
            return mp.quad(lambda x: curve.Z / (-p * curve.c(x)), [0, u / 2, u])

        quarter = mp.quad(lambda x: curve.Z / (-p * curve.c(x)), [0, mp.pi / 4, mp.pi / 2])
        states = {}
        for exact in times:
            t = mpf(exact.numerator) / exact.denominator
            turns = mp.floor(t / (2 * quarter))
            rest = t - 2 * quarter * turns
            # Half a turn is symmetric about the pole in its middle.
            mirrored = rest > quarter
            goal = 2 * quarter - rest if mirrored else rest
            u = mp.findroot(lambda x, t=goal: time(x) - t, goal / quarter * mp.pi / 2) if goal else mpf(0)
            assert abs(time(u) - goal) < KEPT
            u = mp.pi * turns + (mp.pi - u if mirrored else u)
            states[exact] = curve.state(-u, p)
        return Found(4 * quarter, curve.lam**2 / curve.alpha, states)


def in_an_integral(times: tuple[Fraction, ...]) -> Found:
    """V = V1[exp(-w)] + Q (3/10 g2 - 3 (3/5 - g2²)), A = 17/10, C = 1, lambda = 11/10; theory.md, section 6.

    Between its rest points u = m - eta cos(theta); dt/dtheta is even and smooth, and its
    cosine series is the time.
    """
    with mp.workdps(DIGITS):
        curve = Curve.of(Fraction(17, 10), Fraction(1), Fraction(11, 10))
        alpha, A, C = curve.alpha, curve.A, curve.C
        unit = abs(A - C)
        F = mp.exp(-(unit ** (alpha - 1)) * curve.lam ** (2 * alpha))

        def T(x: mpf) -> mpf:
            return alpha * mp.cos(x) ** 2 + mp.sin(x) ** 2

        def squared_s(u: mpf) -> mpf:
            _, _, _, g1, g2, g3 = curve.state(u, mpf(0))
            phi, scale = mp.atan2(g3, g1), (unit * (g1**2 + g3**2)) ** (alpha - 1)

            def of(x: mpf) -> mpf:
                w = scale * mp.sin(x) ** (2 * alpha) / mp.cos(x) ** 2
                return mp.exp(-w) * mp.sin(2 * x) / T(x) ** 2

            V1 = -(alpha - 1) * T(phi) * mp.quad(of, [mp.pi / 4, phi], method="gauss-legendre")
            Q = A * g1**2 + C * g3**2
            G = 3 * g2 / 10 - 3 * (mpf(3) / 5 - g2**2)
            return 2 * (-F - V1 - Q * G) / (A * C * Q)

        low, high = (_zero(squared_s, sign) for sign in (-1, 1))
        middle, eta = (low + high) / 2, (high - low) / 2

        def slope(theta: mpf) -> mpf:
            u = middle - eta * mp.cos(theta)
            p = C * curve.Z * mp.cos(u) * mp.sqrt(squared_s(u))
            return eta * mp.sin(theta) * curve.Z / (curve.c(u) * p)

        series = _cosines(slope)

        def time(theta: mpf) -> mpf:
            return series[0] * theta + sum(a / k * mp.sin(k * theta) for k, a in enumerate(series) if k)

        # At the equator and falling: on the way from high to low.
        start = 2 * mp.pi - mp.acos(middle / eta)
        period = 2 * mp.pi * series[0]
        states = {}
        for exact in times:
            t = mp.fmod(mpf(exact.numerator) / exact.denominator, period)
            goal = time(start) + t
            theta = mp.findroot(lambda x, t=goal: time(x) - t, start + t / series[0])
            u = middle - eta * mp.cos(theta)
            speed = C * curve.Z * mp.cos(u) * mp.sqrt(max(squared_s(u), mpf(0)))
            states[exact] = curve.state(u, speed if mp.sin(theta) > 0 else -speed)
        return Found(period, -F, states)


def _zero(f: Callable[[mpf], mpf], sign: int) -> mpf:
    """Return the zero next to the equator on this side: looked for in steps, then by the secant."""
    u, step = mpf(0), mpf(1) / 16
    assert f(u) > 0
    while f(u + sign * step) > 0:
        u += sign * step
    return mp.findroot(f, (u, u + sign * step), solver="anderson", tol=mpf(10) ** (-2 * DIGITS + 10))


def _cosines(f: Callable[[mpf], mpf]) -> list[mpf]:
    """Return a_0, a_1, ... of an even function of period 2 pi with f = sum a_k cos(k theta)."""
    count = 128
    nodes = [mp.pi * (2 * j + 1) / (2 * count) for j in range(count)]
    values = [f(each) for each in nodes]
    series = [
        2 * sum(v * mp.cos(k * x) for v, x in zip(values, nodes, strict=True)) / count for k in range(count)
    ]
    series[0] /= 2
    assert all(abs(each) < KEPT for each in series[-6:]), [mp.nstr(each, 3) for each in series[::8]]
    return series
