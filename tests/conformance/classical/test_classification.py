"""Cases on which a state lies: the case it was taken from, and an honest distance from it beside it."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.classical.classification import classify
from tests.conformance.classical.specimens import NAMES, example, placed

every = pytest.mark.parametrize("name", NAMES)


def exact(values):
    return tuple(Fraction(float(value)) for value in values)


def classification(motion, state):
    return classify(motion.body, motion.motion.centre, exact(state[:3]), exact(state[3:]))


def of(found, name):
    return next(each for each in found.cases if each.case == name)


@every
def test_the_start_of_a_case_lies_on_it_and_on_no_other(name: str):
    motion = placed(example(name))
    found = classification(motion, [*motion.start.omega, *motion.start.gamma])
    assert [each.case for each in found.cases if each.is_on] == [name]
    assert not any(each.holds for each in found.integrable)


@pytest.mark.one_in(4)
@every
@pytest.mark.parametrize("size", [1e-3, 1e-6, 1e-9])
def test_a_displaced_state_is_no_farther_than_it_was_displaced(name: str, size: float):
    motion = placed(example(name))
    start = np.array([float(x) for x in (*motion.start.omega, *motion.start.gamma)])
    random = np.random.default_rng(7)
    for _ in range(4):
        step = random.normal(size=6)
        near = of(classification(motion, start + size * step / np.linalg.norm(step)), name)
        # The point that the steps lead to is the nearest one up to the curvature, of some 1e3 at worst.
        assert near.distance <= size * (1.0 + min(1e3 * size, 0.05)) + 1e-14
        assert near.distance > 1e-3 * size
        assert not near.is_on


def test_a_steady_rotation_displaced_by_0_001_is_not_0_0047_away():
    motion = placed(example("staude"))
    start = np.array([float(x) for x in (*motion.start.omega, *motion.start.gamma)])
    for k in range(6):
        moved = start + 0.001 * np.eye(6)[k]
        assert of(classification(motion, moved), "staude").distance <= 0.00101


@pytest.mark.parametrize(("moments", "centre", "areas", "case"), [
    ((3, 2, 1), (0, 0, 0), 1, "euler"), ((2, 2, 1), (0, 0, 1), 1, "lagrange"),
    ((1, 2, 2), (1, 0, 0), 1, "lagrange"),
    ((2, 2, 1), (1, 1, 0), 1, "kovalevskaya"), ((2, 1, 2), (0, 0, 1), 1, "kovalevskaya"),
    ((4, 4, 1), (1, 2, 0), 0, "goriachev_chaplygin"), ((4, 4, 1), (1, 2, 0), 1, None),
    ((4, 4, 1), (1, 2, "1/1000"), 0, None), ((2, 2, "1001/1000"), (1, 1, 0), 1, None),
])  # fmt: skip
def test_integrable_cases_are_recognised(moments, centre, areas, case):
    body = RigidBody(*map(Fraction, moments), allow_unphysical=True)
    gamma = (Fraction(3, 5), Fraction(0), Fraction(4, 5))
    A, _, C = map(Fraction, moments)
    # omega across gamma in its momentum, or not.
    omega = (Fraction(4, 5) / A, Fraction(1), Fraction(-3, 5) / C + areas)
    found = classify(body, tuple(map(Fraction, centre)), omega, gamma)
    assert [each.case for each in found.integrable if each.holds] == ([] if case is None else [case])
