"""Where there is no motion, it is said for which λ there are, and only then is it searched."""

import json

import pytest

from service.schemas.replies.text import Answer, describe_verdict, existence_sentence
from service.schemas.replies.verdict import ExistenceOut
from service.verdicts import examination, refusals
from tests.support.examinations import examination_of
from workers.computation.compute import solve_checked, solve_document
from workers.sweeping.chunk import compute_chunk

THREE_TERMS = {"type": "expression", "expression": "a*g1 + b/g3^2", "parameters": {"a": -1, "b": "1/20"}}


def problem(lambda_="1/4", *, potential=THREE_TERMS, **motion):
    curve = {} if "nu" in motion else {"lambda": lambda_}
    return {
        "body": {"A": 2, "C": 1},
        "potential": potential,
        "motion": {"type": "planar", **curve, **motion},
        "time": {"stop": 1, "samples": 3},
        "outputs": ["period"],
    }


def expression(text):
    return {"type": "expression", "expression": text}


def error_of(document, **options):
    return json.loads(examination.examine_problem(json.dumps(document), **options))["error"]


@pytest.fixture
def searches(monkeypatch):
    """How often a search was made."""
    made = []
    original = refusals.find_existence

    def counted(*asked, **options):
        made.append(asked)
        return original(*asked, **options)

    monkeypatch.setattr(refusals, "find_existence", counted)
    return made


@pytest.fixture
def patient(monkeypatch):
    """On a loaded machine too a search comes to its end."""
    monkeypatch.setattr(refusals, "SECONDS", 3600.0)
    monkeypatch.setattr(refusals, "PROCESSOR_SECONDS", 60.0)


@pytest.mark.usefixtures("patient")
def test_the_error_of_a_problem_says_where_motions_are():
    error = error_of(problem())
    (motions,) = error["existence"]["lambda"]
    assert error["code"] == "no_motion"
    assert error["detail"].endswith("; motions exist for lambda in (0.58696, ∞)")
    assert abs(float(motions["from"]["mid"]) - 0.586964896) < 1e-5
    assert float(motions["from"]["rad"]) < 1e-4
    assert motions["to"] is None
    assert (error["existence"]["nu"], error["existence"]["undecided"]) == (None, [])


@pytest.mark.usefixtures("patient")
def test_the_answer_to_a_question_says_it_too():
    question = {name: value for name, value in problem().items() if name in ("body", "potential", "motion")}
    answer = json.loads(examination.examine_question(json.dumps(question)))
    verdict = Answer.model_validate(answer).verdict
    assert verdict.motions == []
    assert verdict.existence.lambda_[0].to is None
    assert "motions exist for lambda in (0.58696, ∞)" in describe_verdict(verdict)


@pytest.mark.parametrize(
    ("document", "said"),
    [
        (problem(potential=expression("g1")), "there is none for any lambda"),
        (problem(potential=expression("g1"), nu=2), "there is none for any nu"),
    ],
)
def test_where_there_is_none_at_all_that_is_said(document, said):
    assert error_of(document)["detail"].endswith(f"; {said}")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (
            {"nu": [{"from": None, "to": {"mid": "-0.34453", "rad": "4e-6"}}]},
            "motions exist for nu in (-∞, -0.3445)",
        ),
        (
            {
                "lambda": [{"from": None, "to": {"mid": "2", "rad": "0"}}],
                "undecided": [{"from": {"mid": "3", "rad": "0"}, "to": None}],
            },
            "motions exist for lambda in (0, 2); not decided for lambda in (3, ∞)",
        ),
        (
            {"lambda": [], "undecided": [{"from": None, "to": None}]},
            "none was found for any lambda; not decided for lambda in (0, ∞)",
        ),
    ],
)
def test_the_sentence(fields, said):
    existence = ExistenceOut.model_validate({"lambda": None, "nu": None, "undecided": [], **fields})
    assert existence_sentence(existence) == said


def test_a_problem_that_has_motions_costs_no_search(searches):
    assert "verdict" in json.loads(examination.examine_problem(json.dumps(problem(1))))
    question = {name: value for name, value in problem(1).items() if name in ("body", "potential", "motion")}
    answer = json.loads(examination.examine_question(json.dumps(question)))["verdict"]
    assert answer["motions"]
    assert answer["existence"] is None
    assert searches == []


def test_sweeps_do_not_search(searches):
    """Neither in blocks nor point by point, with verdicts shared or not."""
    lambdas = {"pointer": "/motion/lambda", "values": ["1/4", "1/3", 1]}
    for accuracy, axes in (
        ({"tier": "draft"}, [lambdas]),
        ({"tier": "standard"}, [lambdas]),
        ({"tier": "standard"}, [lambdas, {"pointer": "/body/A", "values": [2]}]),
    ):
        sweep = {
            "base": {**problem(), "accuracy": accuracy},
            "axes": axes,
            "keep": ["period"],
            "series": False,
        }
        outcome = compute_chunk(json.dumps({"sweep": sweep, "first": 0, "count": 3}))
        assert (outcome.count, outcome.refused) == (3, 2)
    assert solve_document(json.dumps(problem())).error["code"] == "no_motion"
    assert solve_checked(json.dumps(problem()), explains=False).error["code"] == "no_motion"
    assert searches == []


def examined(problems):
    return json.loads(examination.examine_problems(json.dumps(examination_of(problems))))["answers"]


def test_a_list_searches_once_for_problems_that_differ_in_lambda_and_not_for_too_many(searches):
    alike = [problem(f"1/{n}", potential=expression("g1")) for n in range(1, 5)]
    answers = examined(alike)
    assert len(searches) == 1
    assert all("there is none for any lambda" in answer["error"]["detail"] for answer in answers)
    searches.clear()
    unlike = [problem(potential=expression(f"{n}*g1")) for n in range(1, 8)]
    answers = examined(unlike)
    assert len(searches) == examination.MOST_SEARCHES
    assert ["existence" in answer["error"] for answer in answers] == [True] * 4 + [False] * 3
    assert all(answer["error"]["code"] == "no_motion" for answer in answers)
