"""Lagrange's top, A = B and V = c g3: nutation by an elliptic integral, steady and regular precession."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.coefficients import gravity_potential
from tests.support.heyoka_integrator import HEYOKA
from workers.solvers.integration.solve import integrate_state

ZERO = Fraction(0)
A, C, WEIGHT = 1.5, 1.0, 0.75
BODY = RigidBody(Fraction(3, 2), Fraction(3, 2), Fraction(1))
FIELD = gravity_potential(ZERO, ZERO, Fraction(3, 4))


def integrate(omega, gamma, times, integrator):
    return integrate_state(BODY, FIELD, omega, gamma, times, tolerance=1e-10, integrator=integrator)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("integrator", ["taylor", HEYOKA, "dop853"])
@pytest.mark.parametrize(
    ("p", "r", "g3"), [(0.0, 2.0, 0.6), (0.4, 1.5, 0.6), (-1.0, 0.7, -0.28), (0.3, 0.0, 0.8), (2.0, 0.5, 0.0)]
)
def test_nutation(p, r, g3, integrator):
    """u = g3: u'² = (2/A)(1 - u²)(h - C r²/2 - c u) - ((I3 - C r u)/A)², a cubic with c > 0.

    Between its roots u1 < u2 < 1 < u3 the motion is u1 + (u2 - u1) sn²(k t + phase), k² = c (u3 - u1)/(2 A).
    """
    g1 = np.sqrt(1 - g3**2)
    # q = 0 and γ = (g1, 0, g3): u' = q g1 - p g2 = 0, a turning point.
    energy, areas = A * p**2 / 2 + WEIGHT * g3, A * p * g1 + C * r * g3
    cubic = np.polynomial.Polynomial([2 * energy / A, -2 * WEIGHT / A]) * np.polynomial.Polynomial([1, 0, -1])
    cubic = cubic - np.polynomial.Polynomial([areas / A, -C * r / A]) ** 2
    u1, u2, u3 = (x.real for x in sorted(cubic.roots(), key=lambda x: x.real))
    k, m = np.sqrt(WEIGHT * (u3 - u1) / (2 * A)), (u2 - u1) / (u3 - u1)
    period = 2 * ellipk(m) / k
    times = np.linspace(0.0, 3 * period, 91)
    motion = integrate((p, 0.0, r), (g1, 0.0, g3), times, integrator)
    starts_low = abs(g3 - u1) < abs(g3 - u2)
    sn, cn, dn, _ = ellipj(k * times, m)
    # Half a period later sn becomes cn/dn.
    u = u1 + (u2 - u1) * (sn if starts_low else cn / dn) ** 2
    # Roots of a cubic by eigenvalues, rounded by some 1e-15, set the period: times 3.
    assert np.abs(motion.samples[:, 5] - u).max() <= motion.error + 1e-13
    # No torque about the axis of symmetry, and none in the computed equation: (A - B) p q + g1·0 - g2·0.
    assert np.abs(motion.samples[:, 2] - r).max() <= 1e-14
    # In each nutation γ advances about the axis by the same angle; the angle is 1/sin θ as uncertain.
    angles = np.unwrap(np.arctan2(motion.samples[:, 4], motion.samples[:, 3]))[::30]
    assert np.diff(angles) == pytest.approx(np.full(3, angles[1] - angles[0]), abs=20 * motion.error)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("integrator", ["taylor", HEYOKA, "dop853"])
@pytest.mark.parametrize(("rate", "g3"), [(0.5, 0.6), (2.0, 0.6), (-0.8, -0.28), (1.2, 0.0)])
def test_steady_precession(rate, g3, integrator):
    """ω = Ω γ + σ e3 with C Ω r = A Ω² g3 + c: γ turns about the axis at the rate -σ."""
    g1 = np.sqrt(1 - g3**2)
    r = (A * rate**2 * g3 + WEIGHT) / (C * rate)
    spin = r - rate * g3
    times = np.linspace(0.0, 40.0, 81)
    motion = integrate((rate * g1, 0.0, r), (g1, 0.0, g3), times, integrator)
    gamma = np.stack([g1 * np.cos(spin * times), -g1 * np.sin(spin * times), np.full(81, g3)], axis=-1)
    omega = rate * gamma + [0.0, 0.0, spin]
    # r, rounded, is that of a precession with a nutation of some ulp; arguments of up to 100 are rounded too.
    assert np.abs(motion.samples - np.hstack([omega, gamma])).max() <= motion.error + 3e-14
