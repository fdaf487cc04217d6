"""GET /v1/sweeps/{id}/jobs: the jobs that compute the points of a sweep."""

from functools import partial
from typing import Annotated

from fastapi import APIRouter, Depends, Request, Response
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Inside, Resources
from service.api.middleware.heavy_answers import listed
from service.api.queries.lists import AskingQuery, Listing, page_answer, read_listing
from service.api.queries.queries import Asked, asked_of, query_parameters
from service.api.replies.places import SweepId
from service.api.replies.responses import refusals
from service.jobs.job import Job
from service.schemas.replies.analysis import QueryEstimateOut
from service.schemas.replies.overview import ChunkJobOut, ChunkJobPageOut
from service.storage.searching.sources import chunks_of

router = APIRouter(prefix="/v1/sweeps", tags=["sweeps"])


@router.get(
    "/{sweep_id}/jobs",
    response_model=ChunkJobPageOut | QueryEstimateOut,
    responses=refusals(404),
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
    listing = read_listing(asked, chunks_of(record.id))
    return await listed(request, inside, listing, partial(_page, request, record.id, listing, inside))


def _page(request: Request, sweep_id: str, listing: Listing, inside: Resources) -> Response:
    page = inside.jobs.find_of_sweep(sweep_id, listing.query)
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
