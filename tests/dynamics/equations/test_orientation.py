"""Attitudes and angles as functions of time, on a motion that is known in closed form."""

import math
from fractions import Fraction
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.equations.orientation import (
    LOCAL_QUATERNION,
    QUATERNION,
    attitude,
    azimuth_rate,
    evaluated_alone,
    orientation_columns,
    orientation_errors,
    quaternion_product,
    trajectory_columns,
    trajectory_errors,
)
from service.dynamics.solution.dense_output import (
    Advance,
    DenseOutput,
    Period,
    chebyshev_coefficients,
    chebyshev_points,
)
from tests.support.witnesses.rotation_matrix import rotation_matrix

ULP = 2.0**-52
TWO_PI_LO = 2.4492935982947064e-16
SLIP = 0.7
"""Regular precession per turn of the spin, in radians."""
TILT = 1.1

directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda g: np.linalg.norm(g) > 0.1)
quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


def unit(numbers):
    return np.array(numbers) / np.linalg.norm(numbers)


@given(quaternions, quaternions)
def test_the_matrix_of_a_product_is_the_product_of_the_matrices(left, right):
    left, right = unit(left), unit(right)
    product = rotation_matrix(quaternion_product(left, right))
    # Sums of up to twelve products of numbers below one.
    assert np.abs(product - rotation_matrix(left) @ rotation_matrix(right)).max() <= 16 * ULP
    assert np.abs(product @ product.T - np.eye(3)).max() <= 24 * ULP
    assert np.linalg.det(product) == pytest.approx(1.0, abs=24 * ULP)


@pytest.mark.parametrize("axis", [0, 2])
def test_the_slopes_of_an_azimuth_are_those_of_its_rate(axis):
    state, gap = np.array([0.4, -0.3, 1.1, 0.48, 0.6, 0.64]), 1e-6
    apart = gap * np.eye(6)
    differences = (azimuth_rate(state + apart, axis)[0] - azimuth_rate(state - apart, axis)[0]) / (2.0 * gap)
    # Roundings of a rate of size 2 over the gap; the third derivatives leave 1e-12 times as much.
    assert azimuth_rate(state, axis)[1] == pytest.approx(differences, abs=1e-9)


@given(directions.filter(lambda g: np.hypot(g[1], g[2]) > 1e-5))
def test_the_attitude_at_the_start_has_that_gamma_and_no_azimuth(gamma):
    gamma = unit(gamma)
    R = rotation_matrix(attitude(gamma))
    # Half angles and products of a few rounded factors.
    assert np.abs(R[2] - gamma).max() <= 8 * ULP
    assert abs(R[1, 0]) <= 8 * ULP
    assert R[0, 0] >= 0.0


@pytest.mark.parametrize("gamma", [(1, 0, 0), (-1, 0, 0), (1, 3e-9, -4e-9), (-1, -4e-9, 0)])
def test_a_vertical_first_axis_leaves_the_azimuth_to_the_second(gamma):
    R = rotation_matrix(attitude(unit(gamma)))
    assert np.abs(R[2] - unit(gamma)).max() <= 8 * ULP
    assert abs(R[0, 1]) <= 8 * ULP
    assert R[1, 1] > 0.99


@given(directions, st.floats(-3, 3))
def test_the_columns_of_the_matrix_are_those_of_the_books(gamma, psi1):
    """e1 = (c cos ψ, c sin ψ, g1), e2 = (g2 u − g3 n)/c, e3 = (g3 u + g2 n)/c."""
    g1, g2, g3 = unit(gamma)
    c = math.hypot(g2, g3)
    if c < 1e-3:
        return
    cos, sin = math.cos(psi1), math.sin(psi1)
    u, n = np.array([-g1 * cos, -g1 * sin, c]), np.array([sin, -cos, 0.0])
    books = np.stack([[c * cos, c * sin, g1], (g2 * u - g3 * n) / c, (g3 * u + g2 * n) / c], axis=1)
    about = np.array([math.cos(psi1 / 2), 0.0, 0.0, math.sin(psi1 / 2)])
    R = rotation_matrix(quaternion_product(about, attitude(unit(gamma))))
    # g has length one to an ulp, which the division by c ≥ 1e-3 shows a thousandfold.
    assert np.abs(R - books).max() <= 8 * ULP / c


