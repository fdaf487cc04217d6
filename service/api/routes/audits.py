"""/v1/solutions/{id}/audits, /citation and /provenance: how a solution is checked, cited, and was made.

An audit solves the problem of a solution again, and compares the two.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import BodyIfAny, Inside, Resources, read_json
from service.api.descriptions import request_body
from service.api.formats.lists import ListedRows, list_responses
from service.api.formats.negotiation import JSON, Accept, preferred
from service.api.formats.origins import CITATIONS, Cited, bibtex, cff, provenance_graph, title_of
from service.api.keys.idempotency import IdempotencyKey, read_key
from service.api.middleware.heavy_answers import listed, read_list, while_connected
from service.api.middleware.security import Holder, check_priority
from service.api.queries.lists import AskingQuery
from service.api.queries.queries import (
    FORMAT_HELP,
    Asked,
    Prefer,
    QueryModel,
    asked_of,
    query_of,
    query_parameters,
    wait_seconds,
    without_query,
)
from service.api.replies import AuditId, SolutionId, audit_out, json_response, refusals
from service.api.routes.jobs import SubmitQuery
from service.api.submission import Made, SubmissionTerms, accept, check, queue
from service.api.tagged import validator_headers
from service.api.verdicts.examiner import Submission
from service.jobs.records import Job
from service.schemas.problem.documents import MEMBERS, AuditIn, audited_problem
from service.schemas.reading.documents import Document, InvalidProblemError, Part
from service.schemas.reading.parts import read_parts
from service.schemas.replies.solution import AuditOut, AuditPageOut, ProvenanceGraphOut
from service.schemas.replies.sweep import QueryEstimateOut
from service.settings import Settings
from service.storage.keys import Receipt
from service.storage.searching.sources import audits_of
from service.storage.solutions.result_store import Audit
from service.storage.solutions.solution_store import origin_of, standing_of

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


WRITERS: Mapping[str, Callable[[Cited], str]] = {CITATIONS["bibtex"]: bibtex, CITATIONS["cff"]: cff}


class CitationQuery(QueryModel):
    """The format of a citation."""

    format: Literal["bibtex", "cff"] | None = Field(default=None, description=FORMAT_HELP)


@router.get(
    "/{solution_id}/citation",
    response_class=Response,
    responses={
        200: {
            "description": "BibTeX, or a citation file (CFF 1.2.0).",
            "content": {media_type: {"schema": {"type": "string"}} for media_type in WRITERS},
        },
        **refusals(404, 406),
    },
    openapi_extra=query_parameters(CitationQuery),
)
def get_citation(
    request: Request,
    solution_id: SolutionId,
    query: Annotated[CitationQuery, Depends(query_of(CitationQuery))],
    inside: Inside,
    accept: Accept = None,
) -> Response:
    """Return how to cite a solution in a paper: what it is, what computed it, whose method it is."""
    media_type = preferred(list(WRITERS), accept) if query.format is None else CITATIONS[query.format]
    standing = inside.reads.get(standing_of, solution_id)
    headers = validator_headers(request, inside, standing)
    solution = inside.solutions.get(solution_id)
    provenance = solution.summary["provenance"]
    cited = Cited(
        solution.id,
        standing.digest,
        title_of(solution.problem),
        solution.created_at.date(),
        provenance["version"],
        provenance["numerics"],
    )
    return Response(WRITERS[media_type](cited), media_type=media_type, headers=headers)


@router.get(
    "/{solution_id}/provenance",
    response_model=ProvenanceGraphOut,
    responses=refusals(404, 406),
    dependencies=[without_query],
)
def get_provenance(
    request: Request, solution_id: SolutionId, inside: Inside, accept: Accept = None
) -> Response:
    """Tell how a solution was made, as PROV-JSON of the W3C.

    Entities are the problem with its document, the kept result of its examination, and
    the solution; activities are the examination and each attempt; agents are the
    workers, polhode and the libraries with their versions.
    """
    preferred([JSON], accept)
    headers = validator_headers(request, inside)
    document = provenance_graph(origin_of(inside.database, solution_id))
    return json_response(document, headers=headers)
