"""DELETE of a finished job, a solution and a finished sweep."""

from collections.abc import Callable
from functools import partial
from http import HTTPStatus

from fastapi import APIRouter, Response

from service.api.dependencies import Inside
from service.api.middleware.security import Holder, check_owner
from service.api.queries.queries import without_query
from service.api.replies.places import JobId, SolutionId, SweepId
from service.api.replies.responses import refusals
from service.jobs.keys import ApiKey
from service.storage.sweeps.deleting import delete_job as remove_job
from service.storage.sweeps.deleting import delete_solution as remove_solution
from service.storage.sweeps.deleting import delete_sweep as remove_sweep
from service.storage.sweeps.deleting import key_of_solution

router = APIRouter(prefix="/v1")

_GONE = HTTPStatus.NO_CONTENT
_REFUSALS = refusals(404, 409)


@router.delete(
    "/jobs/{job_id}",
    status_code=_GONE,
    response_class=Response,
    responses=_REFUSALS,
    dependencies=[without_query],
    tags=["jobs"],
)
def delete_job(job_id: JobId, inside: Inside, holder: Holder) -> Response:
    """Delete a finished job and the atlas that it has drawn, if any.

    One that a solution comes from is deleted with its solution only.

    Deleting what was submitted with another key needs the role operate.
    """
    return _removed(holder, inside.jobs.get(job_id).key_id, partial(remove_job, inside.database, job_id))


@router.delete(
    "/solutions/{solution_id}",
    status_code=_GONE,
    response_class=Response,
    responses=_REFUSALS,
    dependencies=[without_query],
    tags=["solutions"],
)
def delete_solution(solution_id: SolutionId, inside: Inside, holder: Holder) -> Response:
    """Delete a solution with its arrays and the job that computed it, unless other jobs have reused it.

    Deleting what was computed for another key needs the role operate.
    """
    return _removed(
        holder,
        key_of_solution(inside.database, solution_id),
        partial(remove_solution, inside.database, solution_id),
    )


@router.delete(
    "/sweeps/{sweep_id}",
    status_code=_GONE,
    response_class=Response,
    responses=_REFUSALS,
    dependencies=[without_query],
    tags=["sweeps"],
)
def delete_sweep(sweep_id: SweepId, inside: Inside, holder: Holder) -> Response:
    """Delete a finished sweep with its points; a live one is cancelled first.

    Deleting what was submitted with another key needs the role operate.
    """
    return _removed(
        holder, inside.sweeps.get(sweep_id).key_id, partial(remove_sweep, inside.database, sweep_id)
    )


def _removed(holder: ApiKey | None, key_id: str | None, remove: Callable[[], None]) -> Response:
    check_owner(holder, key_id)
    remove()
    return Response(status_code=_GONE)
