"""What a panel and its ellipse claim, against closed forms and against values at complex phases."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf

import numpy as np
import pytest
from flint import acb, arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.window import starting_point
from service.dynamics.reduction.windows import choose_window, find_windows
from service.dynamics.solution.dense_output import EPSILON
from tests.support.planar import body, formula
from workers.solvers.orbits.orbit import make_orbit
from workers.solvers.quadrature.panel import PANEL_DEGREE, Ellipse, make_panel
from workers.solvers.quadrature.squared_speed import phase_speed
from workers.solvers.quadrature.time_map import make_time_map

BITS = 160


@dataclass(frozen=True)
class Bump:
    """(dθ/dt)² = a² + (θ − b)²: entire, while dt/dθ has branch points at b ± ia."""

    a: arb
    b: arb

    def squared(self, theta: acb) -> acb:
        return self.a * self.a + (theta - self.b) ** 2

    def rate(self, theta: arb) -> arb:
        return (self.a * self.a + (theta - self.b) ** 2).rsqrt()

    def time(self, theta: arb) -> arb:
        """Return ∫ from 0: the difference of two area functions."""
        return ((theta - self.b) / self.a).asinh() + (self.b / self.a).asinh()

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        largest = arb(0)
        for part in chain:
            largest = largest.max(abs(self.squared(part)).upper())
        return largest

    def enclosed(self, theta: arb) -> arb:
        return self.a * self.a + (theta - self.b) ** 2

    def limit(self, theta: arb) -> arb | None:
        return None


@pytest.mark.one_in(3)
@pytest.mark.parametrize("exponent", [0, 1, 2, 4, 8, 12])
def test_no_claim_of_a_time_map_is_exceeded(exponent):
    random = np.random.default_rng(exponent)
    with ctx.workprec(BITS):
        for _ in range(3):
            a, b = arb(10.0**-exponent * random.uniform(0.5, 1.0)), arb(random.uniform(0.1, 6.2))
            bump = Bump(a, b)
            time_map = make_time_map(bump.rate, (), is_even=False, speed=bump)
            period = time_map.period
            exact = bump.time(2 * arb.pi())
            gap = abs(arb(period.hi) + arb(period.lo) - exact)
            # lo is a double of about 2^-53 of the period.
            assert gap < period.error + period.hi * 2.0**-104
            assert period.error < 1e-15 * period.hi
            assert time_map.unproved == 0
            u = np.sort(np.concatenate([random.uniform(0.0, 2.0, 40), time_map.edges]))
            found = time_map.time_at(u)
            for place, time in zip(u.tolist(), found.tolist(), strict=True):
                # u is a double: on the slope of the bump a rounding of x in a panel counts too.
                error = abs(bump.time(arb.pi() * arb(place)) - arb(time))
                assert error < time_map.error + 4.0 * EPSILON * period.hi


class Spike(Bump):
    """(dθ/dt)² = 1 + 100 exp(−(θ − b)²/a²)."""

    def squared(self, theta: acb) -> acb:
        return 1 + 100 * (-(((theta - self.b) / self.a) ** 2)).exp()

    def rate(self, theta: arb) -> arb:
        return self.squared(acb(theta)).real.rsqrt()


class Deceived(Spike):
    """The same, with bounds that do not know of the spike."""

    def bound(self, chain: Sequence[acb], *, is_close: bool) -> arb:
        return arb(1)


def test_it_is_the_bound_that_sees_what_is_between_the_nodes():
    with ctx.workprec(BITS):
        width, place = arb(10) ** -6, arb(2)
        spike = Spike(width, place)

        def rate(theta: acb, analytic: bool) -> acb:
            return spike.squared(theta).rsqrt(analytic)

        exact = acb.integral(rate, arb(0), place).real + acb.integral(rate, place, 2 * arb.pi()).real
        for speed in (spike, Deceived(width, place)):
            period = make_time_map(spike.rate, (), is_even=False, speed=speed).period
            gap = abs(arb(period.hi) + arb(period.lo) - exact)
            assert period.error < 1e-15 * period.hi
            assert (gap < period.error + period.hi * 2.0**-104) == (speed is spike)


def test_a_panel_that_is_not_proved_takes_a_positive_time():
    """Where the rate is small between the points of the series, their departure corrects nothing."""
    degree = 2 * PANEL_DEGREE

    def rate(theta: arb) -> arb:
        # 1 at the points of the series, 1e-3 at those between.
        return arb("1e-3") + (1 + arb.chebyshev_t(theta / arb.pi(), degree)) / 2

    with ctx.workprec(BITS):
        panel = make_panel(rate, -1.0, 1.0, Ellipse(degree, 2.0, arb(1)))
        assert (panel.error, panel.inner_error) == (inf, inf)
        assert panel.length > 0


ORBITS = [
    ("2", "-g1 + (2*g1^2+g3^2)*exp(-4*(g2-3/10)^2)/10", None),
    ("2", "-g1 + 1/50/g3^2 + 6/5*(g1^2-g2^2)", None),
    ("3", "(3*g1^2+g3^2)*(g2^2-1/2+g2^3/5)", None),
    ("17/10", "-(17/10*g1^2+g3^2)*(3/5-g2^2)+3/10*g2*(17/10*g1^2+g3^2)", None),
    ("1/2", "-g3", None),
]


@pytest.mark.parametrize(("alpha", "text", "window"), ORBITS)
def test_bounds_hold_at_complex_phases(alpha, text, window):
    """Forty values on a short stretch determine the function near it, far beyond the digits needed here."""
    with ctx.workprec(4 * BITS):
        rigid_body = body(alpha, 1)
        motion = PlanarMotion(Fraction(1), window=window)
        windows = find_windows(rigid_body, formula(text, rigid_body), motion, precision=4 * BITS)
        orbit = make_orbit(starting_point(choose_window(windows, motion), motion))
        speed = phase_speed(orbit)
        for centre in (0.4, 1.3, 2.2, 2.9):
            radius = 0.05
            nodes = [(arb.pi() * (2 * k + 1) / 80).cos() for k in range(40)]
            squares = [orbit.rate(centre + radius * x) ** -2 for x in nodes]
            for is_close in (False, True):
                box = acb(arb(centre, radius), arb(0, radius))
                bound = speed.bound([box], is_close=is_close)
                if not bound.is_finite():
                    continue
                for corner in (acb(1, 1), acb(-1, 1), acb(0, 1), acb(1, 0)):
                    value = _barycentric(nodes, squares, corner)
                    assert abs(value).mid() * (1 - 1e-9) <= bound
            for k, x in enumerate(nodes[::8]):
                theta = arb(float(centre + radius * x), 1e-3)
                assert speed.enclosed(theta).overlaps(orbit.rate(theta.mid()) ** -2), k


def _barycentric(nodes: list[arb], values: list[arb], x: acb) -> acb:
    """Return the polynomial through Chebyshev points of the first kind at x."""
    n = len(nodes)
    above, below = acb(0), acb(0)
    for k, (node, value) in enumerate(zip(nodes, values, strict=True)):
        weight = (-1) ** k * (arb.pi() * (2 * k + 1) / (2 * n)).sin()
        above += weight * value / (x - node)
        below += weight / (x - node)
    return above / below
