"""POST /v1/validations: a verdict, and nothing is stored."""

import json
from collections.abc import Mapping
from dataclasses import dataclass

from fastapi import APIRouter, Request, Response
from starlette.concurrency import run_in_threadpool

from service.answers import plan_document
from service.api.disconnects import while_connected
from service.api.documentation import request_body
from service.api.examining import examine
from service.api.limits import check_problem_samples
from service.api.queries import without_query
from service.api.requests import Body, read_json
from service.api.resources import Inside, Resources
from service.api.responses import json_response, refusals
from service.api.security import Holder
from service.api.submission import needs_verdict, settle
from service.api.verdict_queue import Claimant
from service.examination import examine_question
from service.schemas.budgets import seconds_of
from service.schemas.problem import CheckedProblem, Question, read_question
from service.schemas.sections import ProblemIn
from service.schemas.verdict import VerdictOut
from service.settings import Settings
from service.storage.solutions.accuracy_store import AccuracyStore

router = APIRouter(prefix="/v1/validations", tags=["validations"])

EXAMPLES: dict[str, object] = {
    "admissible": {
        "value": {
            "body": {"A": 2, "C": 1},
            "potential": {
                "type": "expression",
                "expression": "a*g1 + b/g3^2",
                "parameters": {"a": -1, "b": "1/20"},
            },
            "motion": {"type": "planar", "lambda": 1},
        }
    },
    "whole problem": {
        "value": {
            "body": {"A": 2, "C": 1},
            "potential": {"type": "gravity", "a": -1},
            "motion": {"type": "planar", "lambda": 1},
            "time": {"periods": 1, "samples": 101},
            "accuracy": {"tolerance": 1e-12},
        }
    },
    "inadmissible": {"value": {"body": {"A": 2, "C": 1}, "potential": {"type": "gravity", "a": 1, "b": 1}}},
}


@router.post(
    "",
    response_model=VerdictOut,
    responses=refusals(400, 408, 413, 415, 503),
    openapi_extra=request_body("ValidationIn", EXAMPLES),
    dependencies=[without_query],
)
async def validate(content: Body, inside: Inside, holder: Holder, request: Request) -> Response:
    """Say whether a potential admits planar motions, how that is known, and which motions there are.

    A document with a motion and times is a whole problem. It is refused with
    whatever `POST /v1/jobs` would refuse it with; else `plan` says what its job
    would do. Nothing is stored.
    """
    asked = await inside.reading.run(len(content), _checked, content, inside.settings)
    whole, verdict = asked.question.problem, None
    if whole is None or needs_verdict(whole):
        claimant = Claimant(None if holder is None else holder.id)
        work = examine(inside.verdicts, examine_question, asked.text, claimant)
        verdict = await while_connected(request, work)
    if whole is None:
        return json_response(VerdictOut.model_validate(verdict))
    return await run_in_threadpool(_planned, inside, asked.document, whole, verdict)


@dataclass(frozen=True, slots=True)
class _Asked:
    question: Question
    document: Mapping[str, object]
    text: str


def _checked(content: bytes, settings: Settings) -> _Asked:
    document = read_json(content)
    question = read_question(document)
    assert isinstance(document, dict)
    if question.problem is not None:
        check_problem_samples(question.problem.problem, settings)
    return _Asked(question, document, json.dumps(document))


def _planned(
    inside: Resources,
    document: Mapping[str, object],
    checked: CheckedProblem,
    verdict: Mapping[str, object] | None,
) -> Response:
    if verdict is None:
        plan = plan_document(checked.problem, None)
        verdict = {**dict.fromkeys(VerdictOut.model_fields), "warnings": [], "plan": plan}
    plan = _completed(inside, document, checked, verdict["plan"])
    return json_response(VerdictOut.model_validate({**verdict, "plan": plan}))


def _completed(
    inside: Resources, document: Mapping[str, object], checked: CheckedProblem, plan: object
) -> dict[str, object]:
    """Return the plan of a job with what this installation knows of it."""
    assert isinstance(plan, dict)
    window, table = plan["window"], AccuracyStore(inside.database).current()
    problem = {name: part for name, part in document.items() if name in ProblemIn.model_fields}
    accepted = settle(problem, checked, window, table)
    return {
        **plan,
        "tier": accepted.problem.accuracy.tier,
        "tolerance": accepted.problem.tolerance,
        "expected_seconds": seconds_of(accepted.problem, window, table),
        "solution": inside.solutions.of_problem(accepted.digest),
    }
