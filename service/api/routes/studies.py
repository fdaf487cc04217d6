"""Studies: questions about integrals, potentials and numbers, answered at once or by a job."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Body, Inside, Resources, read_json
from service.api.descriptions import request_body
from service.api.keys.idempotency import IdempotencyKey, read_key
from service.api.middleware.heavy_answers import heavy, while_connected
from service.api.middleware.security import Holder, check_priority
from service.api.queries.queries import (
    PreferJob,
    query_of,
    query_parameters,
    wait_seconds,
    wants_job,
    without_query,
)
from service.api.replies import JobId, job_out, json_response, refusals
from service.api.routes.jobs import UrgencyQuery
from service.api.submission import SubmissionTerms, queue_result
from service.api.tagged import validator_headers
from service.api.verdicts.examiner import verdict_in
from service.api.verdicts.verdict_queue import Claimant
from service.jobs.records import Job, JobKind, JobState
from service.sandbox import SandboxMemoryError, SandboxTimeoutError
from service.schemas.reading.documents import Document
from service.schemas.replies.job import JobOut
from service.schemas.replies.study import (
    ANSWERS,
    AnswerOut,
    IntegralOut,
    IntegralsOut,
    NumbersOut,
    PotentialsOut,
)
from service.schemas.study.reading import MODELS, What, read_question
from service.verdicts.questions import QUESTIONS, examine_study

router = APIRouter(prefix="/v1", tags=["studies"])

Examination = Callable[[str], str]
EXAMINATIONS: Mapping[What, Examination] = dict.fromkeys(QUESTIONS, examine_study)
"""Questions that children for verdicts answer; the others need the solvers, which only workers have."""

WAIT_SHARE = 0.5
"""Share of the time of a verdict for which a worker's answer is waited: many clients give up after 10 s."""

EXAMPLES: Mapping[What, Document] = {
    "integral": {
        "Kovalevskaya's": {
            "value": {
                "body": {"A": "2*C", "B": "2*C"},
                "potential": {"type": "expression", "expression": "k*g1", "parameters": {"k": None}},
                "function": "(p^2 - q^2 - k*g1/C)^2 + (2*p*q - k*g2/C)^2",
            }
        },
    },
    "integrals": {
        "of a heavy body": {
            "value": {
                "body": {"A": 2, "B": 2, "C": 1},
                "potential": {"type": "expression", "expression": "-g1"},
                "degree": {"omega": 4, "gamma": 2},
            }
        },
    },
    "potentials": {
        "of a body": {"value": {"body": {"A": 2, "C": 1}, "degree": 4}},
        "of every ratio": {"value": {"degree": 3}},
    },
    "numbers": {
        "a period": {
            "value": {
                "base": {
                    "body": {"A": 2, "C": 1},
                    "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
                    "motion": {"type": "planar"},
                },
                "unknowns": [{"pointer": "/motion/lambda", "interval": ["1/2", 2]}],
                "wanted": [{"of": "period", "equals": 6}],
            }
        },
        "period and energy": {
            "value": {
                "base": {
                    "body": {"A": 2, "C": 1},
                    "potential": {
                        "type": "expression",
                        "expression": "a*g1 + 1/(20*g3^2)",
                        "parameters": {"a": -1},
                    },
                    "motion": {"type": "planar"},
                },
                "unknowns": [
                    {"pointer": "/motion/lambda", "interval": ["3/5", "3/2"]},
                    {"pointer": "/potential/parameters/a", "interval": [-2, "-1/2"]},
                ],
                "wanted": [{"of": "period", "equals": "13/2"}, {"of": "energy", "equals": "2/5"}],
            }
        },
    },
}


def _endpoint(what: What) -> dict[str, object]:
    """Return what the description of an endpoint says beside its words."""
    answer = ANSWERS[what]
    return {
        "responses": {
            200: {"model": answer, "description": "The answer"},
            202: {"model": JobOut, "description": "It takes long: the job that finds it"},
            **refusals(400, 408, 409, 413, 415, 503),
        },
        "openapi_extra": {
            **request_body(MODELS[what].__name__, EXAMPLES[what]),
            **query_parameters(UrgencyQuery),
        },
    }


Urgency = Annotated[UrgencyQuery, Depends(query_of(UrgencyQuery))]


@dataclass(frozen=True, slots=True)
class _Asked:
    """A request for a study."""

    request: Request
    content: bytes
    inside: Resources
    terms: SubmissionTerms
    is_job: bool
    """The client prefers a job."""


