"""Integrations of the six equations: they leave the plane as the multipliers say."""

import numpy as np
import pytest

from tests.support.heyoka_integrator import HEYOKA
from tests.workers.solvers.stability.cases import Case, bobylev_steklov, case, nu
from workers.solvers.integration.solve import integrate_state

PER_PERIOD = 8


def unstable() -> Case:
    return case(2, "3/2", 1, "g1 + 1/(10*g3^2) - 3*(g1^2 - g2^2)", nu(1))


def largest_q(found: Case, q: float, periods: int) -> np.ndarray:
    """Integrate from the planar motion with this q added; return the largest |q| in each period."""
    state = found.state()
    omega = (state[0], q, state[2])
    times = np.arange(PER_PERIOD * periods) * (found.period.hi / PER_PERIOD)
    # heyoka's steps are as fine as doubles allow, whatever the tolerance: what grows are roundings.
    motion = integrate_state(
        found.body, found.potential, omega, state[3:], times, tolerance=0.1, integrator=HEYOKA
    )
    return np.abs(motion.samples[:, 1]).reshape(periods, PER_PERIOD).max(axis=1)


@pytest.mark.parametrize("make", [lambda: bobylev_steklov(2, 3), unstable], ids=["gravity", "elliptic"])
def test_a_small_q_grows_by_the_multiplier(make):
    found = make()
    q = largest_q(found, 1e-11, 8)
    mu = abs(found.assess().multipliers[0])
    # After three periods the shrinking part, 1/mu, is below 1e-4 of the growing one, as is what
    # second order makes of q <= 1e-5. Measured: 1e-4.
    assert np.allclose(q[4:] / q[3:-1], mu, rtol=1e-3)


def test_roundings_are_below_the_tolerance_for_the_trusted_time_and_not_much_longer():
    found = unstable()
    # How the roundings fall is a matter of chance and of the integrator: three periods are a factor 180.
    for tolerance in (1e-10, 1e-8, 1e-6):
        stability = found.assess(tolerance)
        trusted = int(stability.trusted_time // found.period.hi)
        q = largest_q(found, 0.0, trusted + 4)
        assert q[:trusted].max(initial=0.0) <= tolerance < q[-1] * 10.0


def test_a_stable_motion_keeps_to_its_plane():
    found = bobylev_steklov(1, 2)
    stability = found.assess()
    q = largest_q(found, 1e-9, 25)
    assert stability.verdict == "stable"
    assert stability.exponent == 0.0
    # Bounded by the norms of the powers of the monodromy, a factor 20 here; it would be mu^25 otherwise.
    assert q.max() <= 2e-8
