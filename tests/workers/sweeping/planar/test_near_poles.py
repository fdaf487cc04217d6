"""What blocks see of the way to a pole where doubles end."""

from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.body import RigidBody
from service.dynamics.potentials.families.written import expression_potential
from workers.solvers.compiled.evaluation.program import make_program
from workers.sweeping.planar.exclusions import keep_their_sign, slopes_along

BODY = RigidBody(Fraction(2), None, Fraction(1))


def program_of(text, **parameters):
    numbers = {name: Fraction(value) for name, value in parameters.items()}
    return make_program(expression_potential(text, numbers, BODY).tape)


def test_windows_next_to_a_pole_are_seen_by_the_sign_of_the_momentum():
    program, row = program_of("g1 + b/g3^2 - 2*(g1^2-g2^2)", b="3/7")
    slot = row.tolist().index(3 / 7)
    rows = np.repeat(row[None, :], 4, axis=0)
    rows[:, slot] = -1.0, -1e-20, 1e-20, 0.0
    g3 = np.array([1e-6, 1e-9, 1e-14, 1e-25])
    way = np.stack([g3 * g3, np.ones(4), g3], axis=-1)
    found = keep_their_sign(program, rows, np.broadcast_to(way, (4, 2, 4, 3)))
    # 1/g3² pulls towards the pole, however little of it there is.
    assert found.tolist() == [True, False, True, True]


@pytest.mark.parametrize(
    "text", ["a*g1 + b/g3^2", "exp(a*g2)*g1 - sin(g3)/(2 + cos(g1))", "abs(g1)^a*log(g3^2) - tan(g2/a)"]
)
def test_slopes_are_those_of_the_potential(text):
    potential = expression_potential(text, {"a": Fraction(5, 3), "b": Fraction(1, 50)}, BODY)
    program, row = make_program(potential.tape)
    gamma = np.random.default_rng(3).normal(size=(1, 2, 5, 3))
    gamma /= np.linalg.norm(gamma, axis=-1, keepdims=True)
    found = slopes_along(program, row[None, :], *(gamma[..., k] for k in range(3)))
    # Both lose a few roundings, of terms that are not larger than some tens.
    assert np.allclose(found.astype(float), potential.D(gamma), rtol=1e-12, atol=1e-13)


def test_a_way_that_ends_in_zero_tells_nothing():
    program, row = program_of("g1 + b/g3^2", b=1)
    g3 = np.array([1e-6, 1e-90, 1e-200])
    way = np.broadcast_to(np.stack([g3**3, np.ones(3), g3], axis=-1), (1, 2, 3, 3))
    # 1e-600 is 0, and four depths must be known.
    assert not keep_their_sign(program, row[None, :], way).any()
