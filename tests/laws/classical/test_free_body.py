"""Euler's free body with γ along its angular momentum: all six variables by elliptic functions."""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.coefficients import gravity_potential
from tests.support.heyoka_integrator import HEYOKA
from workers.solvers.integration.solve import integrate_state

ZERO = Fraction(0)
NO_FIELD = gravity_potential(ZERO, ZERO, ZERO)
BODY = RigidBody(Fraction(2), Fraction(3, 2), Fraction(1))
A, B, C = 2.0, 1.5, 1.0


@dataclass(frozen=True)
class AboutOneAxis:
    """The variable along ``axis`` never vanishes: dn; q ~ sn; the third ~ cn. A > B > C.

    About the first axis 2 h B < |M|², about the third 2 h B > |M|². The formulas of one are those of the
    other with A and C exchanged, and the signs that A - B and B - C then change.
    """

    axis: int
    large: float
    small: float
    phase: float

    @property
    def m(self) -> float:
        ratio = C * (B - C) / (A * (A - B))
        return (self.small / self.large) ** 2 * (ratio if self.axis == 0 else 1 / ratio)

    @property
    def rate(self) -> float:
        product = (A - C) * (A - B) / (B * C) if self.axis == 0 else (A - C) * (B - C) / (A * B)
        return float(abs(self.large) * np.sqrt(product))

    def omega(self, t):
        sn, cn, dn, _ = ellipj(self.rate * t + self.phase, self.m)
        third = (C, A - B) if self.axis == 0 else (A, B - C)
        q = -third[0] * self.small * self.rate / (third[1] * self.large)
        if self.axis == 0:
            return np.stack([self.large * dn, q * sn, self.small * cn], axis=-1)
        return np.stack([self.small * cn, q * sn, self.large * dn], axis=-1)


def with_momentum(omega, moments=(A, B, C)):
    """The states (ω, γ) with γ = M/|M|: fixed in space, because M is."""
    momentum = omega * moments
    return np.hstack([omega, momentum / np.linalg.norm(momentum, axis=1, keepdims=True)])


def integrate(body, state, times, integrator):
    # Steps of DOP853 lose some 100 roundings; next to the separatrix these grow to 3e-10 in four periods.
    tolerance = 1e-9 if integrator == "dop853" else 1e-10
    start = state[:3].tolist(), state[3:].tolist()
    return integrate_state(body, NO_FIELD, *start, times, tolerance=tolerance, integrator=integrator)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("integrator", ["taylor", HEYOKA, "dop853"])
@pytest.mark.parametrize(
    "case",
    [
        AboutOneAxis(0, 1.0, 0.25, 0.7),
        AboutOneAxis(0, -0.6, 0.8, 0.1),
        AboutOneAxis(2, 1.3, 0.5, -0.4),
        AboutOneAxis(2, -0.9, 0.35, 2.0),
        AboutOneAxis(2, 1.0, np.sqrt((1 - 1e-2) / 2), 0.0),
    ],
)
def test_three_different_moments(case, integrator):
    """On both sides of the separatrix 2 h B = |M|², and within 1e-2 of it, over four periods."""
    assert 0 < case.m < 1
    times = np.linspace(-1.0, 3.0, 121) * 4 * ellipk(case.m) / case.rate
    start = with_momentum(case.omega(np.zeros(1)))[0]
    motion = integrate(BODY, start, times, integrator)
    # ellipj is good to some 1e-15 of its argument, which is below 50.
    assert np.abs(motion.samples - with_momentum(case.omega(times))).max() <= motion.error + 1e-13


@pytest.mark.parametrize("integrator", ["taylor", HEYOKA, "dop853"])
def test_separatrix(integrator):
    """2 h B = |M|²: p, r ~ sech, q ~ tanh, from one unstable rotation about the middle axis to the other."""
    r0 = 1.0
    p0, rate = r0 * np.sqrt(C * (B - C) / (A * (A - B))), r0 * np.sqrt((A - C) * (B - C) / (A * B))
    q0 = -A * p0 * rate / ((B - C) * r0)
    times = np.linspace(-15.0, 15.0, 61)
    sech = 1 / np.cosh(rate * times)
    exact = with_momentum(np.stack([p0 * sech, q0 * np.tanh(rate * times), r0 * sech], axis=-1))
    motion = integrate(BODY, exact[30], times, integrator)
    # Errors grow like exp(rate t), by some 500: the claim has that growth.
    assert np.abs(motion.samples - exact).max() <= motion.error


@pytest.mark.parametrize("integrator", ["taylor", HEYOKA, "dop853"])
def test_two_equal_moments(integrator):
    """A = B: r is constant, (p, q) turns uniformly at the rate (A - C) r / A."""
    body = RigidBody(Fraction(2), Fraction(2), Fraction(1))
    r, size, phase = 0.8, 0.5, 0.3
    times = np.linspace(-20.0, 60.0, 121)
    turn = (2.0 - 1.0) * r / 2.0 * times + phase
    exact = np.stack([size * np.cos(turn), -size * np.sin(turn), np.full(len(times), r)], axis=-1)
    exact = with_momentum(exact, (2.0, 2.0, 1.0))
    start = np.array([size * np.cos(phase), -size * np.sin(phase), r])
    motion = integrate(body, with_momentum(start[None], (2.0, 2.0, 1.0))[0], times, integrator)
    # Arguments of up to 24, rounded.
    assert np.abs(motion.samples - exact).max() <= motion.error + 1e-14
