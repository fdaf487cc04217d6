"""A potential with a simpler formula is examined by it, answered as the simpler one is, and told so."""

import json

import pytest

from service.dynamics.verdict.simple_form import SIMPLER_POTENTIAL
from service.verdicts.examination import examine_problem, examine_problems, examine_question
from service.verdicts.questions import examine_atlas
from tests.support.examinations import examination_of

BODY = {"A": 2, "B": "3/2", "C": 1}
Q = "(2*g1^2+g3^2)"
PAIRS = {
    "1e4*g1*(1+g3^2)-1e4*g1*g3^2-(1e4+1)*g1": "-g1",
    "1e6*(g1^2+g2^2+g3^2-1)-g1+1/20/g3^2": "-g1+1/20*g3^-2",
    "-g1+sqrt(1-g1^2-g3^2)*g3-abs(g2)*g3": "-g1",
}
UNSETTLED = f"{Q}*sin(1/(g2-1/2))*(g2-1/2)^3"
"""Its sign changes infinitely often."""


def question(text, **more):
    return {"body": BODY, "potential": {"type": "expression", "expression": text}, **more}


def problem(text, lambda_=1):
    motion = {"type": "planar", "lambda": lambda_}
    return question(text, motion=motion, time={"stop": 1, "samples": 3})


def verdict_of(document):
    return json.loads(examine_question(json.dumps(document)))["verdict"]


@pytest.mark.parametrize("typed", PAIRS)
def test_windows_are_those_of_the_simpler_formula(typed):
    motion = {"type": "planar", "lambda": 1}
    found, known = (verdict_of(question(text, motion=motion)) for text in (typed, PAIRS[typed]))
    assert found["motions"] == known["motions"]
    assert found["energy"]["h"] == known["energy"]["h"]
    assert [warning["code"] for warning in found["warnings"]] == [SIMPLER_POTENTIAL]
    assert known["warnings"] == []


@pytest.mark.one_in(2)
@pytest.mark.parametrize("typed", PAIRS)
def test_an_atlas_is_that_of_the_simpler_formula(typed):
    asked = {"lambda": ["1/2", 2], "samples": 9}
    found, known = (
        json.loads(examine_atlas(json.dumps(question(text, **asked)))) for text in (typed, PAIRS[typed])
    )
    assert found == known
    assert "verdict" in found, found


def test_problems_of_a_list_are_examined_by_it():
    """All of one potential find their windows together; those of one that is as good are as alone."""
    typed = next(iter(PAIRS))
    documents = [problem(text, n) for text in (typed, PAIRS[typed]) for n in (1, 2, 3)]
    answers = json.loads(examine_problems(json.dumps(examination_of(documents))))["answers"]
    alone = [json.loads(examine_problem(json.dumps(document))) for document in documents]
    assert [answer["verdict"]["motions"] for answer in answers] == [
        each["verdict"]["motions"] for each in alone
    ]
    assert [each["verdict"]["motions"] for each in alone[:3]] == [
        each["verdict"]["motions"] for each in alone[3:]
    ]


@pytest.mark.one_in(2)
@pytest.mark.parametrize("examine", [examine_problem, examine_question])
def test_a_refusal_of_windows_tells_the_verdict(examine):
    error = json.loads(examine(json.dumps(problem(UNSETTLED))))["error"]
    assert (error["code"], error["verdict"]) == ("essential_singularity", "admissible")
