"""Motions that cannot be followed: each ends with its cause and the time that was reached."""

import re
from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.errors import MissingMomentError
from service.dynamics.potentials.families.coefficients import gravity_potential
from service.dynamics.potentials.families.written import expression_potential
from tests.support.heyoka_integrator import HEYOKA
from tests.workers.solvers.integration.cases import BODY, NAMES, planar_state
from workers.solvers.errors import (
    AccuracyNotMetError,
    CollisionError,
    StepCollapseError,
    UnsupportedFormulaError,
)
from workers.solvers.integration import solve
from workers.solvers.integration.solve import choose_integrator, integrate_state

X1 = 2.0 / (1.0 + np.sqrt(5.0))
AT_EQUATOR = (X1, 0.0, np.sqrt(X1))
ONE = Fraction(1)
TO_TEN = np.array([10.0])


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("s_sign", [1, -1])
@pytest.mark.parametrize(
    ("b1", "time"), [("-1/20", 1.06647559407919763218981408942), ("-1/5", 0.82119911108083424708898369890624)]
)
def test_collision_is_reported_at_its_time(name, s_sign, b1, time):
    """V = -g1 + b1/g3² - (g1² - g2²)/2 from x = x1: |p| → ∞ at a time known from elliptic functions."""
    field = expression_potential("-g1 + b/g3^2 - (g1^2-g2^2)/2", {"b": Fraction(b1)}, BODY)
    state = planar_state(BODY, field, AT_EQUATOR, s_sign)
    with pytest.raises(CollisionError) as caught:
        integrate_state(
            BODY,
            field,
            state[:3].tolist(),
            state[3:].tolist(),
            np.array([2.0]),
            tolerance=1e-9,
            integrator=name,
        )
    # A bound that is thousands of times the local tolerance of 1e-13 would be no estimate.
    assert abs(caught.value.time - time) <= caught.value.error <= 1e-9
    shown = re.search(r"t = ([0-9.]+) ± ([0-9.e-]+)", caught.value.message)
    assert shown is not None
    assert abs(float(shown[1]) - time) <= float(shown[2]) <= 2.0 * caught.value.error


@pytest.mark.parametrize("name", NAMES)
def test_times_before_the_collision_are_served(name):
    field = expression_potential("-g1 - 1/(20*g3^2) - (g1^2-g2^2)/2", {}, BODY)
    state = planar_state(BODY, field, AT_EQUATOR)
    motion = integrate_state(
        BODY, field, state[:3].tolist(), state[3:].tolist(), np.array([1.0]), tolerance=1e-9, integrator=name
    )
    assert motion.error <= 1e-9


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("exponent", ["3/2", "7/3", "7/2"])
def test_loss_of_smoothness_is_a_collapse_and_not_a_collision(name, exponent):
    """V = -g1^n is not defined beyond g1 = 0, and its gradient vanishes there."""
    field = expression_potential("-g1^n", {"n": Fraction(exponent)}, BODY)
    start = (0.0, 0.0, 1.0), (0.6, 0.8, 0.0)
    with pytest.raises(StepCollapseError, match="not smooth, or not defined") as backward:
        integrate_state(BODY, field, *start, -TO_TEN, tolerance=1e-6, integrator=name)
    # Almost up to there the motion is served, and is at the border of the domain.
    almost = np.array([0.999 * backward.value.time])
    motion = integrate_state(BODY, field, *start, almost, tolerance=1e-6, integrator=name)
    assert 0.0 <= motion.samples[0, 3] <= 0.01


@pytest.mark.parametrize("name", NAMES)
def test_singular_start_is_refused_at_time_zero(name):
    field = expression_potential("1/g2", {}, BODY)
    with pytest.raises(CollisionError, match="initial state") as caught:
        integrate_state(
            BODY, field, (0.0, 0.0, 1.0), (0.6, 0.0, 0.8), TO_TEN, tolerance=1e-6, integrator=name
        )
    assert caught.value.time == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_too_long_a_time_says_how_far_the_steps_reach(name, monkeypatch):
    monkeypatch.setattr(solve, "MAX_STEPS", 50)
    with pytest.raises(StepCollapseError, match="50 steps reach"):
        integrate_state(
            BODY,
            gravity_potential(-ONE, -ONE, ONE),
            (1.0, 0.5, 0.2),
            (0.6, 0.0, 0.8),
            np.array([1e6]),
            tolerance=1e-6,
            integrator=name,
        )


@pytest.mark.parametrize("name", NAMES)
def test_less_accuracy_than_asked_is_never_returned(name):
    with pytest.raises(AccuracyNotMetError) as caught:
        integrate_state(
            BODY,
            gravity_potential(-ONE, -ONE, ONE),
            (1.0, 0.5, 0.2),
            (0.6, 0.0, 0.8),
            np.array([100.0]),
            tolerance=1e-17,
            integrator=name,
        )
    # Rounding alone, grown along a motion that is not regular: 1e-17 is out of reach, 1e-6 is not.
    assert 1e-17 < caught.value.reached < 1e-6
    assert f"{caught.value.reached:.1e}" in caught.value.message


def test_missing_moment_is_named():
    body = RigidBody(Fraction(2), None, ONE)
    with pytest.raises(MissingMomentError):
        integrate_state(body, gravity_potential(-ONE, ONE, ONE), (0, 0, 1), (1, 0, 0), TO_TEN, tolerance=1e-6)


def test_absolute_values_are_left_to_runge_kutta():
    field = expression_potential("abs(g1)", {}, BODY)
    assert choose_integrator(BODY, field, "auto").name == "dop853"
    with pytest.raises(UnsupportedFormulaError, match="'abs'"):
        choose_integrator(BODY, field, HEYOKA)
    with pytest.raises(UnsupportedFormulaError, match="no abs"):
        choose_integrator(BODY, field, "taylor")
