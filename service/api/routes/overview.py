"""What dashboards show: the state of the installation, attempts at a job, the jobs of a sweep."""

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Inside
from service.api.queries.lists import AskingQuery, link_to, read_listing
from service.api.queries.queries import Asked, asked_of, query_parameters, without_query
from service.api.replies.places import JobId, SweepId
from service.api.replies.responses import json_response, refusals
from service.jobs.job import Job
from service.jobs.states import AttemptOutcome
from service.schemas.replies.overview import AttemptsOut, ChunkJobOut, ChunkJobPageOut, StatusOut
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.jobs.worker_registry import SILENT_LEASES
from service.storage.searching.sources import chunks_of
from service.storage.upkeep.presence import GONE_SECONDS
from service.storage.upkeep.status import status_of

router = APIRouter(prefix="/v1")


@router.get(
    "/status", tags=["status"], response_model=StatusOut, responses=refusals(), dependencies=[without_query]
)
def get_status(inside: Inside) -> Response:
    """Tell what waits, what each worker does, and how many jobs ended lately."""
    return json_response(status_document(inside.database, inside.settings))


def status_document(database: Database, settings: Settings) -> StatusOut:
    """Return the answer that shows the status."""
    seen_seconds = max(GONE_SECONDS, SILENT_LEASES * settings.lease_seconds)
    status = status_of(database, seen_seconds=seen_seconds)
    document = {
        "at": status.at,
        "queue": [asdict(part) for part in status.queue],
        "workers": [asdict(worker) for worker in status.workers],
        "rates": [
            {"minutes": rate.minutes, **{word.value: rate.by_outcome.get(word, 0) for word in AttemptOutcome}}
            for rate in status.rates
        ],
    }
    return StatusOut.model_validate(document)


@router.get(
    "/jobs/{job_id}/attempts",
    tags=["jobs"],
    response_model=AttemptsOut,
    responses=refusals(404),
    dependencies=[without_query],
)
def get_attempts(job_id: JobId, inside: Inside) -> Response:
    """List the attempts at a job, each with its worker, its times, and how and why it ended."""
    items = [asdict(attempt) for attempt in inside.jobs.attempts(job_id)]
    return json_response(AttemptsOut.model_validate({"items": items}))


@router.get(
    "/sweeps/{sweep_id}/jobs",
    tags=["sweeps"],
    response_model=ChunkJobPageOut,
    responses=refusals(404),
    openapi_extra=query_parameters(AskingQuery),
)
def list_sweep_jobs(
    sweep_id: SweepId,
    request: Request,
    asked: Annotated[Asked[AskingQuery], Depends(asked_of(AskingQuery))],
    inside: Inside,
) -> Response:
    """List the jobs that compute the points of a sweep, newest first or as asked."""
    record = inside.sweeps.get(sweep_id)
    listing = read_listing(asked, chunks_of(record.id))
    page, query = inside.jobs.find_of_sweep(record.id, listing.query), listing.query
    items = listing.rows(page.values) if query.columns else [_chunk(job) for job in page.jobs]
    following = listing.next_page(request, page.next)
    answer = ChunkJobPageOut(
        items=items, total=page.total, limit=query.limit, offset=query.offset, next=following
    )
    return json_response(answer, headers=link_to(following))


def _chunk(job: Job) -> ChunkJobOut:
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
        }
    )
