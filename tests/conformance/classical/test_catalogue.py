"""The rows of the catalogue: one for each case, with an example that is solved as it stands."""

import json

import pytest

from service.catalogue import classical
from service.dynamics.classical.bodies import CASES
from service.schemas.problem.motions import CaseName, ClassicalMotionIn
from workers.computation.compute import solve_checked


def test_there_is_a_row_for_every_case_and_one_for_what_was_not_obtained():
    rows = {row.case: row for row in classical()}
    assert list(rows)[:-1] == list(CASES) == list(CaseName.__args__)
    assert rows["dokshevich_1970"].source == "not_obtained"
    assert rows["dokshevich_1970"].example is None
    for row in classical():
        assert set(row.parameters) <= set(ClassicalMotionIn.model_fields)
        assert row.author
        assert row.real


@pytest.mark.parametrize(
    "row", [row for row in classical() if row.example is not None], ids=lambda row: row.case
)
def test_the_example_is_solved_as_it_stands(row):
    outcome = solve_checked(json.dumps(row.example))
    assert outcome.summary["method"] == "quadrature"
    assert (outcome.summary["period"] is not None) == row.periodic
    # The tier standard.
    assert outcome.summary["error"] <= 1e-10
