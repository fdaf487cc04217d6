"""The reference of the honesty runs, series in twice the digits, against identities of the equations."""

from fractions import Fraction

import numpy as np
import pytest

from tests.support.doubled_series import Motion
from tests.support.witnesses.rotation_matrix import rotation_matrix

MOTION = Motion(
    (Fraction(2), Fraction(3, 2), Fraction(1)), ((Fraction(-1), 1, 0, 0), (Fraction(1, 20), 0, 0, -2))
)
STATE = (Fraction(3, 10), Fraction(1, 5), Fraction(-1, 2), Fraction(3, 5), Fraction(0), Fraction(4, 5))
TIME = Fraction(1)
STEPS = Fraction(1, 10**29)
"""A step leaves out 8e-31 and rounds by 5e-32, and growth and slopes are of the order 1 until TIME."""


def test_the_turn_takes_the_vertical_along():
    row = np.array([float(value) for value in MOTION.turned(STATE, [TIME])[0]])
    turn, gamma = row[6:], row[3:6]
    # γ is fixed in space: R γ(t) = γ(0) with R from the body now to the body at t = 0. A few roundings.
    assert np.abs(rotation_matrix(turn) @ gamma - [0.6, 0.0, 0.8]).max() <= 1e-15
    assert abs(turn @ turn - 1.0) <= 1e-15


def test_the_derivatives_are_those_of_neighbours_and_keep_volume_and_casimirs():
    gap = Fraction(1, 10**9)
    carried = MOTION.carried(STATE, TIME)
    for axis in range(6):
        sides = [
            MOTION.at(tuple(x + (sign * gap if n == axis else 0) for n, x in enumerate(STATE)), [TIME])[0]
            for sign in (1, -1)
        ]
        for row, one, other in zip(carried, *sides, strict=True):
            # Central differences leave out the square of the gap, 1e-18, times third derivatives.
            assert abs((one - other) / (2 * gap) - row[axis]) < 1e-15
    matrix = np.array([[float(value) for value in row] for row in carried])
    # div F = 0; γ·δγ stays: Φ takes the row (0, γ(t)) back to (0, γ(0)). Roundings of doubles.
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-12)
    gamma = np.array([float(value) for value in MOTION.at(STATE, [TIME])[0][3:]])
    assert np.abs(gamma @ matrix[3:] - [0, 0, 0, 0.6, 0.0, 0.8]).max() <= 1e-13


def test_the_integrals_stay_to_thirty_digits():
    def integrals(state):
        p, q, r, g1, g2, g3 = state
        A, B, C = MOTION.moments
        energy = (A * p * p + B * q * q + C * r * r) / 2 - g1 + 1 / (20 * g3 * g3)
        return energy, A * p * g1 + B * q * g2 + C * r * g3, g1 * g1 + g2 * g2 + g3 * g3

    (found,) = MOTION.at(STATE, [TIME])
    for there, here in zip(integrals(found), integrals(STATE), strict=True):
        assert abs(there - here) <= STEPS


def test_the_way_back_is_the_same():
    (there,) = MOTION.at(STATE, [TIME])
    (back,) = MOTION.at(tuple(there), [-TIME])
    assert max(abs(one - other) for one, other in zip(back, STATE, strict=True)) <= STEPS
