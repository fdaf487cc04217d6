"""Changes of what is stored: labels and notes of jobs, solutions and sweeps (PATCH), and their deletion."""

from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from typing import Annotated, TypeVar

from fastapi import APIRouter, Header, Request, Response

from service.api.dependencies import JSON, MERGE_PATCH, Inside, Patch, read_json
from service.api.descriptions import request_body
from service.api.middleware.security import Holder, check_owner
from service.api.queries.queries import without_query
from service.api.replies import (
    ApiError,
    JobId,
    SolutionId,
    SweepId,
    is_current,
    job_out,
    json_content,
    json_response,
    refusals,
    solution_out,
    sweep_out,
    tag_of_content,
)
from service.api.tagged import solution_tag
from service.jobs.keys import ApiKey
from service.jobs.records import Job, SweepRecord
from service.schemas.problem.sections import MarksPatchIn
from service.schemas.reading.documents import (
    MOST_LABELS,
    Annotation,
    Document,
    Fault,
    InvalidProblemError,
    Part,
    patched,
)
from service.schemas.reading.parts import read_parts
from service.schemas.replies.job import JobOut
from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.solution import SolutionOut
from service.schemas.replies.sweep import SweepOut
from service.storage.solutions.solution_store import Solution, standing_of
from service.storage.upkeep.retention import delete_job as remove_job
from service.storage.upkeep.retention import delete_solution as remove_solution
from service.storage.upkeep.retention import delete_sweep as remove_sweep
from service.storage.upkeep.retention import key_of_solution

router = APIRouter(prefix="/v1")

Annotatable = TypeVar("Annotatable", Job, Solution, SweepRecord)
Owned = TypeVar("Owned", Job, SweepRecord)

EXAMPLES: Document = {
    "change": {"value": {"labels": {"project": "thesis", "draft": None}, "note": "figure 3"}},
    "remove": {"value": {"labels": None, "note": None}},
}
_BODY = request_body("MarksPatchIn", EXAMPLES, media_types=(MERGE_PATCH, JSON))
_REFUSALS = refusals(400, 404, 408, 412, 413, 415)

IfMatch = Annotated[
    str | None,
    Header(description="The `ETag` of GET: 412 if it is another one by now, so that no change is lost."),
]


@router.patch(
    "/jobs/{job_id}",
    response_model=JobOut,
    responses=_REFUSALS,
    openapi_extra=_BODY,
    dependencies=[without_query],
    tags=["jobs"],
)
def change_job(
    job_id: JobId, content: Patch, inside: Inside, holder: Holder, if_match: IfMatch = None
) -> Response:
    """Change labels and note of a job by a merge patch (RFC 7396). Its solution keeps its own.

    Of jobs that were submitted with another key this needs the role operate.
    """
    return _change(content, holder, if_match, partial(inside.jobs.annotate, job_id), job_out)


@router.patch(
    "/solutions/{solution_id}",
    response_model=SolutionOut,
    responses=_REFUSALS,
    openapi_extra=_BODY,
    dependencies=[without_query],
    tags=["solutions"],
)
def change_solution(
    request: Request,
    solution_id: SolutionId,
    content: Patch,
    inside: Inside,
    holder: Holder,
    if_match: IfMatch = None,
) -> Response:
    """Change labels and note of a solution by a merge patch (RFC 7396). The job it comes from keeps its own.

    Of solutions that were computed for another key this needs the role operate.
    """
    patch = _read(content)
    check_owner(holder, key_of_solution(inside.database, solution_id))
    standing = standing_of(inside.database, solution_id)

    def change(solution: Solution) -> Annotation:
        _require_current(if_match, solution_tag(request, standing, solution.annotation))
        return _changed(solution, patch)

    solution = inside.solutions.annotate(solution_id, change)
    answer = json_response(solution_out(solution))
    answer.headers["ETag"] = solution_tag(request, standing, solution.annotation)
    return answer


@router.patch(
    "/sweeps/{sweep_id}",
    response_model=SweepOut,
    responses=_REFUSALS,
    openapi_extra=_BODY,
    dependencies=[without_query],
    tags=["sweeps"],
)
def change_sweep(
    sweep_id: SweepId, content: Patch, inside: Inside, holder: Holder, if_match: IfMatch = None
) -> Response:
    """Change labels and note of a sweep by a merge patch (RFC 7396).

    Of sweeps that were submitted with another key this needs the role operate.
    """
    return _change(content, holder, if_match, partial(inside.sweeps.annotate, sweep_id), sweep_out)


def _change(
    content: bytes,
    holder: ApiKey | None,
    if_match: str | None,
    annotate: Callable[[Callable[[Owned], Annotation]], Owned],
    show: Callable[[Owned], ResponseModel],
) -> Response:
    """Change what is tagged by the bytes of its answer, by ``annotate``; answer as GET does, by ``show``."""
    patch = _read(content)

    def change(given: Owned) -> Annotation:
        check_owner(holder, given.key_id)
        _require_current(if_match, tag_of_content(json_content(show(given))))
        return _changed(given, patch)

    answer = json_content(show(annotate(change)))
    return Response(answer, media_type=JSON, headers={"ETag": tag_of_content(answer)})


def _read(content: bytes) -> Part:
    """Return a valid change."""
    document: Part = read_json(content)
    _, faults = read_parts(document, MarksPatchIn, {})
    if faults:
        raise _refused(faults)
    return document


def _changed(given: Annotatable, patch: Part) -> Annotation:
    """Return the labels and the note after the change."""
    annotation = patched(given.annotation, patch)
    if (count := len(annotation.labels)) > MOST_LABELS:
        message = f"{count} labels with those that are there; at most {MOST_LABELS} are accepted"
        raise _refused([Fault("/labels", "invalid_length", message)])
    return annotation


def _refused(faults: list[Fault]) -> ApiError:
    detail = str(InvalidProblemError(faults))
    return ApiError(HTTPStatus.UNPROCESSABLE_ENTITY, "invalid_patch", detail, faults=faults)


def _require_current(header: str | None, tag: str) -> None:
    if not is_current(header, tag):
        detail = "it has changed since If-Match was right; get it again, and send the change with its ETag"
        raise ApiError(HTTPStatus.PRECONDITION_FAILED, "changed_meanwhile", detail)


_GONE = HTTPStatus.NO_CONTENT
_NOT_DELETED = refusals(404, 409)


@router.delete(
    "/jobs/{job_id}",
    status_code=_GONE,
    response_class=Response,
    responses=_NOT_DELETED,
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
    responses=_NOT_DELETED,
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
    responses=_NOT_DELETED,
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
