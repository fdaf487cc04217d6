"""A validation of a whole problem is what submitting it would be, without the job."""

import json

import pytest

from service.dynamics.accuracy import TIER_TOLERANCES, TIERS
from service.schemas.problem.problem import read_problem, read_question
from service.verdicts.examination import examine_problem, examine_question
from service.verdicts.refusals import refusal_of_reading
from tests.support.api import PLANAR, STATE, finish

pytestmark = pytest.mark.any_database

DOUBLE = {"A": 2, "C": 1}
SEVERAL = "g1 - (1-1e-8)/(16*g3^2) - (g1^2-g2^2)"
SEPARATRIX = "-g1 + (1+sqrt(5))/4*(g1^2-g2^2)"


def expression(text, **parameters):
    return {"type": "expression", "expression": text, "parameters": parameters}


def problem(text="-g1", nu=1, time=None, **sections):
    motion = {"type": "planar", "nu": nu, **sections.pop("motion", {})}
    time = time or {"stop": 1, "samples": 3}
    return {"body": DOUBLE, "potential": expression(text), "motion": motion, "time": time, **sections}


def error_of(read, examine, document):
    """Return why a document is refused: by who validates it, else by its examination."""
    return refusal_of_reading(document, read) or json.loads(examine(json.dumps(document))).get("error")


REFUSED = {
    "invalid_problem": {**problem(nu="1e-400"), "method": "guess", "outputs": ["gamma", "alpha"], "x": 1},
    "combination": problem(method="integration", accuracy={"tier": "certified"}, outputs=["stability"]),
    "state": {**STATE, "method": "both", "time": {"periods": 1, "samples": 3}, "outputs": ["stability"]},
    "undefined_potential": problem("sqrt(-1 - g1^2)"),
    "inadmissible_potential": problem("g1 + g2"),
    "no_motion": problem("g1"),
    "several_windows": problem(SEVERAL),
    "no_such_window": problem(motion={"window": 5}),
    "start_outside_window": problem(motion={"start": {"g1": "7/10"}}),
    "start_needed": problem(SEPARATRIX),
    "period_needed": problem(SEPARATRIX, motion={"start": {"g1": "1/2"}}, time={"periods": 1, "samples": 3}),
}


@pytest.mark.parametrize("document", REFUSED.values(), ids=REFUSED)
def test_a_problem_is_refused_with_what_its_job_would_be_refused_with(document):
    refusal = error_of(read_problem, examine_problem, document)
    assert refusal is not None
    found = error_of(read_question, examine_question, document)
    if refusal["code"] != "invalid_problem":
        # Besides it tells the nearest polynomial, which nobody looks for before a job.
        assert {name: each for name, each in found.items() if name != "nearest"} == refusal
        return
    # The fields that are accepted are the same, with two more.
    for fault in [*found["faults"], *refusal["faults"]]:
        fault["message"] = fault["message"].replace(", points", "").replace(", nearest", "")
    assert found["faults"] == refusal["faults"]


NORTHERN = "-g1 + g1^2 - g2^2"
"""Its one window does not reach the equator."""


@pytest.mark.parametrize(
    ("text", "motion", "code"),
    [
        (NORTHERN, {"window": 5}, "no_such_window"),
        (NORTHERN, {"start": {"at": "equator"}}, "start_outside_window"),
        (SEVERAL, {"window": 2}, "no_such_window"),
        (SEVERAL, {"window": 0, "start": {"g1": "-7/10"}}, "start_outside_window"),
        ("g1", {"window": 0}, "no_motion"),
    ],
)
def test_what_a_motion_asks_for_is_judged_without_times_too(text, motion, code):
    document = problem(text, motion=motion)
    refusal = error_of(read_problem, examine_problem, document)
    del document["time"]
    assert refusal["code"] == code
    assert error_of(read_question, examine_question, document) == refusal


def test_the_windows_that_there_are_come_with_the_one_that_is_not():
    refusal = error_of(read_question, examine_question, problem(NORTHERN, motion={"window": 5}))
    assert [window["window"] for window in refusal["windows"]] == [0]
    assert "accepted is 0" in refusal["detail"]


def test_a_motion_that_asks_for_no_window_is_answered_by_all():
    document = problem(SEVERAL, motion={"start": {"at": "equator"}})
    del document["time"]
    verdict = json.loads(examine_question(json.dumps(document)))["verdict"]
    assert ([window["window"] for window in verdict["motions"]], verdict["plan"]) == ([0, 1], None)


def validated(client, document):
    response = client.post("/v1/validations", json=document)
    assert response.status_code == 200, response.json()
    return response.json()


