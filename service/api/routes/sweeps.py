"""/v1/sweeps: submit, list, show and cancel sweeps, and list the jobs that compute their points."""

from collections.abc import Sequence
from functools import partial
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Body, Inside, Resources, read_json
from service.api.descriptions import request_body
from service.api.formats.lists import ListedRows, list_responses
from service.api.formats.negotiation import JSON, Accept, preferred
from service.api.formats.origins import graph_of_points
from service.api.keys.idempotency import IdempotencyKey, read_key, receipt_of
from service.api.middleware.heavy_answers import listed, read_list, while_connected
from service.api.middleware.security import Holder, check_owner, check_priority
from service.api.queries.lists import AskingQuery, PageQuery
from service.api.queries.queries import Asked, QueryModel, asked_of, query_of, query_parameters, without_query
from service.api.replies import SweepId, json_response, refusals, sweep_out, sweep_state_out
from service.api.submission import ESTIMATE_WORK, estimate_sweep
from service.jobs.keys import ApiKey
from service.jobs.queue import largest_chunk
from service.jobs.records import Job, JobState, SweepPage, SweepRecord
from service.schemas.query.terms import in_state
from service.schemas.reading.documents import Document, Fault, Part, split_annotation
from service.schemas.replies.job import ChunkJobOut, ChunkJobPageOut
from service.schemas.replies.solution import ProvenanceGraphOut
from service.schemas.replies.sweep import CostEstimateOut, QueryEstimateOut, SweepOut, SweepPageOut
from service.schemas.sweep.reading import InvalidSweepError, read_sweep
from service.schemas.sweep.sweep import Sweep
from service.settings import Settings
from service.storage.jobs.chunks import range_of
from service.storage.keys import GivenKey
from service.storage.searching.sources import OF_SWEEP_ROWS, chunks_of

router = APIRouter(prefix="/v1/sweeps", tags=["sweeps"])

EXAMPLES: Document = {
    "grid": {
        "value": {
            "base": {
                "body": {"A": 2, "B": "3/2", "C": 1},
                "potential": {
                    "type": "expression",
                    "expression": "a*g1 + b/g3^2",
                    "parameters": {"a": -1, "b": "1/20"},
                },
                "motion": {"type": "planar", "lambda": 1},
                "time": {"stop": 10, "samples": 101},
                "accuracy": {"tolerance": 1e-9},
            },
            "axes": [
                {"pointer": "/potential/parameters/a", "values": [-2, -1]},
                {"pointer": "/motion/lambda", "linspace": [0.6, 2, 1000]},
            ],
            "combine": "grid",
            "keep": ["period", "energy", "error"],
            "series": False,
            "labels": {"project": "thesis"},
        }
    }
}


class SweepsQuery(PageQuery):
    """The conditions on sweeps, and the page of the list."""

    state: JobState | None = Field(default=None, description="Only sweeps in this state.")


class SubmitSweepQuery(QueryModel):
    """The wish for an estimate."""

    estimate: bool = Field(default=False, description=ESTIMATE_WORK)


