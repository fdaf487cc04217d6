"""Attitude along planar motions: laws, and an independent integration of everything."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy.polynomial import chebyshev

from service.dynamics.equations.orientation import (
    LOCAL_QUATERNION,
    orientation_columns,
    orientation_errors,
)
from service.dynamics.problem import PlanarMotion, StartAtEquator
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar
from tests.support.witnesses.rotation_matrix import rotation_matrix
from tests.workers.solvers.orientation.cases import (
    PRECESSIONS,
    quaternion_at,
    solved,
    solved_row,
    through_poles,
)
from tests.workers.solvers.orientation.witness import witness
from workers.solvers.orientation.solve import with_orientation

WITNESSED = [
    "bobylev-steklov",
    "negative g1",
    "rest to equator",
    "negative g3",
    "rest to rest, north",
    "pole to rest, south",
    "alpha = 17/10",
    "A < C",
    "A < C through the poles",
    "alpha = 4",
]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("name", WITNESSED)
def test_three_periods_agree_with_an_integration_of_everything(name):
    rigid_body, V, motion = solved_row(name)
    orientation = with_orientation(motion)
    columns = orientation_columns(orientation.dense, motion.times)
    quaternion = quaternion_at(orientation, motion.times)
    state = motion.dense(np.zeros(1))[0]
    # The witness leaves an unstable orbit by and by (up to 1e-12 here); what it misses there is not ours.
    seen = witness(rigid_body, V, state, quaternion[0], motion.times)
    stray = 20 * np.abs(seen.variables - motion.samples).max()
    errors = orientation_errors(orientation.dense, motion.times)
    assert stray <= 5e-11
    assert np.abs(quaternion - seen.quaternion).max() <= errors["q0"] + stray
    assert np.abs(columns["psi1"] - seen.psi1).max() <= errors["psi1"] + stray
    assert np.abs(columns["psi3"] - seen.psi3).max() <= errors["psi3"] + stray
    assert max(errors.values()) <= 1e-11


@pytest.mark.parametrize("name", ["bobylev-steklov", "A < C through the poles", "alpha = 17/10"])
def test_the_matrix_is_a_rotation_with_gamma_in_its_third_row(name):
    motion = solved_row(name)[2]
    orientation = with_orientation(motion)
    times = np.linspace(-100.0, 100.0, 401)
    quaternion = quaternion_at(orientation, times)
    errors = orientation_errors(orientation.dense, times)
    allowed = 4 * errors["q0"] + motion.dense.error_at(times)
    assert allowed <= 1e-12
    # Two products of components of the quaternion in every entry.
    assert np.abs(np.square(quaternion).sum(axis=1) - 1.0).max() <= 2 * errors["q0"]
    R = rotation_matrix(quaternion)
    assert np.abs(R[:, 2] - motion.dense(times)[:, 3:]).max() <= allowed


def test_the_quaternion_obeys_its_equation():
    """q̇ = q ω/2, the derivative being that of the series themselves."""
    orientation = with_orientation(through_poles())
    dense = orientation.dense
    first = dense.columns.index(LOCAL_QUATERNION[0])
    x = np.linspace(-1.0, 1.0, 7)
    # |T_n'| <= n²: what a rounding (2^-52 of a number of size 1) of every coefficient adds to the derivative.
    # Which of them are rounded up depends on the processor.
    rounding = 2.0**-52 * float(np.sum(np.arange(dense.coefficients.shape[1]) ** 2))
    for k, half in enumerate(np.diff(dense.breaks) / 2):
        q0, q1, q2, q3 = chebyshev.chebval(x, dense.coefficients[k, :, first : first + 4])
        p, q, r = chebyshev.chebval(x, dense.coefficients[k, :, :3])
        found = chebyshev.chebval(x, chebyshev.chebder(dense.coefficients[k, :, first : first + 4])) / half
        expected = [
            -(p * q1 + q * q2 + r * q3) / 2,
            (p * q0 + r * q2 - q * q3) / 2,
            (q * q0 + p * q3 - r * q1) / 2,
            (r * q0 + q * q1 - p * q2) / 2,
        ]
        assert np.abs(found - np.array(expected)).max() <= rounding / half


def test_backwards_in_time_the_attitudes_are_the_same():
    """ω → −ω, t → −t."""
    ahead = with_orientation(through_poles(start=StartAtEquator(1)))
    back = with_orientation(through_poles(start=StartAtEquator(-1)))
    times = np.linspace(0.0, 20.0, 101)
    allowed = 2 * orientation_errors(ahead.dense, times)["q0"]
    assert np.abs(quaternion_at(ahead, times) - quaternion_at(back, -times)).max() <= allowed


def test_mirror_images_of_the_body_are_mirror_images_in_space():
    """g1 → −g1 and g3 → −g3, with the reflections of space that leave the first axis its azimuth 0."""
    text = "-abs(g1) + 1/(20*g3^2)"
    motion = PlanarMotion(Fraction(1))
    times = np.linspace(-10.0, 10.0, 81)
    plain = with_orientation(solved(2, 1, "-g1 + 1/(20*g3^2)", motion))
    R = rotation_matrix(quaternion_at(plain, times))
    allowed = 8 * orientation_errors(plain.dense, times)["q0"]
    for changed, space, axes in (
        (replace(motion, g1_sign=-1), np.diag([-1.0, 1, 1]), np.diag([-1.0, 1, 1])),
        (replace(motion, g3_sign=-1), np.diag([1.0, -1, 1]), np.diag([1.0, 1, -1])),
    ):
        image = with_orientation(solved(2, 1, text, changed))
        mirrored = rotation_matrix(quaternion_at(image, times))
        assert np.abs(mirrored - space @ R @ axes).max() <= allowed


def test_a_motion_that_ends_in_a_collision_has_its_attitude_until_then():
    rigid_body = body(2, 1, "3/2")
    V = formula("-g1 - 1/(20*g3^2)", rigid_body)
    times = tuple(Fraction(k, 8) for k in range(9))
    motion = solve_planar(planar(rigid_body, V, PlanarMotion(Fraction(1)), times))
    assert motion.dense.period is None
    orientation = with_orientation(motion)
    assert (orientation.precession, orientation.notices) == (None, ())
    columns = orientation_columns(orientation.dense, motion.times)
    quaternion = quaternion_at(orientation, motion.times)
    seen = witness(rigid_body, V, motion.dense(np.zeros(1))[0], quaternion[0], motion.times)
    errors = orientation_errors(orientation.dense, motion.times)
    assert np.abs(quaternion - seen.quaternion).max() <= errors["q0"] <= 1e-12
    assert np.abs(columns["psi1"] - seen.psi1).max() <= errors["psi1"] <= 1e-12
    assert np.abs(columns["psi3"] - seen.psi3).max() <= errors["psi3"] <= 1e-12


def test_the_variables_stay_what_they_were():
    motion = through_poles("3/10")
    dense = with_orientation(motion).dense
    times = np.linspace(-5.0, 30.0, 201)
    # The same polynomials on halved pieces, rounded anew: the claim knows it. Both sums have roundings of 1.
    rounding = dense.error - motion.dense.error
    assert np.abs(dense(times)[:, :6] - motion.dense(times)).max() <= rounding + 1e-15
    assert rounding <= 1e-14


def test_a_hundred_million_periods_later_the_attitude_is_as_good():
    """Against the law q(t + nT) = (±1)^n exp(k n Δψ1/2) q(t), n Δψ1 reduced in rationals."""
    orientation = with_orientation(through_poles())
    dense = orientation.dense
    n, later = 10**8 + 1, 0.4
    period = Fraction(dense.period.hi) + Fraction(dense.period.lo)
    time = float(n * period + Fraction(later))
    first = float(Fraction(time) - n * period)
    turns = n * Fraction(PRECESSIONS["1"]) / (2 * Fraction("3.14159265358979323846264338327950288"))
    angle = 2 * np.pi * float(turns % 1)
    R = rotation_matrix(quaternion_at(orientation, [first]))[0]
    about = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    late = rotation_matrix(quaternion_at(orientation, [time]))[0]
    # 26 golden digits leave 1e-18 · 10^8; the period and the advance have errors of their own, counted.
    allowed = 4 * orientation_errors(dense, np.array([time]))["q0"]
    assert np.abs(late - about @ R).max() <= min(allowed, 1e-6)
