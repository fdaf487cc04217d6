"""The same motions by other formulas, root-free and in mpmath: for g1, g2, g3 > 0 at t = 0, x = hi."""

from fractions import Fraction

import mpmath as mp
import numpy as np

from service.dynamics.potentials.recognition import ThreeTerms


def exact(value):
    value = Fraction(value)
    return mp.mpf(value.numerator) / value.denominator


class Reference:
    """x'² = (x − lo)(hi − x) k(x) with k quadratic, by the amplitude of modulus 1/2 − S/(4 Om²)."""

    def __init__(self, terms: ThreeTerms, C, nu, ends: tuple[str, str]):
        self.a1, self.b1, self.c1 = exact(terms.a1), exact(terms.b1), exact(terms.c1)
        self.C, self.nu, self.ends = exact(C), exact(nu), ends
        nu = self.nu
        self.x1 = (-nu + mp.sqrt(nu**2 + 4)) / 2
        self.x2 = -1 / self.x1
        linear, quadratic = nu**2 * self.a1, 2 * nu**2 * self.c1
        roots = self._roots(linear, quadratic)
        inside = sorted(root for root in roots if 0 < root < self.x1)
        if ends[1] == "equator":
            self.hi, self.lo = self.x1, mp.mpf(0) if ends[0] == "pole" else inside[-1]
        else:
            self.hi, self.lo = inside[-1], mp.mpf(0) if ends[0] == "pole" else inside[0]
        f = 2 / (self.C * nu**2)
        if ends[1] == "equator":
            L1 = -quadratic
            L0 = -(linear + quadratic * self.lo)
            self.k = (f * L1, f * (L0 - L1 * self.x2), -f * L0 * self.x2)
        else:
            self.k = (-f * quadratic, -f * quadratic * nu, f * quadratic)
        low, high = self._k(self.lo), self._k(self.hi)
        S = 2 * self.k[0] * self.lo * self.hi + self.k[1] * (self.lo + self.hi) + 2 * self.k[2]
        self.Om = mp.sqrt(mp.sqrt(low * high))
        self.kap = mp.sqrt(mp.sqrt(low / high))
        self.m = mp.mpf(1) / 2 - S / (4 * self.Om**2)
        self.trip = 4 * mp.ellipk(self.m) / self.Om

    def _roots(self, linear, quadratic):
        if quadratic == 0:
            return [-2 * self.b1 / linear]
        disc = mp.sqrt(linear**2 - 8 * quadratic * self.b1)
        return [(-linear - disc) / (2 * quadratic), (-linear + disc) / (2 * quadratic)]

    def _k(self, x):
        return (self.k[0] * x + self.k[1]) * x + self.k[2]

    def state(self, t):
        """Return (p, q, r, g1, g2, g3) at ``t`` since x = hi."""
        u = self.Om * (mp.mpf(float(t)) + self.trip / 2)
        quarter = mp.ellipk(self.m)
        turns = mp.nint(u / (2 * quarter))
        u -= 2 * quarter * turns
        amplitude = mp.atan2(*(mp.re(mp.ellipfun(kind, u, m=self.m)) for kind in ("sn", "cn")))
        a = (amplitude + turns * mp.pi) / 2
        n = mp.nint(a / mp.pi)
        d = a - n * mp.pi
        v = n * mp.pi + mp.atan2(self.kap * mp.sin(d), mp.cos(d))
        return self._variables(v)

    def _variables(self, v):
        nu, C, sin, cos = self.nu, self.C, mp.sin(v), mp.cos(v)
        x = self.lo * cos**2 + self.hi * sin**2
        width = self.hi - self.lo
        first = nu**2 * self.a1 + 2 * nu**2 * self.c1 * (x + self.lo)
        if self.ends[1] == "equator":
            g2 = cos * mp.sqrt(width * (x - self.x2))
            w = mp.sqrt(2 / C) * mp.sqrt(-first) / nu
        else:
            g2 = mp.sqrt(1 - nu * x - x**2)
            w = mp.sqrt(2 / C) * mp.sqrt(2 * nu**2 * self.c1 * width) * cos / nu
        if self.ends[0] == "pole":
            g3, p, r = mp.sqrt(nu * self.hi) * sin, -mp.sqrt(nu) * w / 2, w * mp.sqrt(self.hi) * sin
        else:
            r = w * mp.sqrt(width) * sin
            g3, p = mp.sqrt(nu * x), -mp.sqrt(nu / x) * r / 2
        return [p, mp.mpf(0), r, x, g2, g3]

    def departure(self, times, samples) -> float:
        """Return the largest difference of ``samples`` (n, 6) at ``times`` from this motion."""
        rows = [self.state(t) for t in times]
        gaps = [
            abs(mp.mpf(float(s)) - e)
            for row, own in zip(rows, samples, strict=True)
            for e, s in zip(row, own, strict=True)
        ]
        return float(max(gaps))


def spread(period: float, count: int) -> np.ndarray:
    """Return times over a period, both ends and their neighbourhood included."""
    return np.concatenate([np.linspace(0.0, period, count), np.array([1e-9, 1e-3]) * period])