async def asked(
    request: Request,
    content: Body,
    inside: Inside,
    holder: Holder,
    query: Urgency,
    prefer: PreferJob = None,
    idempotency_key: IdempotencyKey = None,
) -> _Asked:
    """Return what all studies read of a request."""
    check_priority(holder, query.priority, "?priority")
    given = read_key(idempotency_key, request, content, holder)
    terms = SubmissionTerms(holder, query.priority, given, wait_seconds(prefer))
    return _Asked(request, content, inside, terms, wants_job(prefer))


Asked = Annotated[_Asked, Depends(asked)]


@router.post("/searches", response_model=NumbersOut, **_endpoint("numbers"))  # type: ignore[arg-type]
async def search_numbers(given: Asked) -> Response:
    """Find the numbers of a problem with which its motion has the period, energy, … that is wanted.

    All solutions in the intervals: each is `proved`, enclosed with a radius, or `possible`; and of the rest
    it is proved that there is none, or it is `undecided`. A worker computes it; the answer is 200 where that
    takes half of the time of a verdict at most, else 202 with the job, whose `result` will be the answer.
    """
    return await _study(given, "numbers")


@router.post("/integrals", response_model=IntegralOut, **_endpoint("integral"))  # type: ignore[arg-type]
async def judge_integral(given: Asked) -> Response:
    """Tell whether a function is an integral: of all motions, where the areas integral is 0, or on relations.

    It is proved, or refuted by a state at which its rate is enclosed without 0; with `relation`, whether the
    function being 0 is an invariant relation. Moments that are left out, and parameters that are null, are
    letters. 202 is a job that goes on where a verdict's time was not enough.
    """
    return await _study(given, "integral")


@router.post(
    "/integrals/searches",
    response_model=IntegralsOut,
    **_endpoint("integrals"),  # type: ignore[arg-type]
)
async def search_integrals(given: Asked) -> Response:
    """Find all polynomial integrals up to a degree, and the values of letters at which there are more.

    What depends on the energy, the areas, the length of γ and those found before is left out. 202 is a job
    that goes on where a verdict's time was not enough.
    """
    return await _study(given, "integrals")


@router.post(
    "/potentials/searches",
    response_model=PotentialsOut,
    **_endpoint("potentials"),  # type: ignore[arg-type]
)
async def search_potentials(given: Asked) -> Response:
    """Find all polynomial potentials up to a degree that admit planar motions, of one body or of all.

    Without a body also every ratio A/C at which there are more than at others. 202 is a job that goes on
    where a verdict's time was not enough.
    """
    return await _study(given, "potentials")


async def _study(given: _Asked, what: What) -> Response:
    inside = given.inside

    async def work() -> Response:
        document = await inside.reading.run(len(given.content), _checked, given.content, what)
        return await while_connected(given.request, _answered(given, what, document))

    return await inside.idempotency.once(given.terms.given, work)


def _checked(content: bytes, what: What) -> Document:
    document = read_json(content)
    read_question(what, document)
    found: Document = document
    return found


async def _answered(given: _Asked, what: What, document: Document) -> Response:
    """Answer from a child for verdicts in time, else by a job."""
    examination = EXAMINATIONS.get(what)
    if examination is None and not given.is_job and given.terms.seconds is None:
        seconds = int(WAIT_SHARE * given.inside.settings.verdict_seconds)
        given = replace(given, terms=replace(given.terms, seconds=seconds))
    if examination is not None and not given.is_job:
        try:
            claimant = Claimant(given.terms.key_id)
            text = json.dumps({"what": what, **document})
            answer = json.loads(await given.inside.verdicts.ask(examination, text, claimant))
        except (SandboxTimeoutError, SandboxMemoryError):
            pass  # a job has more of both
        else:
            found = verdict_in(answer)
            if not answer.get("is_late"):
                return json_response(ANSWERS[what].model_validate(found))
    return await _queued(given, what, {"what": what, **document})


async def _queued(given: _Asked, what: What, document: Document) -> Response:
    def show(job: Job) -> tuple[JobOut | AnswerOut, str]:
        place = f"/v1/jobs/{job.id}"
        if job.state is JobState.FAILED and job.error is not None and job.error.get("pointer") is not None:
            verdict_in({"error": dict(job.error)})  # raises: the question is refused
        return (job_out(job) if job.result is None else ANSWERS[what].model_validate(job.result)), place

    return await queue_result(given.inside, given.terms, JobKind.STUDY, document, show)


@router.get(
    "/jobs/{job_id}/result",
    response_model=AnswerOut,
    responses=refusals(404),
    dependencies=[without_query],
)
@heavy
def get_result(request: Request, job_id: JobId, inside: Inside) -> Response:
    """Show the answer of a study whose job has succeeded; it never changes."""
    headers = validator_headers(request, inside)
    job = inside.jobs.get(job_id)
    answer = json_response(ANSWERS[str(job.problem["what"])].model_validate(job.result))
    answer.headers.update(headers)
    return answer
