"""The claimed error bounds the actual one, measured against 64-bit significands."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.written import expression_potential
from tests.support.effort import examples
from tests.support.heyoka_integrator import HEYOKA
from tests.workers.solvers.integration.cases import NAMES, reference
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.integration.solve import integrate_state

ratios = st.integers(-20, 20).map(lambda n: Fraction(n, 7))
moments = st.integers(7, 30).map(lambda n: Fraction(n, 9))
exponents = st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 3)).filter(any)
terms = st.lists(st.tuples(ratios, exponents), min_size=1, max_size=3)
PYTHAGOREAN = [(2, 3, 6, 7), (1, 4, 8, 9), (4, 4, 7, 9), (2, 6, 9, 11), (0, 3, 4, 5), (3, 4, 12, 13)]
units = st.tuples(st.sampled_from(PYTHAGOREAN), st.permutations(range(3)), st.sampled_from([1, -1])).map(
    lambda choice: tuple(Fraction(choice[2] * choice[0][i], choice[0][3]) for i in choice[1])
)
TIMES = np.array([-3.0, 0.5, 7.0])


def written(problem) -> str:
    return " + ".join(f"({c})*g1^{i}*g2^{j}*g3^{k}" for c, (i, j, k) in problem)


def flat(problem):
    return [(c, i, j, k) for c, (i, j, k) in problem]


@pytest.mark.one_in(2)
@pytest.mark.random_law
@pytest.mark.parametrize(
    ("name", "count"),
    [("taylor", examples(12, 60)), (HEYOKA, examples(12, 60)), ("dop853", examples(10, 25))],
)
def test_claim_bounds_the_actual_error(name, count):
    factors = []

    @settings(max_examples=count, deadline=None, derandomize=True, database=None)
    @given(
        moments,
        moments,
        moments,
        terms,
        st.tuples(ratios, ratios, ratios),
        units,
        st.sampled_from([1e-6, 1e-8, 1e-10, 1e-12]),
    )
    def check(A, B, C, problem, omega, gamma, tolerance):
        body = RigidBody(A, B, C, allow_unphysical=True)
        field = expression_potential(written(problem), {}, body)
        try:
            motion = integrate_state(body, field, omega, gamma, TIMES, tolerance=tolerance, integrator=name)
        except AccuracyNotMetError:
            return  # DOP853 in doubles has no 1e-12 for fast motions, and says so
        truth = reference(body, flat(problem), (*omega, *gamma), TIMES)
        actual = np.abs(motion.samples - truth).max()
        assert actual <= motion.error <= tolerance
        factors.append(motion.error / max(actual, 1e-16))

    check()
    assert len(factors) >= count // 2
    # A bound that is thousands of times too large would be no estimate.
    assert np.median(factors) <= 3000.0


@pytest.mark.parametrize("name", NAMES)
def test_claim_grows_with_an_instability(name):
    """A body spun about its middle axis, almost: errors grow exponentially and the claim with them."""
    body = RigidBody(Fraction(3), Fraction(2), Fraction(1), allow_unphysical=True)
    omega, gamma = (
        (Fraction(0), Fraction(2), Fraction(1, 10**6)),
        (Fraction(3, 5), Fraction(0), Fraction(4, 5)),
    )
    field = expression_potential("g1/10", {}, body)
    claims = []
    # The motion leaves the axis at t = 12. Before, there is only what long steps leave of the steady turn.
    for end in (15.0, 20.0, 25.0) if name == "taylor" else (5.0, 15.0, 25.0):
        times = np.array([end])
        motion = integrate_state(body, field, omega, gamma, times, tolerance=1e-3, integrator=name)
        truth = reference(body, [(Fraction(1, 10), 1, 0, 0)], (*omega, *gamma), times)
        assert np.abs(motion.samples - truth).max() <= motion.error
        claims.append(motion.error)
    assert claims[0] < claims[1] < claims[2]
