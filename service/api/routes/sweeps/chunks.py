"""GET /v1/sweeps/{id}/jobs: the jobs that compute the points of a sweep."""

from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Inside
from service.api.queries.lists import AskingQuery, page_answer, read_listing
from service.api.queries.queries import Asked, asked_of, query_parameters
from service.api.replies.places import SweepId
from service.api.replies.responses import refusals
from service.jobs.records import Job
from service.schemas.replies.analysis import QueryEstimateOut
from service.schemas.replies.job import ChunkJobOut, ChunkJobPageOut
from service.storage.searching.sources import chunks_of

router = APIRouter(prefix="/v1/sweeps", tags=["sweeps"])


@router.get(
    "/{sweep_id}/jobs",
    response_model=ChunkJobPageOut | QueryEstimateOut,
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
    if listing.query.is_estimated:
        return listing.estimate()
    page = inside.jobs.find_of_sweep(record.id, listing.query)
    return page_answer(request, listing, ChunkJobPageOut, page, list(map(_chunk, page.jobs)))


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
