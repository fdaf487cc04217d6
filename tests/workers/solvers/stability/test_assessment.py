"""Verdicts, multipliers and trusted times from given monodromies; and what is refused."""

import numpy as np
import pytest
from flint import ctx

from service.dynamics.errors import MissingMomentError
from service.dynamics.solution.dense_output import Period
from tests.workers.solvers.stability.cases import Case, bobylev_steklov, case, lambda_, nu
from workers.solvers.errors import PrecisionLostError, QuadratureNotConvergedError
from workers.solvers.orbits.orbit import make_orbit
from workers.solvers.stability import monodromy as turns
from workers.solvers.stability.assessment import (
    MAX_PERIODS,
    UNIT_ROUNDOFF,
    hill_monodromy,
    trusted_time,
)
from workers.solvers.stability.monodromy import StabilityUndefinedError

PERIOD = Period(2.0 * np.pi, 0.0, 0.0)
"""T = 2π: frequency 1."""


def trusted(matrix, tolerance, speed=1.0, roundoff=UNIT_ROUNDOFF):
    return trusted_time(np.array(matrix), 1.0, speed, PERIOD.hi, tolerance, roundoff)


MATRICES = {
    "stable": [[0.6, 3.2], [-0.2, 0.6]],
    "nearly a shear": [[0.99999, 1.0], [-1.99999e-5, 0.99999]],
    "unstable": [[1.1, 0.3], [0.7, 1.1]],
    "four variables": np.kron([[1.0, 0.5], [0.0, 1.0]], [[0.8, 0.6], [-0.6, 0.8]]),
}


@pytest.mark.parametrize("name", MATRICES)
@pytest.mark.parametrize("count", [1, 7, 300])
def test_the_trusted_time_is_that_of_the_sum_of_all_powers(name, count):
    """Σ‖M^k‖² one by one; by Cauchy and Schwarz it bounds the sum of the norms, from above."""
    M = np.array(MATRICES[name])
    norms = np.array([np.linalg.norm(np.linalg.matrix_power(M, k)) for k in range(count + 1)])
    reached = [np.sqrt((n + 1) * np.square(norms[: n + 1]).sum()) for n in (count - 1, count)]
    assert reached[1] >= norms.sum()
    # Halfway between two of them, in logarithms. Powers have the roundings of as many products.
    found = trusted(M, UNIT_ROUNDOFF * np.sqrt(reached[0] * reached[1]))
    assert found == pytest.approx((count - 0.5) * PERIOD.hi, rel=1e-9)


@pytest.mark.parametrize("decades", [2, 4, 6])
def test_a_turn_of_variables_of_unlike_sizes_has_a_trusted_time(decades):
    """Squares of its powers cancel to what is negative, if they are summed as they are."""
    turn = np.eye(6) + np.eye(6, k=1)
    for seed in range(30):
        random = np.random.default_rng(seed)
        left, right = random.normal(size=(2, 6, 6))
        units = left @ np.diag(10.0 ** random.uniform(-decades, 0, 6)) @ right
        found = trusted_time(units @ turn @ np.linalg.inv(units), 1.0, 1.0, PERIOD.hi, 1e-9)
        # Its powers grow like the fifth power of their number at least, as long as rounding leaves them.
        assert 0.0 <= found <= 1e3 * PERIOD.hi


def test_trusted_time_of_an_unstable_motion_is_logarithmic():
    one, two = (trusted([[4.0, 0.0], [0.0, 0.25]], 1e-9 * by) for by in (1.0, 4.0**5))
    # Five periods for five factors of mu = 4; the root of 16 over 11 is a quarter of a factor of 4.
    assert two - one == pytest.approx(5.0 * PERIOD.hi, rel=0.06)
    alone = np.log(1e-9 / UNIT_ROUNDOFF) / (np.log(4.0) / PERIOD.hi)
    # What is lost to the root of the number of periods and to the sum of their roundings.
    assert alone - 1.5 * PERIOD.hi <= one <= alone


