"""Many motions in one call have the numbers that each has alone; records keep what they are told."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from service.dynamics.problem import PlanarMotion
from service.dynamics.sampling import SampleTimes
from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.program import make_program
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.motion import Bounds
from workers.solvers.compiled.records import ARC, CUT, FOUND, LOOP, PANEL
from workers.solvers.compiled.solve import Batch, bounds_of, solve_batch
from workers.solvers.compiled.workspace import DISC_WORKSPACE, MOMENTS, PLACES

TIMES = np.linspace(-3.0, 8.0, 57)
LOGARITHMS = [-0.4, -0.1, 0.0, 0.3]


@pytest.fixture(scope="module", params=[(2, 1), (1, 2), (3, 1)], ids=str)
def batch(request):
    rigid_body = body(*request.param)
    program, constants = make_program(formula("-g1 + 1/(20*g3^2)", body(2, 1)).tape)
    frame = make_frame(rigid_body, PlanarMotion(Fraction(1)))
    rows = np.repeat(constants[None, :], len(LOGARITHMS), axis=0)
    times = SampleTimes(TIMES, np.zeros(len(TIMES)))
    return Batch(program, rows, frame.loops(LOGARITHMS), "standard", times)


def test_each_has_the_numbers_that_it_has_alone(batch):
    together = solve_batch(batch)
    for n in range(len(LOGARITHMS)):
        one = slice(n, n + 1)
        alone = solve_batch(replace(batch, constants=batch.constants[one], loops=batch.loops[one]))
        assert np.array_equal(alone.samples, together.samples[one], equal_nan=True)
        assert alone.found.tobytes() == together.found[one].tobytes()


def test_a_batch_is_left_as_it_was(batch):
    before = batch.loops.tobytes(), batch.constants.tobytes()
    solve_batch(batch)
    assert (batch.loops.tobytes(), batch.constants.tobytes()) == before


def test_a_batch_of_nothing_has_no_numbers(batch):
    run = solve_batch(replace(batch, constants=batch.constants[:0], loops=batch.loops[:0]))
    assert run.samples.shape == (0, len(TIMES), 6)
    assert len(run.found) == len(run.panels) == 0


def test_columns_are_those_of_all_six(batch):
    chosen = np.array([5, 1, 0, 3])
    whole, part = solve_batch(batch), solve_batch(replace(batch, columns=chosen))
    assert np.array_equal(part.samples, whole.samples[:, :, chosen], equal_nan=True)


def test_nothing_is_decided_where_v_has_no_value(batch):
    # A square root of −1 is nowhere a number.
    program, constants = make_program(formula("g3*(g1^2-2)^(1/2)", body(2, 1)).tape)
    run = solve_batch(replace(batch, program=program, constants=np.repeat(constants[None, :], 4, axis=0)))
    assert (run.found["panels"] == 0).all()
    assert np.isnan(run.samples).all()


def test_errors_grow_with_time(batch):
    found = solve_batch(batch).found
    decided = found[found["panels"] > 0]
    early, late = (
        bounds_of(decided).error_at(time, decided["period"], decided["period_error"]) for time in (1.0, 1e6)
    )
    assert (late > early).all()


def test_bounds_are_added_up():
    # A time off by 1 at speed 2, 3 of 5 for p and r, and 7 at the worst place; roundings are far smaller.
    assert Bounds(1.0, 2.0, 3.0, 5.0, 7.0).error_at(0.0, 1.0, 0.0) == pytest.approx(24.0)


@pytest.mark.parametrize(
    "layout", [ARC, DISC_WORKSPACE, CUT, FOUND, LOOP, MOMENTS, PANEL, PLACES], ids=lambda _: ""
)
def test_numbers_of_a_record_are_reached_by_their_names(layout):
    """numpy's own attributes go first: a number of their name would be another one in Python."""
    assert set(layout.names).isdisjoint(dir(np.void))
