"""Attitude along motions from any state: both integrators, both directions, axes that pass the vertical."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.defect.equations import Equations
from service.dynamics.equations.orientation import (
    QUATERNION,
    orientation_columns,
    orientation_errors,
    quaternion_product,
)
from service.dynamics.problem import PlanarMotion
from tests.support.doubled_series import Motion
from tests.support.effort import examples
from tests.support.heyoka_integrator import HEYOKA
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar
from tests.support.witnesses.rotation_matrix import rotation_matrix
from tests.workers.solvers.orientation.witness import witness
from workers.solvers.integration.solve import integrate_state
from workers.solvers.orientation.solve import with_orientation

BODY = body(2, 1, "3/2")
V = formula("g1 - g3/2 + g2^2/3", BODY)
LEANING = (Fraction(3, 5), Fraction(0), Fraction(4, 5))
UPRIGHT = (Fraction(1), Fraction(0), Fraction(0))


def integrated(omega, gamma, times, **options):
    return integrate_state(BODY, V, omega, gamma, times, tolerance=1e-9, **options)


def quaternion_at(orientation, times):
    columns = orientation_columns(orientation.dense, times)
    return np.stack([columns[name] for name in QUATERNION], axis=1)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("integrator", [HEYOKA, "dop853"])
@pytest.mark.parametrize(
    ("omega", "gamma", "named"),
    [
        ((0.4, 0.1, 0.9), LEANING, ["psi1", "psi3"]),
        ((3.0, 2.0, 0.9), LEANING, ["psi1", "psi3"]),
        ((3.0, 0.0, 0.0), UPRIGHT, ["psi3"]),
        ((0.0, 0.0, 0.0), UPRIGHT, []),  # swings about the second axis, both others through the vertical
        ((0.0, 0.5, 2.0), (Fraction(0), Fraction(0), Fraction(-1)), ["psi1"]),
    ],
)
def test_attitude_and_azimuths_agree_with_an_integration_of_everything(omega, gamma, named, integrator):
    times = np.linspace(0.0, 12.0, 61)
    motion = integrated(omega, gamma, times, integrator=integrator)
    orientation = with_orientation(motion)
    assert orientation.precession is None
    columns = orientation_columns(orientation.dense, times)
    assert list(columns) == [*QUATERNION, *named]
    assert len(orientation.notices) == 2 - len(named)
    quaternion = quaternion_at(orientation, times)
    seen = witness(BODY, V, [*omega, *map(float, gamma)], quaternion[0], times)
    errors = orientation_errors(orientation.dense, times)
    # The witness errs by some 1e-14, and so do the claims at least.
    assert np.abs(quaternion - seen.quaternion).max() <= errors["q0"] <= 2e-6
    for name in named:
        assert np.abs(columns[name] - getattr(seen, name)).max() <= errors[name] <= 1e-4


@given(
    omega=st.tuples(*[st.floats(-3, 3)] * 3),
    gamma=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda g: np.linalg.norm(g) > 0.1),
)
@settings(max_examples=examples(4, 12), deadline=None)
def test_gamma_is_the_third_row_of_a_rotation_in_both_directions_of_time(omega, gamma):
    gamma = np.array(gamma) / np.linalg.norm(gamma)
    times = np.linspace(-4.0, 4.0, 33)
    motion = integrated(omega, gamma, times)
    orientation = with_orientation(motion)
    quaternion = quaternion_at(orientation, times)
    # Steps of the integration are 1e-12 exact and better; claims are above that.
    assert np.abs(np.square(quaternion).sum(axis=1) - 1.0).max() <= 1e-13
    R = rotation_matrix(quaternion)
    allowed = 4 * orientation_errors(orientation.dense, times)["q0"] + motion.error
    assert np.abs(R[:, 2] - motion.samples[:, 3:]).max() <= allowed
    columns = orientation_columns(orientation.dense, np.zeros(1))
    # 0 at t = 0, up to the sum that was subtracted.
    assert all(abs(columns[name][0]) <= 1e-14 for name in columns if name.startswith("psi"))


@pytest.mark.parametrize("gap", [Fraction(1, 10**5), Fraction(1, 10**6)])
def test_a_top_that_stays_next_to_the_vertical_needs_few_pieces(gap):
    """Its axis moves as slowly as it is close: nothing of its way next to the vertical is hidden."""
    top, times = body(2, 2, 1), np.linspace(0.0, 10.0, 11)
    omega, whole = (gap / 3, Fraction(0), Fraction(3)), 1 + gap * gap
    gamma = (2 * gap / whole, Fraction(0), (2 - whole) / whole)
    motion = integrate_state(top, formula("g3", top), omega, gamma, times, tolerance=1e-12)
    orientation = with_orientation(motion, equations=Equations.of(top, formula("g3", top)))
    assert len(orientation.dense.breaks) <= 100
    columns, quaternion = orientation_columns(orientation.dense, times), quaternion_at(orientation, times)
    errors = orientation_errors(orientation.dense, times)
    reference = Motion((top.A, top.B, top.C), ((Fraction(1), 0, 0, 1),))
    turns = np.array(reference.turned((*omega, *gamma), [Fraction(t) for t in times.tolist()]), dtype=float)
    exact = quaternion_product(quaternion[0], turns[:, 6:])
    # The first quaternion is that of doubles.
    assert np.abs(quaternion - exact).max() <= errors["q0"] + 1e-15 <= 1e-12
    third = rotation_matrix(exact)[:, :2, 2]
    azimuths = np.arctan2(third[:, 1], third[:, 0])
    apart = columns["psi3"] - (azimuths - azimuths[0])
    # Up to whole turns; rotations in doubles know a horizontal part of the size of the gap to an ulp of 1.
    assert np.abs(2.0 * np.sin(apart / 2.0)).max() <= errors["psi3"] + 4e-16 / float(gap)
    assert errors["psi3"] <= 1e-12 / float(gap)


def test_an_axis_that_is_vertical_for_an_instant_has_no_azimuth():
    """The body turns about its second axis, with the third one going through the vertical."""
    free = formula("0*g1", BODY)
    times = np.linspace(0.0, 6.0, 61)
    start = (Fraction(5, 13), Fraction(0), Fraction(-12, 13))
    motion = integrate_state(BODY, free, (0, 1, 0), start, times, tolerance=1e-10)
    orientation = with_orientation(motion)
    # Its rate is zero before and after: only the passage itself tells that it jumps by π.
    assert sorted(notice.partition(" ")[0] for notice in orientation.notices) == ["psi1", "psi3"]
    quaternion = quaternion_at(orientation, times)
    # q(t) = q(0) exp(jt/2).
    cosines = quaternion @ quaternion[0]
    assert np.abs(cosines - np.cos(times / 2)).max() <= orientation.dense.errors["local_q0"]


def test_an_integrated_planar_motion_has_the_attitude_of_the_quadrature():
    planar_body = body(2, 1, "3/2")
    gravity = formula("-g1", planar_body)
    exact = solve_planar(planar(planar_body, gravity, PlanarMotion(None, Fraction(1)), (0, 5, 10)))
    state = exact.dense(np.zeros(1))[0]
    times = np.linspace(0.0, 10.0, 41)
    other = integrate_state(planar_body, gravity, state[:3], state[3:], times, tolerance=1e-9)
    one, two = with_orientation(exact), with_orientation(other)
    allowed = orientation_errors(one.dense, times)["q0"] + orientation_errors(two.dense, times)["q0"]
    assert np.abs(quaternion_at(one, times) - quaternion_at(two, times)).max() <= allowed
