"""A document that is judged and solved in one process is read once, and solved as if it were read again."""

import json

import pytest

from service.jobs.records import Refused, Solved
from service.schemas.problem.problem import read_problem
from service.schemas.problem.trusted import trusted_problem
from service.verdicts import examination
from workers.computation import compute
from workers.computation.compute import solve_checked, solve_document

DOCUMENT = {
    "body": {"A": 2, "B": "3/2", "C": 1},
    "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
    "motion": {"type": "planar", "lambda": 1},
    "time": {"times": [0, "1/2", 40]},
    "outputs": ["period", "gamma", "omega"],
}


@pytest.fixture
def reads(monkeypatch) -> list[object]:
    """The documents that are read."""
    documents: list[object] = []

    def noting(read):
        return lambda document: documents.append(document) or read(document)

    monkeypatch.setattr(compute, "read_problem", noting(read_problem))
    for module in (examination, compute):
        monkeypatch.setattr(module, "trusted_problem", noting(trusted_problem))
    return documents


@pytest.mark.parametrize("accuracy", [{"tier": "draft"}, {"tier": "standard"}])
def test_what_is_judged_and_solved_is_read_once(reads, accuracy):
    outcome = solve_checked(json.dumps({**DOCUMENT, "accuracy": accuracy}))
    assert isinstance(outcome, Solved), outcome
    assert len(reads) == 1


def test_what_is_refused_is_read_once(reads):
    refused = solve_checked(
        json.dumps({**DOCUMENT, "potential": {"type": "expression", "expression": "g2^3"}})
    )
    assert isinstance(refused, Refused)
    assert refused.error["code"] == "inadmissible_potential"
    assert len(reads) == 1


def test_a_budget_is_another_document_once_it_is_a_tier(reads):
    outcome = solve_checked(json.dumps({**DOCUMENT, "accuracy": {"budget_seconds": "3600"}}))
    assert isinstance(outcome, Solved), outcome
    assert [document["accuracy"] for document in reads] == [{"budget_seconds": "3600"}, {"tier": "certified"}]


@pytest.mark.parametrize("accuracy", [{"tier": "draft"}, {"tier": "standard"}, {"tier": "high"}])
@pytest.mark.parametrize("motion", [DOCUMENT["motion"], {"type": "planar", "nu": "1/2", "g3_sign": -1}])
def test_what_is_judged_before_has_the_bits_of_what_is_only_solved(accuracy, motion):
    document = json.dumps({**DOCUMENT, "accuracy": accuracy, "motion": motion})
    judged, found = solve_checked(document), solve_document(document)
    assert isinstance(judged, Solved), judged
    assert isinstance(found, Solved), found
    assert {**judged.summary, "cost": None} == {**found.summary, "cost": None}
    assert (judged.dense, judged.samples) == (found.dense, found.samples)
