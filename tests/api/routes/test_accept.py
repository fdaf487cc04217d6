"""`"accept": "undecided"`: a motion is solved if it is proved on its own curve, else refused by name."""

import json

import pytest

from service.jobs.records import Solved
from service.schemas.problem.problem import problem_digest
from tests.support.api import PLANAR
from tests.support.canonical import canonical_document
from workers.computation.compute import solve_checked

pytestmark = pytest.mark.any_database

CAP = "-g1 + 1/(20*g3^2) + exp(-10000)*(abs(g2 - {0}) + g2 - {0})^3*g1*g3"
"""Admissible but for a cap, where it is not, by less than any precision that is tried tells."""


def problem(place, **fields):
    potential = {"type": "expression", "expression": CAP.format(place)}
    motion = {"type": "planar", "nu": 1}
    return {**PLANAR, "body": {"A": 2, "C": 1}, "potential": potential, "motion": motion, **fields}


def submit(client, document):
    return client.post("/v1/jobs", json=document)


def code_of(response):
    return response.status_code, response.json()["type"].rpartition(":")[2]


def test_an_undecided_potential_is_refused_unless_it_is_accepted(client):
    refused = submit(client, problem("99/100"))
    assert code_of(refused) == (422, "undecided_potential")
    assert "pieces" in refused.json()["evidence"]["doubt"]
    assert submit(client, problem("99/100", accept="proved")).status_code == 422
    assert submit(client, problem("99/100", accept="undecided")).status_code == 202


def test_a_motion_that_enters_the_doubtful_cap_is_refused_by_name(client):
    # It reaches g2 = 0.943.
    assert code_of(submit(client, problem("9/10", accept="undecided"))) == (422, "undecided_motion")


def test_a_validation_of_the_whole_problem_says_the_same(client):
    asked = client.post("/v1/validations", json=problem("99/100", accept="undecided"))
    assert asked.status_code == 200
    assert asked.json()["verdict"] == "undecided"
    assert asked.json()["plan"]["window"]["ends"] == ["rest", "equator"]
    asked = client.post("/v1/validations", json=problem("9/10", accept="undecided"))
    assert code_of(asked) == (422, "undecided_motion")


def test_a_refuted_potential_is_refused_whatever_is_accepted(client):
    document = problem("99/100", accept="undecided", potential={"type": "expression", "expression": "g1+g2"})
    assert code_of(submit(client, document)) == (422, "inadmissible_potential")


def test_what_is_accepted_is_solved_as_the_motion_that_it_is():
    fields = {"time": {"times": ["0", "1", "10"]}, "outputs": ["gamma", "omega"]}
    found = solve_checked(json.dumps(problem("99/100", accept="undecided", **fields)))
    plain = problem("99/100", **fields)
    plain["potential"] = {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"}
    expected = solve_checked(json.dumps(plain))
    assert isinstance(found, Solved), found
    assert isinstance(expected, Solved), expected
    # The same motion, to e^-10000: what is left are the errors of both.
    one, other = found.summary["period"], expected.summary["period"]
    assert abs(one["value"] - other["value"]) <= one["error"] + other["error"] <= 1e-11
    assert solve_checked(json.dumps(problem("9/10", accept="undecided"))).error["code"] == "undecided_motion"


def test_the_default_leaves_the_digest_as_it_was():
    digests = [
        problem_digest(canonical_document(problem("99/100", **fields)))
        for fields in ({}, {"accept": "proved"}, {"accept": "undecided"})
    ]
    assert digests[0] == digests[1] != digests[2]
    assert "accept" not in canonical_document(problem("99/100"))


def test_another_word_is_a_fault_at_its_place(client):
    response = submit(client, problem("99/100", accept="anything"))
    assert response.status_code == 422
    assert [fault["pointer"] for fault in response.json()["errors"]] == ["/accept"]