def regular_precession(*, slip=SLIP, phase_error=0.0, slip_error=0.0) -> DenseOutput:
    """The third axis at a fixed tilt goes round by ``slip`` while the body spins once, in 2π.

    q = exp(kΩt/2) exp(jθ/2) exp(kt/2): ψ3 = Ωt, and ψ1 gains 2π more, for it goes with the spin.
    """
    degree, breaks = 24, np.linspace(0.0, 2 * np.pi, 17)
    rate = slip / (2 * np.pi)
    tilt = np.array([math.cos(TILT / 2), 0.0, math.sin(TILT / 2), 0.0])

    def columns(t):
        zero = np.zeros_like(t)
        about, spin = (np.stack([np.cos(a / 2), zero, zero, np.sin(a / 2)], axis=-1) for a in (rate * t, t))
        q = quaternion_product(quaternion_product(about, tilt), spin)
        g = rotation_matrix(q)[:, 2]
        # The azimuth of (cos θ cos t, sin t), from that of (cos t, sin t): no branch is ever crossed.
        ahead = np.arctan2(
            np.sin(t) * np.cos(t) * (1 - np.cos(TILT)), np.cos(TILT) * np.cos(t) ** 2 + np.sin(t) ** 2
        )
        psi1 = rate * t + t + ahead
        return np.column_stack([g, q, psi1, rate * t])

    pieces = []
    for left, right in pairwise(breaks):
        values = columns(left + (right - left) * (1 + chebyshev_points(degree)) / 2)
        # Increments only: the sums of a series of large numbers would lose a digit.
        pieces.append(chebyshev_coefficients(values - values[-1]))
        pieces[-1][0] += values[-1]
    full = Fraction(2 * math.pi) + Fraction(TWO_PI_LO) + Fraction(slip)
    hi = float(full)
    return DenseOutput(
        ("g1", "g2", "g3", *LOCAL_QUATERNION, "psi1", "psi3"),
        breaks,
        np.array(pieces),
        Period(2 * math.pi, TWO_PI_LO, phase_error),
        1e-15,
        dict.fromkeys((*LOCAL_QUATERNION, "psi1", "psi3"), 3e-15),
        {"psi1": Advance(hi, float(full - Fraction(hi)), slip_error), "psi3": Advance(slip, 0.0, slip_error)},
    )


def exact(time: float):
    """The quaternion and ψ3 of a time, to fifty digits."""
    with mpmath.workdps(50):
        t = mpmath.mpf(time)
        a, b, c = mpmath.mpf(SLIP) * t / (2 * mpmath.pi) / 2, mpmath.mpf(TILT) / 2, t / 2
        q = [
            mpmath.cos(b) * mpmath.cos(a + c),
            -mpmath.sin(b) * mpmath.sin(a - c),
            mpmath.sin(b) * mpmath.cos(a - c),
            mpmath.cos(b) * mpmath.sin(a + c),
        ]
        return [float(x) for x in q], float(2 * a)


@pytest.mark.parametrize("turns", [0, 1, 2, 17, 10**5, 10**8, -1, -2, -(10**8)])
def test_the_quaternion_goes_on_for_ever_without_a_jump(turns):
    dense = regular_precession()
    times = turns * 2 * math.pi + np.array([0.0, 0.3, 2.0, 3.1, 6.0])
    columns = orientation_columns(dense, times)
    found = np.stack([columns[name] for name in QUATERNION], axis=1)
    expected = np.array([exact(t)[0] for t in times.tolist()])
    # Rounding of the pieces only: neither 10^8 periods nor 10^8 advances cost a digit. The sign counts.
    assert np.abs(found - expected).max() <= 16 * ULP
    angles = np.array([exact(t)[1] for t in times.tolist()])
    assert np.abs(columns["psi3"] - angles).max() <= 16 * ULP + ULP * np.abs(angles).max()
    R = rotation_matrix(found)
    azimuth = np.arctan2(R[:, 1, 0], R[:, 0, 0])
    turn = (columns["psi1"] - azimuth + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turn).max() <= 32 * ULP + 2 * ULP * np.abs(columns["psi1"]).max()


