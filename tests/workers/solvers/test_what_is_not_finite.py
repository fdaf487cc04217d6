"""What is not finite passes no bound on its way from a solver to an answer."""

import json
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from flint import ctx

from service.dynamics.motion import Motion
from service.dynamics.problem import PlanarMotion
from service.dynamics.solution.dense_output import DenseOutput
from service.jobs.records import Refused
from tests.support import solving
from tests.support.planar import body, formula, planar
from tests.support.solving import solve_planar
from workers.computation import compute as computation
from workers.computation.compute import solve_document
from workers.solvers.assembly.dense import resolve_motion
from workers.solvers.cross_check import compare
from workers.solvers.errors import AccuracyNotMetError, QuadratureNotConvergedError
from workers.solvers.quadrature.time_map import make_time_map

DOCUMENT = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "-g1"},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"times": ["0", "1"]},
}
NOT_FINITE = (nan, inf)


@pytest.fixture(scope="module")
def motion() -> Motion:
    return solve_planar(planar(body(2, 1, "3/2"), "-g1", PlanarMotion(1)))


@pytest.mark.parametrize("error", NOT_FINITE)
def test_a_claim_that_is_not_finite_is_refused(motion, error, monkeypatch):
    problem = planar(body(2, 1, "3/2"), "-g1", PlanarMotion(1), tolerance=inf)
    monkeypatch.setattr(solving, "find_motion", lambda *_: replace(motion, error=error))
    with pytest.raises(AccuracyNotMetError):
        solve_planar(problem)


@pytest.mark.parametrize("error", NOT_FINITE)
def test_a_job_whose_claim_is_not_finite_fails_by_name(motion, error, monkeypatch):
    monkeypatch.setattr(computation, "solve", lambda *_: replace(motion, error=error))
    outcome = solve_document(json.dumps(DOCUMENT))
    assert isinstance(outcome, Refused)
    assert outcome.error["code"] == "accuracy_not_met"


@pytest.mark.parametrize("value", NOT_FINITE)
def test_a_job_with_a_sample_that_is_not_finite_fails_by_name(motion, value, monkeypatch):
    samples = motion.samples.copy()
    samples[-1, 2] = value
    monkeypatch.setattr(computation, "solve", lambda *_: replace(motion, samples=samples))
    outcome = solve_document(json.dumps(DOCUMENT))
    assert isinstance(outcome, Refused)
    assert outcome.error["code"] == "accuracy_not_met"


def test_a_departure_of_nan_is_not_lost_among_others():
    """A builtin max keeps the 0 it began with."""

    def sample(times):
        return np.full((len(times), 6), nan)

    found = resolve_motion(sample, (0.0, 1e-15), np.zeros(0), scale=1.0, atol=1e-14)
    assert np.isnan(found.error)


def test_time_beyond_all_doubles_is_no_time_map():
    with ctx.workprec(160), pytest.raises(QuadratureNotConvergedError):
        make_time_map(lambda theta: (800 * theta).exp(), (), is_even=False)


@pytest.mark.parametrize("error", NOT_FINITE)
def test_an_error_without_end_explains_no_disagreement(motion, error):
    rigid_body = body(2, 1, "3/2")
    claimed = replace(motion, error=error)
    assert not compare(claimed, rigid_body, formula("-g1", rigid_body), 1e-10).agrees
    assert compare(motion, rigid_body, formula("-g1", rigid_body), 1e-10).agrees


@pytest.mark.parametrize("place", ["first", "second"])
def test_the_error_of_a_function_of_time_keeps_the_nan_of_any_column(place):
    errors = {place: nan}
    dense = DenseOutput(("first", "second"), np.array([0.0, 1.0]), np.zeros((1, 1, 2)), None, 1e-9, errors)
    assert np.isnan(dense.error_at(np.zeros(1)))