@router.post(
    "",
    response_model=SweepOut,
    status_code=HTTPStatus.ACCEPTED,
    responses={
        200: {"model": CostEstimateOut, "description": "With `estimate`: the estimate"},
        **refusals(400, 408, 409, 413, 415, 503),
    },
    openapi_extra={**request_body("SweepIn", EXAMPLES), **query_parameters(SubmitSweepQuery)},
)
async def submit_sweep(
    request: Request,
    content: Body,
    inside: Inside,
    holder: Holder,
    query: Annotated[SubmitSweepQuery, Depends(query_of(SubmitSweepQuery))],
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Check a sweep and queue its first points; the others follow as those are done.

    The base must be a problem with the first value of each axis. Whether a
    point has a motion is known when the point is computed. With `estimate=true`
    nothing is queued: the answer tells what the sweep would cost.
    """
    given = read_key(idempotency_key, request, content, holder)
    read = partial(inside.reading.run, len(content), _checked, content, inside.settings)
    if query.estimate:
        document, sweep = await read()
        await run_in_threadpool(partial(_admit, document, sweep, inside, holder, is_estimate=True))
        return json_response(await while_connected(request, estimate_sweep(inside, sweep, holder)))

    async def work() -> Response:
        document, sweep = await read()
        return await run_in_threadpool(_submit, document, sweep, inside, holder, given)

    return await inside.idempotency.once(given, work)


def _checked(content: bytes, settings: Settings) -> tuple[Part, Sweep]:
    document = read_json(content)
    sweep = read_sweep(document, max_points=settings.max_sweep_points)
    if sweep.samples > settings.max_samples:
        message = f"{sweep.samples} samples; 1 to {settings.max_samples} are accepted here"
        raise InvalidSweepError([Fault("/base/time", "out_of_range", message)])
    return document, sweep


def _admit(
    document: Part, sweep: Sweep, inside: Resources, holder: ApiKey | None, *, is_estimate: bool = False
) -> int:
    """Return the priority of a sweep that its key may submit; an estimate counts for no limit."""
    priority = int(document.get("priority", 0))
    check_priority(holder, priority, "/priority")
    inside.limits.reserve_points(holder, sweep.points, is_estimate=is_estimate)
    return priority


def _submit(
    document: Part,
    sweep: Sweep,
    inside: Resources,
    holder: ApiKey | None,
    given: GivenKey | None,
) -> Response:
    priority = _admit(document, sweep, inside, holder)
    # Labels can be changed later; the document cannot.
    stored, annotation = split_annotation(document)
    record = inside.sweeps.submit(
        stored,
        points=sweep.points,
        most=largest_chunk(sweep.samples, len(sweep.series_columns)),
        priority=priority,
        key_id=None if holder is None else holder.id,
        receipt=receipt_of(given, _submitted),
        annotation=annotation,
    )
    inside.wake_up.notify()
    return _submitted(record)


def _submitted(record: SweepRecord) -> Response:
    headers = {"Location": f"/v1/sweeps/{record.id}"}
    return json_response(sweep_out(record), status=HTTPStatus.ACCEPTED, headers=headers)


@router.get(
    "",
    responses=list_responses(SweepPageOut | QueryEstimateOut),
    openapi_extra=query_parameters(SweepsQuery),
)
async def list_sweeps(
    request: Request, asked: Annotated[Asked[SweepsQuery], Depends(asked_of(SweepsQuery))], inside: Inside
) -> Response:
    """List sweeps without their documents, newest first or as asked."""
    listing = await read_list(inside, asked, OF_SWEEP_ROWS, conditions=in_state(asked.parameters.state))
    return await listed(request, inside, listing, _listed(inside))


def _listed(inside: Resources) -> ListedRows[SweepPage]:
    return ListedRows(SweepPageOut, inside.sweeps.find, lambda page: list(map(sweep_state_out, page.sweeps)))


@router.get("/{sweep_id}", response_model=SweepOut, responses=refusals(404), dependencies=[without_query])
def get_sweep(sweep_id: SweepId, inside: Inside) -> Response:
    """Show a sweep and its progress."""
    return json_response(sweep_out(inside.sweeps.get(sweep_id)))


@router.get(
    "/{sweep_id}/provenance",
    response_model=ProvenanceGraphOut,
    responses=refusals(404, 406),
    dependencies=[without_query],
)
def get_sweep_provenance(sweep_id: SweepId, inside: Inside, accept: Accept = None) -> Response:
    """Tell what computed the points of a sweep, as PROV-JSON of the W3C.

    Entities are the sweep with its document, and its points; activities are
    the computations on hosts that are alike; agents are these hosts, polhode
    and the libraries with their versions. Its jobs tell which host had which points.
    """
    preferred([JSON], accept)
    return json_response(graph_of_points(inside.sweeps.get(sweep_id)))


@router.post(
    "/{sweep_id}/cancel", response_model=SweepOut, responses=refusals(404, 409), dependencies=[without_query]
)
def cancel_sweep(sweep_id: SweepId, inside: Inside, holder: Holder) -> Response:
    """Cancel a queued or running sweep at once; computed points stay. Cancelling again changes nothing.

    Cancelling a sweep that was submitted with another key needs the role operate.
    """
    check_owner(holder, inside.sweeps.get(sweep_id).key_id)
    record = inside.sweeps.cancel(sweep_id)
    inside.wake_up.notify()
    return json_response(sweep_out(record))


@router.get(
    "/{sweep_id}/jobs",
    responses=list_responses(ChunkJobPageOut | QueryEstimateOut, 404),
    openapi_extra=query_parameters(AskingQuery),
)
async def list_sweep_jobs(
    sweep_id: SweepId,
    request: Request,
    asked: Annotated[Asked[AskingQuery], Depends(asked_of(AskingQuery))],
    inside: Inside,
) -> Response:
    """List the jobs that compute the points of a sweep, newest first or as asked."""
    record = await run_in_threadpool(inside.sweeps.get, sweep_id)
    listing = await read_list(inside, asked, chunks_of(record.id))
    find = partial(inside.jobs.find_of_sweep, record.id)
    rows = ListedRows(ChunkJobPageOut, find, lambda page: _chunks(inside, record.id, page.jobs))
    return await listed(request, inside, listing, rows)


def _chunks(inside: Resources, sweep_id: str, jobs: Sequence[Job]) -> list[ChunkJobOut]:
    ended = [range_of(job.problem).first for job in jobs if job.state is JobState.SUCCEEDED]
    sources = inside.sweeps.sources(sweep_id, ended)
    return [_chunk(job, *sources.get(range_of(job.problem).first, (None, None))) for job in jobs]


def _chunk(job: Job, host: str | None, provenance: int | None) -> ChunkJobOut:
    return ChunkJobOut.model_validate(
        {
            "id": job.id,
            "first": job.problem["first"],
            "count": job.problem["count"],
            "state": job.state.value,
            "attempt": job.attempt,
            "progress": job.progress,
            "error": None if job.error is None else dict(job.error),
            "created_at": job.created_at,
            "started_at": job.started_at,
            "finished_at": job.finished_at,
            "host": host,
            "provenance": provenance,
        }
    )
