"""The reference of the honesty runs, series in integers, against identities of the equations."""

from fractions import Fraction

import numpy as np
import pytest

from tests.support.fixed_point import Motion
from tests.support.witnesses.rotation_matrix import rotation_matrix

MOTION = Motion(
    (Fraction(2), Fraction(3, 2), Fraction(1)), ((Fraction(-1), 1, 0, 0), (Fraction(1, 20), 0, 0, -2))
)
STATE = (Fraction(3, 10), Fraction(1, 5), Fraction(-1, 2), Fraction(3, 5), Fraction(0), Fraction(4, 5))
TIME = Fraction(1)


def test_the_turn_takes_the_vertical_along():
    row = np.array([value / 2.0**MOTION.bits for value in MOTION.turned(STATE, [TIME])[0]])
    turn, gamma = row[6:], row[3:6]
    # γ is fixed in space: R γ(t) = γ(0) with R from the body now to the body at t = 0. A few roundings.
    assert np.abs(rotation_matrix(turn) @ gamma - [0.6, 0.0, 0.8]).max() <= 1e-15
    assert abs(turn @ turn - 1.0) <= 1e-15


def test_the_derivatives_are_those_of_neighbours_and_keep_volume_and_casimirs():
    bits, gap = MOTION.bits, Fraction(1, 10**12)
    carried = MOTION.carried(STATE, TIME)
    for axis in range(6):
        sides = [
            MOTION.at(tuple(x + (sign * gap if n == axis else 0) for n, x in enumerate(STATE)), [TIME])[0]
            for sign in (1, -1)
        ]
        for row, one, other in zip(carried, *sides, strict=True):
            # Central differences leave out the square of the gap, times third derivatives.
            assert abs(Fraction(one - other, 1 << bits) / (2 * gap) - Fraction(row[axis], 1 << bits)) < 1e-20
    matrix = np.array([[value / 2.0**bits for value in row] for row in carried])
    # div F = 0; γ·δγ stays: Φ takes the row (0, γ(t)) back to (0, γ(0)). Roundings of doubles.
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-12)
    gamma = np.array([value / 2.0**bits for value in MOTION.at(STATE, [TIME])[0][3:]])
    assert np.abs(gamma @ matrix[3:] - [0, 0, 0, 0.6, 0.0, 0.8]).max() <= 1e-13


def test_more_bits_tell_no_other_digits():
    finer = Motion(MOTION.moments, MOTION.terms, bits=240)
    rows = zip(MOTION.at(STATE, [TIME])[0], finer.at(STATE, [TIME])[0], strict=True)
    # Forty digits by the finer one; some 30 of the other are right.
    assert all(
        abs(Fraction(one, 1 << 160) - Fraction(two, 1 << 240)) < Fraction(1, 10**29) for one, two in rows
    )
