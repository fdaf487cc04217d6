r"""Motions in V = V1[F] by quadratures of mpmath, from formulas of the paper, without code of the service.

Along the curve with |g3| = λ|g1|^(C/A), from the equator on, with x = arctan |g3/g1| in V1,

.. math:: V_1 = -(\alpha-1) T(\varphi) \int_{\varphi_0}^{\varphi} F(w) \frac{\sin 2x}{T(x)^2} dx, \qquad
          T(x) = \alpha\cos^2 x + \sin^2 x, \qquad
          w(\rho, x) = (|A-C|\rho)^{\alpha-1} \frac{\sin^{2\alpha} x}{\cos^2 x},

and s² = 2(h − V)/(A C Q), h = −F(w).
"""

from collections.abc import Callable
from dataclasses import dataclass

import mpmath as mp


@dataclass(frozen=True, slots=True)
class GeneralMotion:
    """A motion in V1[F] + Q G(g2) that moves north from the equator, at the precision of mpmath.

    g1 and g3 are positive at the equator.
    """

    F: Callable[[mp.mpf], mp.mpf]
    A: mp.mpf
    C: mp.mpf
    size: mp.mpf
    """λ."""
    G: Callable[[mp.mpf], mp.mpf] = lambda _: mp.mpf(0)

    @property
    def alpha(self) -> mp.mpf:
        return self.A / self.C

    @property
    def energy(self) -> mp.mpf:
        alpha = self.alpha
        return -self.F(abs(self.A - self.C) ** (alpha - 1) * self.size ** (2 * alpha))

    def V(self, g1: mp.mpf, g3: mp.mpf) -> mp.mpf:
        """Return V1 by one integral, over log tan² x, whose pieces are short."""
        alpha, rho = self.alpha, g1 * g1 + g3 * g3
        log_scale = (alpha - 1) * mp.log(abs(self.A - self.C) * rho)

        def integrand(y: mp.mpf) -> mp.mpf:
            z = mp.exp(y)
            w = mp.exp(log_scale + alpha * y + (1 - alpha) * mp.log1p(z))
            return self.F(w) * z / (alpha + z) ** 2

        end = 2 * mp.log(g3 / g1)
        pieces = max(1, int(mp.ceil(abs(end) / 4)))
        ends = [end * k / pieces for k in range(pieces + 1)]
        found = mp.quad(integrand, ends, method="gauss-legendre", maxdegree=5)
        return -(alpha - 1) * (alpha * g1 * g1 + g3 * g3) / rho * found

    def state(self, g3: mp.mpf, g2: mp.mpf) -> tuple[mp.mpf, ...]:
        """Return (p, q, r, g1, g2, g3), where g2 rises: s < 0."""
        g1 = (g3 / self.size) ** self.alpha
        Q = self.A * g1 * g1 + self.C * g3 * g3
        s = -mp.sqrt(2 * ((self.energy - self.V(g1, g3)) / Q - self.G(g2)) / (self.A * self.C))
        return -self.C * g3 * s, mp.mpf(0), self.A * g1 * s, g1, g2, g3

    def equator(self) -> mp.mpf:
        """Return g3 where g2 = 0."""
        return mp.findroot(
            lambda z: (z / self.size) ** (2 * self.alpha) + z * z - 1, (0, 1), solver="anderson", maxsteps=200
        )

    def north_of(self, u: mp.mpf) -> tuple[mp.mpf, ...]:
        """Return the state where g3 is u² less than at the equator; nothing there is infinite as u → 0."""
        last = self.equator()
        lost = -((last / self.size) ** (2 * self.alpha)) * mp.expm1(2 * self.alpha * mp.log1p(-u * u / last))
        return self.state(last - u * u, mp.sqrt(lost + u * u * (2 * last - u * u)))

    def time_to(self, u: mp.mpf) -> mp.mpf:
        """Return the time from the equator to there: dg3/dt = −g2 p."""

        def rate(u: mp.mpf) -> mp.mpf:
            p, _, _, _, g2, _ = self.north_of(u)
            return 2 * u / (g2 * p)

        return mp.quad(rate, [0, u], method="gauss-legendre", maxdegree=5)
