"""Refusals that need the mathematics, by a real child process."""

import json

import pytest

from service.dynamics.verdict.verdict import NumericEvidence, Verdict
from service.schemas.problem.problem import read_problem
from service.verdicts.examination import examine_document, examine_problem
from tests.support.api import PLANAR

pytestmark = pytest.mark.any_database

DOUBLE = {"A": 2, "C": 1}


def expression(text, **parameters):
    return {"type": "expression", "expression": text, "parameters": parameters}


def validate(client, potential, body=None, **motion):
    document = {"body": body or DOUBLE, "potential": potential}
    if motion:
        document["motion"] = {"type": "planar", **motion}
    response = client.post("/v1/validations", json=document)
    assert response.status_code == 200, response.json()
    return response.json()


def submit(client, potential, *, method="auto", body=None, **motion):
    problem = {**PLANAR, "potential": potential, "motion": {"type": "planar", **motion}, "method": method}
    return client.post("/v1/jobs", json={**problem, "body": body or {**DOUBLE, "B": "3/2"}})


def refused(response, code):
    document = response.json()
    assert (response.status_code, document["type"]) == (422, f"urn:polhode:problem:{code}"), document
    return document


def test_an_admissible_potential_is_proved_so_and_its_motions_are_listed(client):
    verdict = validate(client, expression("-g1"), nu=1)
    assert (verdict["verdict"], verdict["proof"]) == ("admissible", "symbolic")
    assert verdict["counterexample"] is None
    (motion,) = verdict["motions"]
    # x = g1 at the equator: 1 - x² - x = 0; one rounding.
    assert motion["g1"] == pytest.approx([0.0, (5**0.5 - 1) / 2], abs=4e-16)
    assert (motion["window"], motion["kind"], motion["ends"]) == (0, "periodic", ["pole", "equator"])


def test_without_a_motion_there_are_no_windows_in_the_answer(client):
    assert validate(client, expression("-g1"))["motions"] is None


def test_an_admissible_potential_without_a_motion_there_has_an_empty_list(client):
    assert validate(client, expression("g1"), nu=1)["motions"] == []


def test_an_inadmissible_potential_comes_with_its_counterexample(client):
    gravity = {"type": "gravity", "a": 1, "b": 1}
    verdict = validate(client, gravity, nu=1)
    assert (verdict["verdict"], verdict["proof"]) == ("inadmissible", "counterexample")
    assert verdict["motions"] is None
    assert len(verdict["counterexample"]["g"]) == 3
    document = refused(submit(client, gravity, nu=1), "inadmissible_potential")
    assert document["counterexample"] == verdict["counterexample"]
    assert document["errors"][0]["pointer"] == "/potential"


def test_a_potential_without_values_is_refused(client):
    document = {"body": DOUBLE, "potential": expression("sqrt(-1 - g1^2)")}
    refused(client.post("/v1/validations", json=document), "undefined_potential")


def test_no_motion_is_refused_before_there_is_a_job(client):
    refused(submit(client, expression("g1"), nu=1), "no_motion")
    assert client.get("/v1/jobs").json()["total"] == 0


SEVERAL = "g1 - (1-1e-8)/(16*g3^2) - (g1^2-g2^2)"


def test_several_motions_are_listed(client):
    document = refused(submit(client, expression(SEVERAL), nu=1), "several_windows")
    assert [window["kind"] for window in document["windows"]] == ["collision", "periodic"]
    assert [window["window"] for window in document["windows"]] == [0, 1]
    assert submit(client, expression(SEVERAL), nu=1, window=1).status_code == 202


def test_a_window_that_is_not_there_is_refused(client):
    refused(submit(client, expression(SEVERAL), nu=1, window=2), "no_such_window")


def test_a_start_beside_the_motion_is_refused(client):
    document = refused(submit(client, expression("-g1"), nu=1, start={"g1": "7/10"}), "start_outside_window")
    assert document["errors"][0]["pointer"].startswith("/motion/start")


SEPARATRIX = expression("-g1 + (1+sqrt(5))/4*(g1^2-g2^2)")
"""It has no rest point and reaches the equator never."""


def test_a_separatrix_between_equilibria_needs_a_start(client):
    document = refused(submit(client, SEPARATRIX, nu=1), "start_needed")
    assert document["errors"][0]["pointer"] == "/motion/start"
    assert submit(client, SEPARATRIX, nu=1, start={"g1": "1/2"}).status_code == 202


def test_periods_of_a_motion_that_never_closes_are_refused(client):
    motion = {"type": "planar", "nu": 1, "start": {"g1": "1/2"}}
    time = {"periods": 1, "samples": 3}
    problem = {**PLANAR, "potential": SEPARATRIX, "motion": motion, "time": time}
    document = refused(client.post("/v1/jobs", json=problem), "period_needed")
    assert document["errors"][0]["pointer"] == "/time/periods"


def test_what_nothing_is_known_of_is_refused_with_the_evidence(monkeypatch):
    undecided = Verdict("undecided", "numeric", evidence=NumericEvidence(9, 4096, "0 ± 1", "that it holds"))
    monkeypatch.setattr("service.verdicts.cached.decide", lambda *_: undecided)
    error = json.loads(examine_problem(json.dumps(PLANAR)))["error"]
    assert error["code"] == "undecided_potential"
    assert error["evidence"] == {
        "points": 9,
        "bits": 4096,
        "largest_enclosure": "0 ± 1",
        "doubt": "that it holds",
    }


def test_what_nobody_has_validated_is_refused_with_every_fault_by_who_does():
    error = examine_document({}, read=read_problem).answer["error"]
    assert error["code"] == "invalid_problem"
    assert {"/body", "/potential", "/motion", "/time"} <= {fault["pointer"] for fault in error["faults"]}
