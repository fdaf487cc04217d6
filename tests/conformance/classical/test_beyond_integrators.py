"""Unstable cases to t = 1000, where no integration in doubles follows them: the quadratures keep 1e-10."""

import numpy as np
import pytest

from service.dynamics.classical.classification import relations_of
from service.dynamics.equations.euler_poisson import areas_integral, energy_integral
from service.schemas.problem.problem import read_problem
from tests.conformance.classical.specimens import document, example, placed
from tests.support.effort import seldom
from workers.computation.compute import solve
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.integration.solve import integrate_state

LATEST = 1000
CASES = {
    "hess": example("hess"),
    "steklov": document("steklov", {"A": 1, "B": "6/5", "C": "2/5"}, {"a": 1}, {}),
    "chaplygin": example("chaplygin"),
}
every = pytest.mark.parametrize("name", ["hess", *seldom("steklov", "chaplygin")])
STRETCH = 5.0
"""So short that an integration multiplies what it starts from by some ten."""


def motion_of(name: str, **other: object):
    return solve(read_problem({**CASES[name], "time": {"stop": LATEST, "samples": 201}, **other}))


@every
def test_the_claim_is_below_1e_10_and_the_integrals_and_relations_hold(name: str, motions):
    problem, motion = read_problem(CASES[name]), motions[name]
    assert motion.method == "quadrature"
    assert motion.error < 1e-10
    omega, gamma = motion.samples[:, :3], motion.samples[:, 3:]
    assert np.ptp(energy_integral(problem.body, problem.potential, omega, gamma)) < 1e-10
    assert np.ptp(areas_integral(problem.body, omega, gamma)) < 1e-10
    assert np.abs((gamma**2).sum(axis=1) - 1.0).max() < 1e-10
    assert relations_of(placed(CASES[name])).distance(motion.samples) < 1e-10


@pytest.fixture(scope="module")
def motions():
    """Return a table that computes each motion once, when it is asked for: that of Hess takes seconds."""

    class Motions(dict):
        def __missing__(self, name: str):
            return self.setdefault(name, motion_of(name))

    return Motions()


@every
def test_from_its_own_states_the_integration_goes_where_it_goes(name: str, motions):
    problem, motion = read_problem(CASES[name]), motions[name]
    for begin in np.linspace(0.0, LATEST - STRETCH, 14):
        start, end = motion.dense(np.array([begin, begin + STRETCH]))
        found = integrate_state(
            problem.body, problem.potential, start[:3], start[3:], np.array([STRETCH]), tolerance=1e-8
        )
        assert np.abs(found.samples[0] - end).max() < 1e-10


@every
def test_the_integration_is_refused_or_says_how_far_it_is(name: str):
    with pytest.raises(AccuracyNotMetError):
        motion_of(name, method="integration")


@pytest.mark.parametrize(
    "omega", [["1/2", 0, None], [0, "1/2", 0], ["1/2", "1/100", None], [0, 2, 0], [0, 3, 0]]
)
def test_hess_is_followed_with_any_areas_integral(omega: list[object]):
    # With gamma = (3/5, 0, 4/5) and r = -2p the areas integral is 9p/5 - 12p/5: zero without p, where the
    # momentum passes through zero, or, with more energy, never does.
    motion = {"omega": omega, "gamma": ["3/5", 0, "4/5"]}
    statement = document("hess", {"A": 3, "B": 2, "C": "3/2"}, {"a": 1, "c": 1}, motion)
    asked = {"time": {"stop": 8, "samples": 41}, "method": "both", "accuracy": {"tolerance": 1e-8}}
    found = solve(read_problem({**statement, **asked}))
    assert found.cross_check.agrees
    assert found.cross_check.horizon > 5.0
    # Errors of the start grow by some hundred in so long.
    assert found.cross_check.disagreement < 1e-10


def test_a_body_of_hess_that_starts_at_rest_is_integrated():
    motion = {"omega": [0, 0, 0], "gamma": ["3/5", 0, "4/5"]}
    found = solve(read_problem(document("hess", {"A": 3, "B": 2, "C": "3/2"}, {"a": 1, "c": 1}, motion)))
    assert found.method == "integration"
    assert found.error <= 1e-10
