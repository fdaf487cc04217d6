"""The body as a physical pendulum about each axis, swinging and turning over: the degenerate planes.

The planar solutions on |g3| = λ |g1|^(C/A) have two limits: λ = 0 is the plane
g3 = p = 0, if V_3 = 0 there, and λ = ∞ the plane g1 = r = 0, if V_1 = 0 there.
In them the energy is free. The pendulum I θ'' = -k sin(n θ) has, with φ = n θ,
w² = n k / I and φ' = 2 κ w at the bottom,

    κ < 1:   sin(φ/2) = κ sn(w t | κ²),    cos(φ/2) = dn,   φ' = 2 κ w cn,
    κ > 1:   sin(φ/2) = sn(κ w t | 1/κ²),  cos(φ/2) = cn,   φ' = 2 κ w dn.
"""

from fractions import Fraction

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.written import expression_potential
from tests.support.effort import one_in
from tests.support.heyoka_integrator import HEYOKA
from workers.solvers.integration.solve import integrate_state

BODY = RigidBody(Fraction(2), Fraction(3, 2), Fraction(1))
MOMENTS = (2.0, 1.5, 1.0)


def pendulum(kappa: float, w: float, times):
    """Return φ and φ', from the bottom."""
    if kappa < 1:
        sn, cn, dn, _ = ellipj(w * times, kappa**2)
        return 2 * np.arctan2(kappa * sn, dn), 2 * kappa * w * cn
    sn, cn, dn, _ = ellipj(kappa * w * times, kappa**-2)
    return 2 * np.arctan2(sn, cn), 2 * kappa * w * dn


def period(kappa: float, w: float) -> float:
    return float(4 * ellipk(kappa**2) / w if kappa < 1 else 2 * ellipk(kappa**-2) / (kappa * w))


# (axis of rotation, V, k, n, bottom, side): with γ = (cos θ, sin θ) on the axes (bottom, side), in the plane
# V = -(k/n) cos(n θ) + const; the other terms have no gradient there.
PLANES = [
    (0, "-3/4*g2 + g1^2*(g2 - 3*g3^2)", 0.75, 1, 1, 2),
    (0, "-3/4*g3 - g1^2*exp(g2)", 0.75, 1, 2, 1),
    (1, "-3/4*g3 + g2^2*(g1 + g3^3)", 0.75, 1, 2, 0),
    (2, "-3/4*g1 + g3^4/(2 + g2)", 0.75, 1, 0, 1),
    # Admissible fields, λ = 0 or λ = ∞: Bobylev and Steklov's, g1² - g2² = -g2² or -cos 2θ, and
    # (2 g1² + g3²) g2² = (1 - cos 4θ)/4.
    (2, "-3/4*g1", 0.75, 1, 0, 1),
    (0, "3/4*(g1^2 - g2^2)", 0.75, 2, 1, 2),
    (2, "3/4*(g1^2 - g2^2)", 1.5, 2, 1, 0),
    (2, "(2*g1^2 + g3^2)*g2^2", 1.0, 4, 0, 1),
]
RIGHT_HANDED = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


@pytest.mark.parametrize("integrator", ["taylor", HEYOKA, "dop853"])
@pytest.mark.parametrize("kappa", [0.3, 0.95, 1.05, 2.5])
@pytest.mark.parametrize(("axis", "text", "strength", "n", "bottom", "side"), one_in(9, PLANES))
def test_body_in_a_principal_plane(axis, text, strength, n, bottom, side, kappa, integrator):
    w = np.sqrt(strength * n / MOMENTS[axis])
    times = np.linspace(0.0, 2.0, 61) * period(kappa, w)
    phi, rate = pendulum(kappa, w, times)
    theta = np.unwrap(phi) / n
    # γ is fixed in space: seen from the body it turns against ω.
    sign = -1.0 if (axis, bottom, side) in RIGHT_HANDED else 1.0
    exact = np.zeros((61, 6))
    exact[:, axis], exact[:, 3 + bottom], exact[:, 3 + side] = sign * rate / n, np.cos(theta), np.sin(theta)
    omega, gamma = exact[0, :3].tolist(), exact[0, 3:].tolist()
    potential = expression_potential(text, {}, BODY)
    motion = integrate_state(BODY, potential, omega, gamma, times, tolerance=1e-10, integrator=integrator)
    # The rounded start sets the period, by up to 1/|1 - κ²| ulp near the top: the claim has that. The
    # closed form has rounded arguments of up to 20.
    assert np.abs(motion.samples - exact).max() <= motion.error + 1e-13
    # The plane is kept exactly: the rates of the other three variables are products with zeros.
    others = [index for index in range(6) if index not in (axis, 3 + bottom, 3 + side)]
    assert np.all(motion.samples[:, others] == 0.0)