def test_a_plan_says_what_a_job_would_do_and_nothing_is_stored(client):
    found = validated(client, {**problem(SEVERAL, motion={"window": 1}), "accuracy": {"tolerance": "1e-12"}})
    plan = found["plan"]
    assert (plan["method"], plan["tier"], plan["tolerance"], plan["samples"]) == (
        "quadrature",
        "high",
        1e-12,
        3,
    )
    assert plan["window"] == found["motions"][1]
    assert len(found["motions"]) == 2
    assert plan["expected_seconds"] > 0
    assert found["decomposition"] is not None
    assert client.get("/v1/jobs").json()["total"] == 0


def test_a_plan_tells_all_four_tiers(client):
    plan = validated(client, {**PLANAR, "accuracy": {"tolerance": "1e-12"}})["plan"]
    tiers = plan["tiers"]
    assert [each["tier"] for each in tiers] == list(TIERS)
    assert [each["tolerance"] for each in tiers] == [TIER_TOLERANCES[tier] for tier in TIERS]
    for each in tiers:
        # Every tier has solved polynomials, and none has claimed more than it promises.
        assert each["unavailable"] is None
        assert each["expected_seconds"] > 0
        assert 0 < each["expected_error"] <= each["tolerance"]
    assert plan["expected_seconds"] == tiers[2]["expected_seconds"]


def test_an_unusual_motion_is_not_expected_to_take_as_long_as_others(client):
    document = {**PLANAR, "body": {"A": 7, "C": 5}}
    document["potential"] = {"type": "expression", "expression": "-abs(g1)^(4/7)"}
    plan = validated(client, document)["plan"]
    assert [remark["code"] for remark in plan["remarks"]] == ["pole_passage"]
    assert plan["expected_seconds"] is None
    for each in plan["tiers"]:
        assert (each["expected_seconds"], each["expected_error"], each["unavailable"]) == (None, None, None)


def test_a_plan_tells_what_proven_steps_from_any_state_cost(client):
    *_, certified = validated(client, STATE)["plan"]["tiers"]
    assert certified["unavailable"] is None
    assert certified["expected_seconds"] > 0
    assert certified["expected_error"] <= certified["tolerance"]


def test_a_budget_is_turned_into_the_tier_that_its_job_gets(client):
    document = {**PLANAR, "accuracy": {"budget_seconds": 100}}
    plan = validated(client, document)["plan"]
    job = client.post("/v1/jobs", json=document).json()
    assert job["problem"]["accuracy"] == {"tier": plan["tier"]}
    assert plan["solution"] is None


def test_a_state_needs_no_verdict_and_its_solution_is_found_again(client, jobs):
    found = validated(client, STATE)
    assert (found["verdict"], found["proof"], found["motions"]) == (None, None, None)
    assert (found["plan"]["method"], found["plan"]["window"]) == ("integration", None)
    assert found["known_cases"] == []
    client.post("/v1/jobs", json=STATE)
    solution = finish(jobs).solution_id
    assert validated(client, STATE)["plan"]["solution"] == solution
    assert client.get("/v1/jobs").json()["total"] == 1


def test_the_limits_of_the_installation_are_told_in_the_same_words(client, monkeypatch):
    monkeypatch.setattr(client.app.state.resources.settings, "max_samples", 50)
    for document in (
        {**PLANAR, "time": {"stop": 1, "samples": 100_000}},
        {**STATE, "time": {"times": [*range(100_000)]}},
    ):
        answers = [client.post(path, json=document).json() for path in ("/v1/jobs", "/v1/validations")]
        for answer in answers:
            del answer["request_id"]
        assert answers[0] == answers[1]
        assert answers[0]["errors"][0]["code"] == "out_of_range"


@pytest.mark.parametrize(
    ("text", "kinds", "ends"),
    [
        # Where γ₂ = 1/2 p² is infinite: on the way of a motion whose |γ₁| is smallest and largest elsewhere.
        (
            "-g1-(2*g1^2+g3^2)/20/(1/2-g2)",
            ["periodic", "collision"],
            [["pole", "rest"], ["pole", "equator"]],
        ),
        ("-g1-(2*g1^2+g3^2)/20/g2^2", ["collision"], [["pole", "collision"]]),
    ],
)
def test_windows_next_to_an_infinite_p_squared_are_collisions(client, text, kinds, ends):
    document = problem(text)
    del document["time"]
    found = validated(client, document)
    assert found["verdict"] == "admissible"
    assert [window["kind"] for window in found["motions"]] == kinds
    assert [window["ends"] for window in found["motions"]] == ends
