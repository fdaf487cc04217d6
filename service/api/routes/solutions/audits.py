"""/v1/solutions/{id}/audits: solves the problem of a solution again, and compares the two."""

import json
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.bodies import BodyIfAny, read_json
from service.api.dependencies import Inside, Resources
from service.api.descriptions import request_body
from service.api.formats.lists import ListedRows, list_responses
from service.api.keys.idempotency import IdempotencyKey, read_key
from service.api.middleware.heavy_answers import listed, read_list, while_connected
from service.api.middleware.security import Holder, check_priority
from service.api.queries.lists import AskingQuery
from service.api.queries.queries import (
    Asked,
    Prefer,
    asked_of,
    query_of,
    query_parameters,
    wait_seconds,
    without_query,
)
from service.api.queueing import Made, SubmissionTerms, queue
from service.api.replies.records import audit_out
from service.api.replies.responses import AuditId, SolutionId, json_response, refusals
from service.api.routes.jobs import SubmitQuery
from service.api.submission import accept, check
from service.api.verdicts.examiner import Submission
from service.jobs.records import Job
from service.schemas.problem.documents import MEMBERS, AuditIn, audited_problem
from service.schemas.reading.documents import Document, InvalidProblemError, Part
from service.schemas.reading.parts import read_parts
from service.schemas.replies.analysis import QueryEstimateOut
from service.schemas.replies.solution import AuditOut, AuditPageOut
from service.settings import Settings
from service.storage.keys.idempotency_store import Receipt
from service.storage.searching.sources import audits_of
from service.storage.solutions.audit_store import Audit
from service.storage.solutions.solution_store import standing_of

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])

EXAMPLES: Document = {
    "the same": {"value": {}},
    "another tier and method": {"value": {"accuracy": {"tier": "high"}, "method": "quadrature"}},
}


@router.post(
    "/{solution_id}/audits",
    response_model=AuditOut,
    status_code=HTTPStatus.ACCEPTED,
    responses={
        200: {"model": AuditOut, "description": "With `Prefer: wait=S`: the audit has finished in time"},
        **refusals(400, 404, 408, 409, 413, 415, 503),
    },
    openapi_extra={
        **request_body("AuditIn", EXAMPLES, required=False),
        **query_parameters(SubmitQuery),
    },
)
async def audit_solution(
    request: Request,
    solution_id: SolutionId,
    content: BodyIfAny,
    inside: Inside,
    holder: Holder,
    query: Annotated[SubmitQuery, Depends(query_of(SubmitQuery))],
    prefer: Prefer = None,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Solve the problem of a solution again, as a job, and store how the two solutions compare.

    Another accuracy or method may be named; without a body both are the same. The new
    solution is stored, too, though an equal problem has been solved.
    """
    check_priority(holder, query.priority, "?priority")
    given = read_key(idempotency_key, request, content, holder)
    terms = SubmissionTerms(holder, query.priority, given, wait_seconds(prefer))

    async def work() -> Response:
        audited = await run_in_threadpool(_read, inside, solution_id)
        size = max(len(content), audited.size)
        problem = await inside.reading.run(size, _checked, content, audited.problem, inside.settings)
        return await while_connected(request, _submit(audited, problem, inside, terms))

    return await inside.idempotency.once(given, work)


@dataclass(frozen=True, slots=True)
class _Audited:
    """A stored solution's problem."""

    id: str
    digest: str
    problem: Part
    size: int
    """Characters of the document."""


def _read(inside: Resources, solution_id: str) -> _Audited:
    problem = inside.solutions.get(solution_id).problem
    standing = standing_of(inside.database, solution_id)
    return _Audited(standing.id, standing.digest, problem, len(json.dumps(problem)))


def _checked(content: bytes, problem: Part, settings: Settings) -> Submission:
    document = read_json(content) if content else {}
    _, faults = read_parts(document, AuditIn, MEMBERS)
    if faults:
        raise InvalidProblemError(faults)
    return check(audited_problem(dict(problem), document), settings)


async def _submit(
    audited: _Audited, problem: Submission, inside: Resources, terms: SubmissionTerms
) -> Response:
    accepted = await accept(inside, problem, terms.holder)

    def store(receipt: Receipt[Made] | None) -> Job:
        digest = accepted.digest
        return inside.audits.submit(
            audited.id,
            # In the same words, if it is the same: then equal bits are expected.
            audited.problem if digest == audited.digest else accepted.document,
            digest,
            priority=terms.priority,
            key_id=terms.key_id,
            examination=accepted.examination,
            found=accepted.entries,
            receipt=receipt,
        )

    def show(job: Job) -> tuple[AuditOut, str]:
        audit = inside.audits.get(audited.id, job.id) if job.is_finished else Audit(job, audited.id, None)
        return audit_out(audit), f"/v1/solutions/{audited.id}/audits/{job.id}"

    return await queue(inside, terms, store, show)


@router.get(
    "/{solution_id}/audits",
    responses=list_responses(AuditPageOut | QueryEstimateOut, 404),
    openapi_extra=query_parameters(AskingQuery),
)
async def list_audits(
    solution_id: SolutionId,
    request: Request,
    asked: Annotated[Asked[AskingQuery], Depends(asked_of(AskingQuery))],
    inside: Inside,
) -> Response:
    """List the audits of a solution, newest first or as asked: `where` and `order` are about their jobs."""
    standing = await run_in_threadpool(standing_of, inside.database, solution_id)
    listing = await read_list(inside, asked, audits_of(standing.id))
    find = partial(inside.audits.find, standing.id)
    rows = ListedRows(AuditPageOut, find, lambda page: list(map(audit_out, page.audits)))
    return await listed(request, inside, listing, rows)


@router.get(
    "/{solution_id}/audits/{audit_id}",
    response_model=AuditOut,
    responses=refusals(404),
    dependencies=[without_query],
)
def get_audit(solution_id: SolutionId, audit_id: AuditId, inside: Inside) -> Response:
    """Show an audit."""
    return json_response(audit_out(inside.audits.get(solution_id, audit_id)))
