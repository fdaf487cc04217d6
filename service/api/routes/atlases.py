"""/v1/atlases: all planar motions over a range of λ, at once or by a job."""

import json
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Body, Inside, Resources, read_json
from service.api.descriptions import request_body
from service.api.formats.lists import choose_format, list_responses, media_types
from service.api.formats.negotiation import Accept
from service.api.keys.idempotency import IdempotencyKey, read_key
from service.api.middleware.heavy_answers import heavy, listed, made_in_a_slot, read_list, while_connected
from service.api.middleware.security import Holder, check_priority
from service.api.queries.queries import (
    Asked,
    PreferJob,
    asked_of,
    query_of,
    query_parameters,
    wait_seconds,
    wants_job,
    without_query,
)
from service.api.replies import AtlasId, refusals
from service.api.routes.jobs import JobsQuery, SubmitQuery, jobs_listed, shown
from service.api.submission import SubmissionTerms, queue_result
from service.api.tagged import validator_headers
from service.api.verdicts.examiner import examine, verdict_in
from service.api.verdicts.verdict_queue import Claimant
from service.jobs.records import JobKind
from service.sandbox import SandboxTimeoutError
from service.schemas.atlas.documents import AtlasOut, read_atlas
from service.schemas.query.terms import in_state
from service.schemas.reading.documents import Document
from service.schemas.replies.job import JobOut, JobPageOut
from service.schemas.replies.sweep import QueryEstimateOut
from service.storage.searching.sources import OF_ATLAS_ROWS
from service.verdicts.questions import examine_atlas, examine_setting

router = APIRouter(prefix="/v1/atlases", tags=["validations"])

EXAMPLES: Document = {
    "three terms": {
        "value": {
            "body": {"A": 2, "C": 1},
            "potential": {
                "type": "expression",
                "expression": "a*g1 + b/g3^2 + c*(g1^2 - g2^2)",
                "parameters": {"a": -1, "b": "1/20", "c": "3/2"},
            },
            "lambda": ["1/10", 3],
        }
    },
    "of a formula in g2": {
        "value": {
            "body": {"A": 3, "C": 2},
            "potential": {"type": "expression", "expression": "(3*g1^2 + 2*g3^2)*cos(5*g2)"},
            "lambda": ["1/2", 2],
            "samples": 41,
        }
    },
    "with multipliers": {
        "value": {
            "body": {"A": 2, "B": "3/2", "C": 1},
            "potential": {"type": "expression", "expression": "-g1"},
            "lambda": ["1/2", 2],
            "samples": 9,
            "outputs": ["period", "stability"],
        }
    },
}


_ATLAS = {
    "model": AtlasOut,
    "description": "The atlas. Arrow and CSV have a row for each window and λ; SVG is a picture.",
    "content": media_types(),
}


@router.post(
    "",
    response_model=AtlasOut,
    responses={
        200: _ATLAS,
        202: {"model": JobOut, "description": "It takes long: the job that draws it, as JSON"},
        **refusals(400, 406, 408, 409, 413, 415, 503),
    },
    openapi_extra={**request_body("AtlasIn", EXAMPLES), **query_parameters(SubmitQuery)},
)
async def draw_atlas(
    request: Request,
    content: Body,
    inside: Inside,
    holder: Holder,
    query: Annotated[SubmitQuery, Depends(query_of(SubmitQuery))],
    accept: Accept = None,
    prefer: PreferJob = None,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Tell for which λ of a range there are planar motions, and of which kind.

    Parts of the range are proved to keep the number, kinds and ends of their windows; each
    change between them is enclosed. On each part the windows are followed: their ends,
    energies and periods, with errors.

    200 is the atlas, which is not stored. 202 is a job, whose `atlas` is there when it has
    succeeded: for stability, with `Prefer: respond-async`, and where something is still undecided
    after four seconds of processor time, of which a job has more.
    """
    check_priority(holder, query.priority, "?priority")
    write = choose_format(accept)
    given = read_key(idempotency_key, request, content, holder)
    terms = SubmissionTerms(holder, query.priority, given, wait_seconds(prefer))

    async def work() -> Response:
        asked = await inside.reading.run(len(content), _checked, content)
        drawing = _drawn(asked, inside, terms, by_job=asked.wants_stability or wants_job(prefer))
        found = await while_connected(request, drawing)
        if isinstance(found, Response):
            return found
        return await made_in_a_slot(request, inside, partial(write, found))

    return await inside.idempotency.once(given, work)


@dataclass(frozen=True, slots=True)
class _Checked:
    """A valid document."""

    document: Document
    text: str
    wants_stability: bool


def _checked(content: bytes) -> _Checked:
    document = read_json(content)
    asked = read_atlas(document)
    return _Checked(document, json.dumps(document), asked.wants_stability)


async def _drawn(
    asked: _Checked, inside: Resources, terms: SubmissionTerms, *, by_job: bool
) -> AtlasOut | Response:
    """Return the atlas, or the answer with the job that draws it."""
    claimant = Claimant(terms.key_id)
    if by_job:
        # What has no atlas is refused now.
        await examine(inside.verdicts, examine_setting, asked.text, claimant)
        return await _queue(asked, inside, terms)
    try:
        answer = json.loads(await inside.verdicts.ask(examine_atlas, asked.text, claimant))
    except SandboxTimeoutError:
        return await _queue(asked, inside, terms)
    atlas = verdict_in(answer)
    if answer["is_late"]:
        return await _queue(asked, inside, terms)
    return AtlasOut.model_validate(atlas)


async def _queue(asked: _Checked, inside: Resources, terms: SubmissionTerms) -> Response:
    # 202 also if it has ended in time: 200 is the atlas itself.
    in_time = HTTPStatus.ACCEPTED
    return await queue_result(inside, terms, JobKind.ATLAS, asked.document, shown, in_time=in_time)


@router.get(
    "",
    responses=list_responses(JobPageOut | QueryEstimateOut),
    openapi_extra=query_parameters(JobsQuery),
)
async def list_atlases(
    request: Request, asked: Annotated[Asked[JobsQuery], Depends(asked_of(JobsQuery))], inside: Inside
) -> Response:
    """List the jobs that draw atlases, newest first or as asked; `GET /v1/jobs` lists the others."""
    listing = await read_list(inside, asked, OF_ATLAS_ROWS, conditions=in_state(asked.parameters.state))
    return await listed(request, inside, listing, jobs_listed(partial(inside.results.find, JobKind.ATLAS)))


@router.get(
    "/{atlas_id}",
    response_model=AtlasOut,
    responses={200: _ATLAS, **refusals(404, 406)},
    dependencies=[without_query],
)
@heavy
def get_atlas(request: Request, atlas_id: AtlasId, inside: Inside, accept: Accept = None) -> Response:
    """Show an atlas that a job has drawn; `DELETE` of the job deletes it."""
    write = choose_format(accept)
    headers = validator_headers(request, inside)
    answer = write(AtlasOut.model_validate(inside.results.get(JobKind.ATLAS, atlas_id)))
    answer.headers.update(headers)
    return answer
