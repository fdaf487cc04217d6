"""Many problems by one request: one answer for each, in order, and one transaction."""

import json
import os
import signal
import time
from collections import deque

import pytest

from service.api import submission
from service.api.submission import MOST_PROBLEMS
from service.dynamics.verdict.verdict import decide
from service.sandbox import Sandbox
from service.storage.jobs.job_store import JobStore
from service.verdicts import cached, examination
from tests.support.api import PLANAR, STATE
from tests.support.examinations import examination_of
from tests.support.finishing import finish_success
from tests.support.lists import list_jobs

INADMISSIBLE = {**PLANAR, "potential": {"type": "expression", "expression": "g1*g2"}}
BROKEN = {**STATE, "body": {"A": "x", "B": 1, "C": 1}}


def with_lambda(value):
    return {**PLANAR, "motion": {"type": "planar", "lambda": value}}


def post(client, problems, **params):
    return client.post("/v1/jobs", json=problems, params=params)


def test_each_problem_has_its_answer_in_order(client):
    response = post(client, [STATE, BROKEN, PLANAR, INADMISSIBLE, "no problem", with_lambda(2)])
    assert response.status_code == 202
    items = response.json()["items"]
    assert [item["status"] for item in items] == [202, 422, 202, 422, 422, 202]
    assert [item["job"] and item["job"]["problem"] for item in items] == [
        STATE, None, PLANAR, None, None, with_lambda(2),
    ]  # fmt: skip
    for item in items:
        assert (item["job"] is None) == (item["problem"] is not None)
        if item["job"] is not None:
            assert client.get(f"/v1/jobs/{item['job']['id']}").json() == item["job"]


@pytest.mark.any_database
def test_a_refusal_is_the_one_the_problem_would_meet_alone(client):
    response = post(client, [STATE, BROKEN, INADMISSIBLE])
    for item, problem in zip(response.json()["items"][1:], (BROKEN, INADMISSIBLE), strict=True):
        alone = client.post("/v1/jobs", json=problem).json()
        del alone["request_id"]
        assert item["problem"] == alone


@pytest.mark.any_database
def test_nothing_accepted_is_a_refusal_that_names_every_place(client, jobs):
    response = post(client, [BROKEN, INADMISSIBLE])
    assert (response.status_code, response.headers["content-type"]) == (422, "application/problem+json")
    document = response.json()
    assert document["type"].endswith("no_problem_accepted")
    assert [fault["pointer"] for fault in document["errors"]] == ["/0/body/A", "/1/potential"]
    assert [item["status"] for item in document["items"]] == [422, 422]
    assert list_jobs(jobs).total == 0


@pytest.mark.any_database
@pytest.mark.parametrize("count", [0, MOST_PROBLEMS + 1])
def test_the_length_of_a_list_is_limited(client, count):
    response = post(client, [{}] * count)
    assert (response.status_code, response.json()["errors"][0]["code"]) == (422, "out_of_range")


def test_equal_problems_and_those_solved_before_are_not_computed_twice(client, stored, jobs):
    items = post(client, [STATE, PLANAR, PLANAR]).json()["items"]
    assert [item["job"]["reused"] for item in items] == [True, False, False]
    assert items[0]["job"]["solution"] == stored.solution_id
    claim = jobs.claim("test", lease_seconds=60)
    assert claim.job_id == items[1]["job"]["id"]
    assert finish_success(jobs, claim, {"method": "quadrature"}, dense=b"", samples=b"")
    assert jobs.take("test", 5, lease_seconds=60).reused == (items[2]["job"]["id"],)


def test_either_all_accepted_problems_are_stored_or_none(client, jobs, monkeypatch):
    def fail(self, session, has_queued):
        raise RuntimeError("between the jobs and the commit")

    monkeypatch.setattr(JobStore, "_announce", fail)
    assert post(client, [STATE, PLANAR]).status_code == 500
    monkeypatch.undo()
    assert list_jobs(jobs).total == 0


@pytest.mark.any_database
def test_priority_is_taken_kept_and_limited(client, jobs):
    low = client.post("/v1/jobs", json=STATE, params={"priority": -100}).json()
    high = post(client, [PLANAR, with_lambda(2)], priority=100).json()["items"]
    assert [item["job"]["priority"] for item in high] == [100, 100]
    assert low["priority"] == -100
    claimed = [claim.job_id for claim in jobs.take("test", 3, lease_seconds=60).claims]
    assert claimed == [high[0]["job"]["id"], high[1]["job"]["id"], low["id"]]
    for value in ("101", "-101", "1.5", "high"):
        refused = client.post("/v1/jobs", json=STATE, params={"priority": value})
        assert (refused.status_code, refused.json()["errors"][0]["pointer"]) == (422, "?priority")


