"""Where the energy of the motions does not depend on λ both transverse multipliers are 1, for every B."""

import pytest

from tests.workers.solvers.stability.cases import case, lambda_, nu

QUADRATIC = "(3*g1^2 + g3^2)*(g2^2 - 1/2 + g2^3/5)"
ELLIPTIC = "g1 + {b}/g3^2 - 3*(g1^2 - g2^2)"
"""h = nu a/2 + ... has dh/dnu = 0 at nu³ = 8 b."""


@pytest.mark.parametrize("B", ["1/2", "5/2", "4", "10"])
def test_potentials_without_energy_are_marginal(B):
    stability = case(3, B, 1, QUADRATIC, lambda_("4/5")).assess()
    assert stability.verdict == "marginal"
    # The claim: some hundred roundings. The theorem: the trace is exactly 2.
    assert abs(stability.trace - 2.0) <= stability.error <= 5e-12


@pytest.mark.parametrize("B", ["3/2", "5/2"])
def test_stationary_energy_is_marginal(B):
    stability = case(2, B, 1, ELLIPTIC.format(b="1/8"), nu(1)).assess()
    assert stability.verdict == "marginal"
    assert abs(stability.trace - 2.0) <= stability.error <= 1e-12


def test_beside_stationary_energy_is_unstable():
    stability = case(2, "3/2", 1, ELLIPTIC.format(b="1/10"), nu(1)).assess()
    assert stability.verdict == "unstable"
    # A Taylor integration of the six equations, which vouches for 4e-13 of tr M = 9.86...: 2e-12 of room.
    assert abs(stability.trace - 5.863685198505) <= 2e-12


def test_a_corner_of_the_field_is_closed_in_on():
    # V_2 has a corner at g2 = 0, where no panel begins.
    stability = case(
        3, "5/2", 1, "(3*g1^2 + g3^2)*(g2^2 - 1/2 + g2/20 + g2*abs(g2)/5)", lambda_("4/5")
    ).assess()
    assert stability.verdict == "marginal"
    # Some hundred panels, a rounding each.
    assert abs(stability.trace - 2.0) <= stability.error <= 5e-12
