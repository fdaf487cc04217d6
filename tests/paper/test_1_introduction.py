"""Section 1 of the paper: the equations of motion and their integrals."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.equations.euler_poisson import areas_integral, energy_integral, geometric_integral
from service.dynamics.potentials.families.coefficients import gravity_potential
from tests.paper.forms import printed_rates, service_rates
from tests.support.planar import body, formula

# Moments that are powers of two and integers elsewhere: doubles are exact, so = means =.
MOMENTS = (4, 8, 2)
BODY = body(4, 2, 8)
POTENTIAL = formula("3*g1 - 2*g2^2*g3 + g1*g3^2 + 5*g2*g1 - 7*g3", BODY)
STATES = [
    ((2, -3, 5), (1, 4, -2)),
    ((-7, 1, 3), (-5, 2, 6)),
    ((1, 1, -4), (3, -1, 8)),
    ((6, -2, 0), (0, 9, -7)),
]
both = pytest.mark.parametrize(("omega", "gamma"), STATES)


def slope(g1: int, g2: int, g3: int) -> list[int]:
    return [3 + g3**2 + 5 * g2, -4 * g2 * g3 + 5 * g1, -2 * g2**2 + 2 * g1 * g3 - 7]


@both
def test_1_euler(omega, gamma):
    """(1): A p' + (C-B) q r = g2 V_3 - g3 V_2 and the two others, against the service's right-hand sides."""
    rates = service_rates(BODY, POTENTIAL, omega, gamma)
    moments_times_rates, _ = printed_rates(MOMENTS, slope(*gamma), omega, gamma)
    assert (np.array(MOMENTS) * rates.omega).tolist() == moments_times_rates


@both
def test_2_poisson(omega, gamma):
    """(2): g1' + q g3 - r g2 = 0 and the two others, against the service's right-hand sides."""
    (p, q, r), (g1, g2, g3) = omega, gamma
    d1, d2, d3 = service_rates(BODY, POTENTIAL, omega, gamma).gamma.tolist()
    assert (d1 + q * g3 - r * g2, d2 + r * g1 - p * g3, d3 + p * g2 - q * g1) == (0, 0, 0)


def test_classical_potential():
    """Text after (2): V = a g1 + b g2 + c g3 of the heavy body, against the service's gravity family."""
    V = gravity_potential(Fraction(3), Fraction(-5), Fraction(1, 2))
    assert V.value(np.array([2.0, 7.0, 4.0])) == 6 - 35 + 2
    assert V.gradient(np.array([2.0, 7.0, 4.0])).tolist() == [3, -5, 0.5]


@both
def test_E_energy(omega, gamma):
    """(E): I1 = (A p² + B q² + C r²)/2 + V is the service's energy, and dI1/dt = 0 by (1), (2)."""
    (p, q, r), (g1, g2, g3) = omega, gamma
    V = 3 * g1 - 2 * g2**2 * g3 + g1 * g3**2 + 5 * g2 * g1 - 7 * g3
    state = np.array(omega, float), np.array(gamma, float)
    assert energy_integral(BODY, POTENTIAL, *state) == (4 * p * p + 8 * q * q + 2 * r * r) / 2 + V
    rates = service_rates(BODY, POTENTIAL, omega, gamma)
    momentum = np.array(MOMENTS) * state[0]
    assert momentum @ rates.omega + np.array(slope(*gamma)) @ rates.gamma == 0


@both
def test_g_geometric(omega, gamma):
    """(g): I2 = g1² + g2² + g3² is the service's geometric integral, and dI2/dt = 0 by (2)."""
    assert geometric_integral(np.array(gamma, float)) == sum(g * g for g in gamma)
    assert np.array(gamma) @ service_rates(BODY, POTENTIAL, omega, gamma).gamma == 0


@both
def test_a_areas(omega, gamma):
    """(a): I3 = A p g1 + B q g2 + C r g3 is the service's areas integral, and dI3/dt = 0 by (1), (2)."""
    (p, q, r), (g1, g2, g3) = omega, gamma
    state = np.array(omega, float), np.array(gamma, float)
    assert areas_integral(BODY, *state) == 4 * p * g1 + 8 * q * g2 + 2 * r * g3
    rates = service_rates(BODY, POTENTIAL, omega, gamma)
    assert np.array(MOMENTS) * rates.omega @ state[1] + np.array(MOMENTS) * state[0] @ rates.gamma == 0
