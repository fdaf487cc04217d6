"""What an error advises is accepted, and is said at a field that was sent."""

import json
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.accuracy import LARGEST_TOLERANCE, SMALLEST_TOLERANCE
from service.schemas.problem.problem import read_problem
from tests.support.api import PLANAR
from workers.computation.compute import solve_document
from workers.solvers.errors import AccuracyNotMetError

ADVISED = re.compile(r'\{"tolerance": ([^}]*)\} or more')


@given(st.floats(min_value=1e-30, max_value=1e80))
def test_the_tolerance_that_is_advised_is_large_enough_and_accepted(reached):
    error = AccuracyNotMetError(reached, reached / 2)
    message = error.message
    advised = ADVISED.search(message)
    assert error.accepted == ({} if advised is None else {"tolerance": float(advised[1])})
    if advised is None:
        assert 2 * reached > LARGEST_TOLERANCE
        assert "1e-15 to 1e-02" in message
        return
    assert max(2 * reached, SMALLEST_TOLERANCE) <= float(advised[1]) <= float(LARGEST_TOLERANCE)
    asked = read_problem({**PLANAR, "accuracy": {"tolerance": advised[1]}})
    assert asked.tolerance == float(advised[1])


@pytest.mark.parametrize("reached", [float("inf"), float("nan"), 3.5e58])
def test_no_tolerance_is_advised_where_none_would_do(reached):
    error = AccuracyNotMetError(reached, 1e-10)
    assert ADVISED.search(error.message) is None
    assert error.accepted == {}


@pytest.mark.parametrize(
    ("accuracy", "pointer"),
    [
        ({"tolerance": "1e-12"}, "/accuracy/tolerance"),
        ({"tier": "high"}, "/accuracy/tier"),
        ({"budget_seconds": 1}, "/accuracy/budget_seconds"),
        (None, ""),
    ],
)
def test_the_error_points_to_what_was_sent(monkeypatch, accuracy, pointer):
    def refuse(problem):
        raise AccuracyNotMetError(1e-9, problem.tolerance)

    monkeypatch.setattr("workers.computation.compute.solve", refuse)
    document = PLANAR if accuracy is None else {**PLANAR, "accuracy": accuracy}
    error = solve_document(json.dumps(document)).error
    assert (error["code"], error["pointer"]) == ("accuracy_not_met", pointer)
    assert '{"tolerance": 2e-09}' in error["detail"]
    assert error["accepted"] == {"tolerance": 2e-9}
