"""Classical motions over HTTP: listed, validated, refused, solved."""

import numpy as np
import pytest

from service.catalogue import classical
from tests.support.api import solve_job

pytestmark = pytest.mark.any_database

EXAMPLES = {row.case: row.example for row in classical() if row.example is not None}


def test_the_catalogue_lists_the_cases(client):
    rows = client.get("/v1/families").json()["classical"]
    assert [row["case"] for row in rows] == [*EXAMPLES, "dokshevich_1970"]
    assert {row["source"] for row in rows} == {"proved", "attribution", "candidate", "not_obtained"}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_are_accepted_as_jobs(client, name):
    assert client.post("/v1/jobs", json=EXAMPLES[name]).status_code == 202


@pytest.mark.parametrize("name", ["goriatchev", "hess", "staude"])
def test_a_solution_is_a_function_of_time_with_its_relations(client, jobs, name):
    solution = solve_job(client, jobs, EXAMPLES[name])
    assert solution["method"] == "quadrature"
    assert any(key.startswith("relation") for key in solution["invariants"])
    columns = client.get(f"/v1/solutions/{solution['id']}/trajectory?stop=3&samples=7").json()["columns"]
    length = sum(np.array(columns[g]) ** 2 for g in ("g1", "g2", "g3"))
    # The tier standard, three squares.
    np.testing.assert_allclose(length, 1.0, atol=6e-10)


def test_a_whole_problem_is_validated_with_its_plan(client):
    answer = client.post("/v1/validations", json=EXAMPLES["kowalewski"])
    assert answer.status_code == 200, answer.json()
    assert answer.json()["plan"]["method"] == "quadrature"


def test_a_body_that_misses_its_case_is_refused_with_the_nearest(client):
    document = {**EXAMPLES["goriatchev"], "body": {"A": 1, "B": "61/100", "C": "7/5"}}
    answer = client.post("/v1/jobs", json=document)
    assert answer.status_code == 422
    (fault,) = answer.json()["errors"]
    assert (fault["pointer"], fault["code"]) == ("/body", "case_condition")
    assert "the nearest that satisfy it are A = 0.99" in fault["message"]


def test_a_planar_motion_still_needs_both_moments(client):
    document = {**EXAMPLES["goriatchev"], "motion": {"type": "planar", "lambda": 1}, "body": {"B": 1}}
    answer = client.post("/v1/jobs", json=document)
    assert {fault["pointer"] for fault in answer.json()["errors"]} >= {"/body/A", "/body/C"}


@pytest.mark.parametrize("time", [{}, {"time": {"stop": 1, "samples": 2}}])
def test_a_validation_tells_on_which_case_a_state_lies(client, time):
    # q = 0 and a g3 = C p r, with p = 2/5 and r = 3/2: the motion of Bobylev and Steklov, of any areas.
    document = {
        "body": {"A": 2, "B": "3/2", "C": 1},
        "potential": {"type": "gravity", "a": 1},
        "motion": {"type": "state", "omega": ["2/5", 0, "3/2"], "gamma": [0, "4/5", "3/5"]},
        **time,
    }
    answer = client.post("/v1/validations", json=document)
    assert answer.status_code == 200, answer.json()
    found = answer.json()["classical"]
    assert found["on"] == ["bobylev_steklov"]
    assert found["nearest"]["case"] == "bobylev_steklov"
    assert found["nearest"]["distance"] <= 1e-15
    assert [each["case"] for each in found["integrable"]] == [
        "euler",
        "lagrange",
        "kovalevskaya",
        "goriachev_chaplygin",
    ]
