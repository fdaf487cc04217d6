"""A list of problems is examined as each of its problems alone, whatever is found for many at once."""

import json
from dataclasses import replace
from fractions import Fraction

import pytest

from service.dynamics.reduction import windows as found_windows
from service.schemas.problem.problem import read_problem
from service.verdicts import cached
from service.verdicts.examination import examine_problem, examine_problems
from tests.support.examinations import examination_of

TIME = {"periods": 1, "samples": 11}
GRAVITY = {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": -1}, "time": TIME}
GENERAL = {
    "body": {"A": "17/10", "C": 1},
    "potential": {"type": "expression", "expression": "(A*g1^2+C*g3^2)*(g2^2-1/2+g2^3/5)"},
    "time": TIME,
}


def on_curve(base, lambda_, **motion):
    return {**base, "motion": {"type": "planar", "lambda": lambda_, **motion}}


def mixed():
    """Return problems of two potentials by turns, with windows chosen or not, and some without a motion."""
    problems = []
    for k in range(6):
        problems.append(on_curve(GRAVITY, f"{k + 1}/2"))
        problems.append(on_curve(GENERAL, f"{k + 3}/5"))
    problems.append(on_curve(GENERAL, "4/5", window=7))
    problems.append(on_curve(GENERAL, "4/5", window=0))
    problems.append(on_curve(GRAVITY, "2", g1_sign=-1))
    problems.append(on_curve({**GRAVITY, "potential": {"type": "expression", "expression": "g1+g3"}}, "2"))
    return problems


@pytest.mark.parametrize("together", [1, 2, 64])
def test_a_list_has_the_answers_of_its_problems(monkeypatch, together):
    monkeypatch.setattr(cached, "TOGETHER", together)
    monkeypatch.setattr(found_windows, "_KNOWN", {})
    asked = examination_of(mixed())
    reply = json.loads(examine_problems(json.dumps(asked)))
    alone = [json.loads(examine_problem(json.dumps(problem))) for problem in mixed()]
    for one, other in zip(reply["answers"], alone, strict=True):
        # Which of the problems without a motion gets a search for λ is another rule's.
        one.get("error", {}).pop("existence", None)
        other.get("error", {}).pop("existence", None)
        if one.get("error", {}).get("code") == "no_motion":
            one["error"].pop("detail")
            other["error"].pop("detail")
        assert one == other
    verdicts = {each["verdict"] for each in asked["problems"]}
    curves = {
        each["windows"]
        for each, answer in zip(asked["problems"], reply["answers"], strict=True)
        if answer.get("error", {}).get("code") != "inadmissible_potential"
    }
    assert set(reply["found"]) == verdicts | curves


def test_what_is_kept_is_not_found_again(monkeypatch):
    asked = examination_of([on_curve(GRAVITY, f"{k}/3") for k in range(1, 6)])
    found = json.loads(examine_problems(json.dumps(asked)))["found"]
    asked_for = []

    def counted(body, potential, motions):
        asked_for.append(len(motions))
        return found_windows.find_windows_together(body, potential, motions)

    monkeypatch.setattr(cached, "find_windows_together", counted)
    missing = {asked["problems"][k]["windows"] for k in (1, 3, 4)}
    asked["cached"] = {key: content for key, content in found.items() if key not in missing}
    again = json.loads(examine_problems(json.dumps(asked)))
    assert asked_for == [3]
    assert again["found"] == {key: found[key] for key in missing}


def test_each_problem_has_its_share_of_the_time(monkeypatch):
    """Eight seconds for the windows of four curves are two for each, though all were found for the first."""
    now = [0.0]

    def slow(*given):
        now[0] += 8.0
        return found_windows.find_windows_together(*given)

    monkeypatch.setattr(cached, "find_windows_together", slow)
    monkeypatch.setattr(cached.time, "perf_counter", lambda: now[0])
    problem = read_problem(on_curve(GRAVITY, "1"))
    motions = {f"curve {k}": replace(problem.motion, lambda_=Fraction(k)) for k in range(1, 5)}
    known = cached.ResultCache({}, [("setting", key, motion) for key, motion in motions.items()])
    shares = []
    for key, motion in motions.items():
        began = now[0]
        known.windows(key, problem.body, problem.potential, motion)
        now[0] += 0.5
        shares.append(known.share(key, now[0] - began))
    assert shares == [2.5] * 4