@pytest.mark.any_database
def test_a_problem_that_kills_its_examination_takes_no_other_with_it(client, monkeypatch):
    """The batch dies with it, then each is examined alone, the one to blame twice."""
    calls = []
    submit = Sandbox.submit

    def spy(self, function, text, *, seconds, slot):
        calls.append(len(json.loads(text)["problems"]))
        return submit(self, examine_or_die, text, seconds=seconds)

    monkeypatch.setattr(Sandbox, "submit", spy)
    monkeypatch.setattr(submission, "_TOGETHER", 50)
    items = post(client, [with_lambda(1), with_lambda(13), with_lambda(2)]).json()["items"]
    assert [item["status"] for item in items] == [202, 422, 202]
    assert items[1]["problem"]["type"].endswith("verdict_crashed")
    assert calls == [3, 1, 1, 1, 1]


@pytest.mark.any_database
def test_a_problem_whose_child_is_killed_by_somebody_else_is_examined_once_more(client, monkeypatch):
    functions = deque([die, die])
    submit = Sandbox.submit

    def interfere(self, function, text, *, seconds, slot):
        return submit(self, functions.popleft() if functions else function, text, seconds=seconds)

    monkeypatch.setattr(Sandbox, "submit", interfere)
    # The batch, then the first of it alone.
    items = post(client, [with_lambda(1), with_lambda(2)]).json()["items"]
    assert [item["status"] for item in items] == [202, 202]
    functions.append(die)
    assert client.post("/v1/jobs", json=with_lambda(3)).status_code == 202


@pytest.mark.any_database
def test_a_problem_whose_turn_does_not_come_in_the_time_of_its_list_is_to_be_sent_again(
    client, app, monkeypatch
):
    """It was never examined: a verdict_time_limit would tell its author to change a formula that is good."""
    most = app.state.resources.verdicts.most
    problems = [with_lambda(value + 1) for value in range(most + 1)]
    with monkeypatch.context() as patch:
        patch.setattr(submission, "_TOGETHER", 1)
        patch.setattr(submission, "LIST_VERDICTS", 0.01)
        patch.setattr(Sandbox, "submit", slowly(Sandbox.submit))
        items = post(client, problems).json()["items"]
        assert [item["status"] for item in items] == most * [202] + [503]
        assert items[-1]["problem"]["type"].endswith("verdicts_busy")
        patch.setattr(submission, "LIST_VERDICTS", -1)
        nothing = post(client, [with_lambda(20), with_lambda(21)])
        assert (nothing.status_code, "retry-after" in nothing.headers) == (503, True)
    assert [item["status"] for item in post(client, problems[-1:]).json()["items"]] == [202]


@pytest.mark.any_database
def test_problems_that_took_the_time_of_their_list_together_are_refused_for_good(client, app, monkeypatch):
    """Else whoever sends a list of hopeless formulas again and again would never hear of it."""
    monkeypatch.setattr(submission, "LIST_VERDICTS", 0.5)
    monkeypatch.setattr(app.state.resources.settings, "verdict_seconds", 0.4)
    monkeypatch.setattr(Sandbox, "submit", slowly(Sandbox.submit))
    refused = post(client, [with_lambda(1), with_lambda(2)])
    assert refused.status_code == 422
    codes = {item["problem"]["type"].rpartition(":")[2] for item in refused.json()["items"]}
    assert codes == {"verdict_time_limit"}


def slowly(submit):
    """Return a way to start a child that takes a second longer than it needs."""

    def slow(self, function, text, *, seconds, slot):
        return submit(self, examine_slowly, text, seconds=seconds)

    return slow


def examine_slowly(text):
    time.sleep(1.0)
    return examination.examine_problems(text)


def die(text):
    os.kill(os.getpid(), signal.SIGKILL)


def examine_or_die(text):
    """Examine problems, and die of one with λ = 13."""
    if any(problem["document"]["motion"]["lambda"] == 13 for problem in json.loads(text)["problems"]):
        os.kill(os.getpid(), signal.SIGKILL)
    return examination.examine_problems(text)


@pytest.mark.any_database
def test_equal_potentials_are_judged_once(monkeypatch):
    judged = []
    monkeypatch.setattr(cached, "decide", lambda *given: judged.append(given) or decide(*given))
    problems = [with_lambda(value) for value in (1, 2, 3)] + [INADMISSIBLE]
    asked = examination_of(problems)
    reply = json.loads(examination.examine_problems(json.dumps(asked)))
    assert len(judged) == 2
    alone = [json.loads(examination.examine_problem(json.dumps(problem))) for problem in problems]
    assert reply["answers"] == alone
    # Two verdicts, and the windows of three curves.
    assert len(reply["found"]) == 5
    judged.clear()
    again = json.loads(examination.examine_problems(json.dumps({**asked, "cached": reply["found"]})))
    assert (again["answers"], again["found"]) == (alone, {})
    assert len(again["seconds"]) == len(problems)
    assert judged == []
