"""Integrators see what is narrower than their steps: walls, bumps and wells of widths 1e-1 to 1e-8.

All of V = -g1 + a (2 g1² + g3²) exp(-k (g2 - 3/10)²) with A = 2C is admissible, whatever a and k, and adds
the same constant function of g2 to p²: (dg2/dt)² ∝ p² = P(g2), which tells where motions turn back.
"""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.defect.equations import Equations
from service.dynamics.problem import PlanarMotion
from tests.support.effort import each_once
from tests.support.heyoka_integrator import HEYOKA
from tests.support.planar import body, formula
from workers.solvers.choose import planar_start
from workers.solvers.errors import StepCollapseError
from workers.solvers.integration.interface import followed
from workers.solvers.integration.solve import choose_integrator, integrate_state

BODY = body(2, 1, "3/2")
START = planar_start(BODY, formula("-g1", BODY), PlanarMotion(Fraction(1)))
STEEPNESS = ["10^2", "10^6", "10^10", "10^14"]
INTEGRATORS = ["taylor", HEYOKA, "dop853"]
TOLERANCE = {"taylor": 1e-8, HEYOKA: 1e-8, "dop853": 1e-5}


def potential(height, steepness):
    return formula(f"-g1 + (2*g1^2+g3^2)*({height})*exp(-{steepness}*(g2-3/10)^2)", BODY)


def integrated(V, integrator):
    times = np.linspace(0.0, 6.0, 301)
    return integrate_state(
        BODY, V, START[:3], START[3:], times, tolerance=TOLERANCE[integrator], integrator=integrator
    )


@each_once(steepness=STEEPNESS, integrator=INTEGRATORS)
def test_a_wall_turns_the_motion_back(integrator, steepness):
    motion = integrated(potential(2, steepness), integrator)
    assert motion.samples[:, 4].max() < 0.3
    assert motion.samples[:, 4].min() < -0.9
    assert motion.evidence["defect_covers"] == 1.0


@each_once(steepness=STEEPNESS, integrator=INTEGRATORS, height=[Fraction(1, 100), -2])
def test_what_is_passed_keeps_the_energy_within_it(integrator, height, steepness):
    """Sampled where the feature is, the energy is that of the start; both runs and this one agree there."""
    V = potential(height, steepness)
    motion = integrated(V, integrator)
    assert motion.samples[:, 4].max() > 0.99
    # The energy's slope in the feature is its force, below 2 · 3 · sqrt(k): the claim times that.
    force = 6.0 * 10.0 ** (int(steepness[3:]) / 2)
    assert motion.evidence["drift"] <= 5.0 * motion.error * max(1.0, force)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_backwards_as_well(integrator):
    V = potential(2, "10^6")
    chosen, equations = choose_integrator(BODY, V, integrator), Equations.of(BODY, V)
    state = np.array(START)
    ahead = followed(chosen, equations, state, 3.0, local_tolerance=1e-9, max_steps=5000)
    # Time is turned round by turning ω round.
    mirrored = state * np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
    back = followed(chosen, equations, mirrored, -3.0, local_tolerance=1e-9, max_steps=5000)
    assert ahead.ending is None
    assert back.ending is None
    assert ahead.reached == 3.0
    assert back.reached == -3.0
    ends = [run.coefficients[-1].sum(axis=0) for run in (ahead, back)]
    ends[1][:3] *= -1.0
    # Steps of either run err by 1e-9 and what the wall's force, some thousand, makes of it.
    np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-4)


def test_what_cannot_be_followed_is_refused_by_name():
    """A wall of the width 1e-30 about a place that is no double: no time is known as finely."""
    with pytest.raises(StepCollapseError, match=r"cannot be followed|shrink to nothing"):
        integrated(potential(2, "10^60"), HEYOKA)


def test_smooth_runs_are_those_of_the_integrator():
    V = formula("-g1 + 1/20/g3^2", BODY)
    for name in INTEGRATORS:
        chosen, equations = choose_integrator(BODY, V, name), Equations.of(BODY, V)
        plain = chosen.run(np.array(START), 6.0, local_tolerance=1e-11, max_steps=1000)
        held = followed(chosen, equations, np.array(START), 6.0, local_tolerance=1e-11, max_steps=1000)
        np.testing.assert_array_equal(held.breaks, plain.breaks)
        np.testing.assert_array_equal(held.coefficients, plain.coefficients)