def test_errors_at_a_break_are_as_small_as_elsewhere():
    """Within a period the quaternion is kept locally, with a jump at its end: the jump is no error."""
    dense = regular_precession()
    errors = orientation_errors(dense, np.array([0.0, 2 * math.pi]))
    assert list(errors) == [*QUATERNION, "psi1", "psi3"]
    # The bound given; 4 ulp of a time of 2π at the rate ψ̇1 = 1/cos θ + Ω = 2.3 there; roundings of ψ1 = 7.
    assert max(errors.values()) <= 3e-15 + (4 * 2 * math.pi * 2.4 + 2 * 7) * ULP


def test_errors_of_period_and_advance_count_once_for_every_period():
    times = np.array([1000 * 2 * math.pi + 0.3])
    late = orientation_errors(regular_precession(slip_error=1e-12), times)
    # ψ by itself, the quaternion with half of the angle.
    assert late["psi1"] == pytest.approx(1e-9, rel=1e-2)
    assert late["q0"] == pytest.approx(0.5e-9, rel=1e-2)
    slow = orientation_errors(regular_precession(phase_error=1e-12), times)
    assert slow["psi3"] == pytest.approx(1e-9 * SLIP / (2 * math.pi), rel=1e-2)
    # The fastest of the four components moves with half the angular velocity at most.
    assert 0.1e-9 <= slow["q0"] <= 0.6e-9


def test_clients_see_the_variables_and_no_local_quaternion():
    dense = regular_precession()
    times = np.array([0.0, 1.0, 50.0])
    columns = trajectory_columns(dense, times)
    assert list(columns) == ["g1", "g2", "g3", *QUATERNION, "psi1", "psi3"]
    R = rotation_matrix(np.stack([columns[name] for name in QUATERNION], axis=1))
    assert (
        np.abs(R[:, 2, :] - np.stack([columns[name] for name in ("g1", "g2", "g3")], axis=1)).max()
        <= 16 * ULP
    )
    errors = trajectory_errors(dense, times)
    assert list(errors) == list(columns)
    # The bound given, and four ulp of times of 2π at the rate of the spin.
    assert max(errors[name] for name in ("g1", "g2", "g3")) <= 1e-15 + (4 * 2 * math.pi + 2) * ULP


@pytest.mark.parametrize(
    ("names", "evaluated"),
    [
        (["t", "g1"], ["g1"]),
        (["t"], []),
        (["g3", "g2"], ["g2", "g3"]),
        (["psi3", "g1"], ["g1", *LOCAL_QUATERNION, "psi1", "psi3"]),
        (["q0"], [*LOCAL_QUATERNION, "psi1", "psi3"]),
    ],
)
def test_no_column_is_evaluated_that_none_asked_for_is_made_of(names, evaluated):
    dense = regular_precession()
    alone = evaluated_alone(dense, names)
    assert list(alone.columns) == evaluated
    times = np.array([0.0, 1.0, 50.0])
    every, some = trajectory_columns(dense, times), trajectory_columns(alone, times)
    errors, own = trajectory_errors(dense, times), trajectory_errors(alone, times)
    for name in set(names) - {"t"}:
        assert np.array_equal(some[name], every[name])
        assert own[name] == errors[name]


def test_for_an_unknown_name_nothing_is_left_out():
    dense = regular_precession()
    assert evaluated_alone(dense, ["g1", "local_q0"]) is dense


def test_without_orientation_there_is_none():
    plain = DenseOutput(("g1",), np.array([0.0, 1.0]), np.ones((1, 1, 1)), None, 1e-9)
    assert orientation_columns(plain, np.zeros(1)) == orientation_errors(plain, np.zeros(1)) == {}
    assert list(trajectory_columns(plain, np.zeros(1))) == ["g1"]
