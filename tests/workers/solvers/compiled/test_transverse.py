"""Parts of the compiled Hill's equation: derivatives of formulas, collocation, coefficients, monodromies."""

import math

import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion
from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.records import copied, new_records
from workers.solvers.compiled.solve import Batch, solve_batch
from workers.solvers.compiled.solve_set import advance_of, new_formula
from workers.solvers.compiled.transverse.parts import WIDTH, coefficients, cross, doubt_of_ends
from workers.solvers.compiled.transverse.turn import ERROR, turn
from workers.solvers.compiled.workspace import PLACES, WORKSPACE

UNIT = 2.0**-53


@pytest.mark.parametrize("angle", [0.1, 1.0, 2.0])
def test_collocation_of_a_rotation(angle):
    rate = np.full(WIDTH, 0.5 * angle)
    q, m, end = np.empty((2, WIDTH)), np.empty((2, WIDTH)), np.empty((2, 2))
    cross(rate, rate, q, m, end)
    expected = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    # Order 32: (angle/2)^33/33! is below rounding.
    assert np.abs(end - expected).max() <= 20 * UNIT


def test_gravity_has_the_coefficient_of_lames_equation():
    """c = −(a/C)(B g1 + ν(2C − B)/2), a = −1; and the turn has a determinant of 1."""
    A, B, C, nu = 2.0, 1.5, 1.0, 1.0
    program, constants = make_program(formula("-g1", body(2, 1)).tape)
    run = solve_batch(
        Batch(program, constants[None], make_frame(body(2, 1), PlanarMotion(None, 1)).shared, "standard")
    )
    made = new_formula(program.code, program.result, program.across, constants)
    places = new_records(PLACES)[0]
    v = np.linspace(0.1, 3.0, WIDTH)
    places.sine[:WIDTH], places.cosine[:WIDTH] = np.sin(v), np.cos(v)
    moments = np.array([A, B, C, B - C, A - C, A - B])
    c, errors = np.empty(WIDTH), np.empty(WIDTH)
    coefficients(made, run.loops[0], moments, places, c, errors)
    expected = B * places.g1[:WIDTH] + nu * (2.0 * C - B) / 2.0
    assert np.all(np.abs(c - expected) <= errors + 4 * UNIT)
    assert doubt_of_ends(made, run.loops[0], places, run.panels, len(run.panels)) == 0.0
    out = np.empty(8)
    workspace = new_records(WORKSPACE)
    assert turn(
        program.code, program.result, program.across, constants,
        run.loops, run.panels, run.found, workspace, moments, out,
    )  # fmt: skip
    assert abs(np.linalg.det(out[:4].reshape(2, 2)) - 1.0) <= out[ERROR] <= 1e-10
    advance, error = advance_of(copied(run.loops))
    # Golden number of ν = 1.
    assert abs(advance - 3.61050523508724966610354854487) <= error + 4 * UNIT <= 1e-14
