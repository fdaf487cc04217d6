"""POST /v1/validations: returns a verdict, and stores nothing."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Body, Inside, Resources, read_json
from service.api.descriptions import request_body
from service.api.keys.limits import check_problem_samples
from service.api.middleware.heavy_answers import while_connected
from service.api.middleware.security import Holder
from service.api.queries.queries import QueryModel, query_of, query_parameters
from service.api.replies import json_response, refusals
from service.api.submission import needs_verdict
from service.api.verdicts.examiner import Submission, examine, examine_with_formulas
from service.api.verdicts.verdict_queue import Claimant
from service.dynamics.accuracy import TIER_TOLERANCES, TIERS, AccuracyTable, Expected, Tier, Unavailable
from service.dynamics.problem import Problem
from service.schemas.problem.documents import CheckedProblem, ProblemIn
from service.schemas.problem.problem import Question, check_problem, check_question, expected_of_tiers
from service.schemas.problem.trusted import ONE_AT_A_TIME
from service.schemas.reading.documents import Document, InvalidProblemError, Part
from service.schemas.replies.verdict import VerdictOut
from service.settings import Settings
from service.storage.solutions.accuracy_store import AccuracyStore
from service.typesetting.equations import FORMATS, Format
from service.verdicts.documents import UNUSUAL, known_cases_document, plan_document
from service.verdicts.examination import classification_of, examine_question

FORMAT = "(text|latex|mathml)"


class ValidationQuery(QueryModel):
    """The further forms of the formulas that the answer should have."""

    formulas: str | None = Field(
        default=None,
        pattern=f"^{FORMAT}(,{FORMAT})*$",
        description="Formats with commas between: `text`, `latex`, `mathml`. The answer then has `formulas`,"
        " simplified where that takes no longer than a second or two in all.",
        examples=["latex", "text,latex,mathml"],
    )

    @property
    def formats(self) -> list[Format]:
        """The formats, each once."""
        asked = [] if self.formulas is None else self.formulas.split(",")
        return [each for each in FORMATS if each in asked]


router = APIRouter(prefix="/v1/validations", tags=["validations"])

EXAMPLES: Document = {
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
    openapi_extra={**request_body("ValidationIn", EXAMPLES), **query_parameters(ValidationQuery)},
)
async def validate(
    content: Body,
    inside: Inside,
    holder: Holder,
    request: Request,
    query: Annotated[ValidationQuery, Depends(query_of(ValidationQuery))],
) -> Response:
    """Tell whether a potential admits planar motions, with the proof, and list the motions.

    A document with a motion and times is a whole problem. It is refused with
    the errors that `POST /v1/jobs` would give; otherwise `plan` says what its job
    would do. Nothing is stored.
    """
    asked = await inside.reading.run(len(content), _checked, content, inside.settings)
    whole, verdict = asked.whole, None
    if whole is None or needs_verdict(whole):
        claimant = Claimant(None if holder is None else holder.id)
        verdict = await while_connected(request, _judged(inside, asked, query.formats, claimant))
    if whole is None:
        return json_response(VerdictOut.model_validate(verdict))
    return await run_in_threadpool(_planned, inside, asked, whole, verdict)


@dataclass(frozen=True, slots=True)
class _Asked:
    question: Question
    whole: CheckedProblem | None
    """The problem, if motion and times are given."""
    document: Document
    text: str


async def _judged(
    inside: Resources, asked: _Asked, formats: Sequence[Format], claimant: Claimant
) -> Part | None:
    if not formats:
        return await examine(inside.verdicts, examine_question, asked.text, claimant)
    seconds = inside.settings.formula_seconds
    return await examine_with_formulas(inside.verdicts, asked.document, formats, claimant, seconds=seconds)


def _checked(content: bytes, settings: Settings) -> _Asked:
    document = read_json(content)
    question, whole = check_question(document)
    if whole is not None:
        check_problem_samples(whole.problem, settings)
    return _Asked(question, whole, document, json.dumps(document))


def _planned(
    inside: Resources,
    asked: _Asked,
    checked: CheckedProblem,
    verdict: Part | None,
) -> Response:
    if verdict is None:
        with ONE_AT_A_TIME:
            found = classification_of(asked.question)
            known = known_cases_document(asked.question.body, asked.question.potential)
        plan = plan_document(checked.problem, None)
        nothing = dict.fromkeys(VerdictOut.model_fields)
        verdict = {**nothing, "warnings": [], "plan": plan, "classical": found, "known_cases": known}
    completed = _completed(inside, asked.document, checked, verdict["plan"])
    return json_response(VerdictOut.model_validate({**verdict, "plan": completed}))


def _completed(inside: Resources, document: Document, checked: CheckedProblem, plan: Part) -> Part:
    """Add to the plan of a job the expected seconds and a stored solution."""
    window, table = plan["window"], AccuracyStore(inside.database).current()
    problem = {name: part for name, part in document.items() if name in ProblemIn.model_fields}
    accepted = Submission(problem, checked).settled(window, table)
    settled = accepted.checked.problem
    is_usual = UNUSUAL.isdisjoint(str(remark["code"]) for remark in plan["remarks"])
    tiers = _tiers(problem, settled, window, table, is_usual=is_usual)
    return {
        **plan,
        "tier": settled.accuracy.tier,
        "tolerance": settled.tolerance,
        "expected_seconds": tiers[TIERS.index(settled.accuracy.tier)]["expected_seconds"],
        "tiers": tiers,
        "solution": inside.solutions.of_problem(accepted.digest),
    }


def _tiers(
    document: Document,
    problem: Problem,
    window: Document | None,
    table: AccuracyTable,
    *,
    is_usual: bool,
) -> list[dict[str, object]]:
    """Return what each tier is expected to do with a problem, or why it refuses it."""
    tiers = list[dict[str, object]]()
    for tier, expectation in expected_of_tiers(problem, window, table).items():
        refusal = None if tier == problem.accuracy.tier else _refusal_at(document, tier)
        if refusal is None and isinstance(expectation, Unavailable):
            refusal = expectation.detail
        is_known = is_usual and refusal is None
        known = expectation if is_known and isinstance(expectation, Expected) else None
        tiers.append(
            {
                "tier": tier,
                "tolerance": TIER_TOLERANCES[tier],
                "expected_seconds": None if known is None else known.seconds,
                "expected_error": None if known is None else known.error,
                "unavailable": refusal,
            }
        )
    return tiers


def _refusal_at(document: Document, tier: Tier) -> str | None:
    """Return why a problem is none at a tier."""
    try:
        check_problem({**document, "accuracy": {"tier": tier}})
    except InvalidProblemError as refused:
        return refused.faults[0].message
    return None