def test_trusted_time_of_a_rotation_is_proportional():
    M = [[0.6, 0.8], [-0.8, 0.6]]
    # Every period adds one rounding of norm √2.
    assert trusted(M, 1e5 * np.sqrt(2.0) * UNIT_ROUNDOFF) == pytest.approx((1e5 - 1.0) * PERIOD.hi)
    assert trusted(M, 2.0 * MAX_PERIODS * UNIT_ROUNDOFF) is None
    assert trusted(M, UNIT_ROUNDOFF) == 0.0


def test_trusted_time_of_a_shear_grows_like_the_root():
    one, two = (trusted([[1.0, 3.0], [0.0, 1.0]], np.sqrt(3.0) * n**2 * UNIT_ROUNDOFF) for n in (1e3, 2e3))
    # The root of n times the sum of (3 k)² for k <= n; what is left out is of order 1/n.
    assert one == pytest.approx(1e3 * PERIOD.hi, rel=2e-3)
    assert two == pytest.approx(2.0 * one, rel=2e-3)


def test_faster_motions_and_smaller_roundings():
    M = [[4.0, 0.0], [0.0, 0.25]]
    # A rounding of a speed four times as large is one four times as large, a tolerance a quarter of it.
    assert trusted(M, 1e-8, speed=4.0) == pytest.approx(trusted(M, 0.25e-8), rel=1e-12)
    assert trusted(M, 1e-8, roundoff=UNIT_ROUNDOFF / 4.0) == pytest.approx(trusted(M, 4e-8), rel=1e-12)


@pytest.mark.parametrize("B", ["1/2", "1", "2", "3", "4"])
def test_multipliers_solve_their_equation(B):
    stability = bobylev_steklov(2, B).assess()
    one, other = stability.multipliers
    # Roundings of numbers of size trace.
    assert abs(one + other - stability.trace) <= 4e-16 * max(2.0, abs(stability.trace))
    assert abs(one * other - 1.0) <= 4e-16
    assert abs(one) >= abs(other)
    assert stability.exponent == pytest.approx(
        max(0.0, np.log(abs(one))) / bobylev_steklov(2, B).period.hi, abs=1e-15 + stability.exponent_error
    )


def test_the_moment_B_is_needed():
    missing = case(2, None, 1, "-g1", nu(1))
    for needed in (missing.assess, missing.jacobian):
        with pytest.raises(MissingMomentError, match="stability needs the moment B"):
            needed()


def test_an_undefined_stability_says_so_with_its_place():
    with pytest.raises(StabilityUndefinedError) as caught:
        case(3, 2, 1, "-abs(g1)^(4/3)", lambda_(1)).assess()
    assert (caught.value.code, caught.value.pointer) == ("stability_undefined", "/outputs")


def test_too_few_bits_are_noticed():
    found = bobylev_steklov(1, 2)
    with ctx.workprec(56), pytest.raises(PrecisionLostError):
        hill_monodromy(found.body, found.potential, make_orbit(found.start), found.period)


def test_more_panels_than_allowed(monkeypatch):
    monkeypatch.setattr(turns, "MAX_PANELS", 3)
    with pytest.raises(QuadratureNotConvergedError, match="3 panels"):
        bobylev_steklov(1, 2).hill()


def test_next_to_a_separatrix_panels_follow_the_motion():
    # c1 = (1 + √5)/4 is a separatrix; 1e-8 beside it the motion rests for most of 41 time units.
    found: Case = case(2, "3/2", 1, "-g1 + 809017/1000000*(g1^2 - g2^2)", nu(1))
    hill = found.hill()
    assert found.period.hi > 40.0
    # Roundings of some fifty panels.
    assert hill.error <= 5e-12
    assert abs(np.linalg.det(hill.matrix) - 1.0) <= hill.error
