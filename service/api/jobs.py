"""/v1/jobs: submit, follow, cancel."""

from collections.abc import Sequence
from dataclasses import replace
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Response
from pydantic import Field

from service.api.documentation import request_body
from service.api.errors import ApiError
from service.api.places import JobId
from service.api.prefer import wait_seconds
from service.api.queries import QueryModel, query_of, query_parameters, without_query
from service.api.requests import Body, read_json
from service.api.resources import Inside, Resources
from service.api.responses import json_response, refusals
from service.api.security import Holder, check_owner
from service.api.submission import Accepted, accept, accept_many
from service.jobs.job import Job
from service.jobs.keys import ApiKey
from service.jobs.states import JobState
from service.schemas.job import JobItemOut, JobListOut, JobOut, JobPageOut

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

EXAMPLES: dict[str, object] = {
    "quadrature": {
        "value": {
            "body": {"A": 2, "B": "3/2", "C": 1},
            "potential": {
                "type": "expression",
                "expression": "a*g1 + b/g3^2",
                "parameters": {"a": -1, "b": "1/20"},
            },
            "motion": {"type": "planar", "lambda": 1},
            "time": {"stop": 10, "samples": 101},
            "accuracy": {"tolerance": 1e-10},
            "method": "auto",
            "outputs": ["gamma", "omega"],
        }
    },
    "state": {
        "value": {
            "body": {"A": 2, "B": "3/2", "C": 1},
            "potential": {"type": "gravity", "a": 1, "c": "-1/2"},
            "motion": {"type": "state", "omega": ["2/5", "1/10", "9/10"], "gamma": ["3/5", 0, "4/5"]},
            "time": {"stop": 20, "samples": 201},
        }
    },
}


class JobsQuery(QueryModel):
    """Which jobs."""

    state: JobState | None = Field(default=None, description="Only jobs in this state.")
    limit: int = Field(default=50, ge=1, le=200, description="Items on a page at most.")
    offset: int = Field(default=0, ge=0, le=10**9, description="Items to leave out first.")


class SubmitQuery(QueryModel):
    """How urgent."""

    priority: int = Field(default=0, ge=-100, le=100, description="Larger first; equal ones by age.")


@router.post(
    "",
    response_model=JobOut | JobListOut,
    status_code=HTTPStatus.ACCEPTED,
    responses={
        200: {"model": JobOut, "description": "With `Prefer: wait=S`: the job has finished in time"},
        **refusals(400, 413, 415, 503),
    },
    openapi_extra={**request_body("ProblemIn", EXAMPLES, several=True), **query_parameters(SubmitQuery)},
)
def submit_job(
    content: Body,
    inside: Inside,
    holder: Holder,
    query: Annotated[SubmitQuery, Depends(query_of(SubmitQuery))],
    prefer: Annotated[
        str | None, Header(description="`wait=S`: wait up to S ≤ 60 seconds for the job to finish.")
    ] = None,
) -> Response:
    """Check a problem and queue it; an equal problem that was solved before brings its solution.

    A budget is turned into the tier that the accuracy table of the installation
    expects to fit it; the job's problem shows which.

    A list of up to 1000 problems is queued by one transaction, as far as they
    are accepted: `items` answers for each in order, with its job or with what
    refuses it. It is refused if none is accepted. Nobody waits for a list.
    """
    document = read_json(content)
    key_id = None if holder is None else holder.id
    if isinstance(document, list):
        return _submit_list(document, inside, holder, query.priority)
    problem = accept(inside, document, holder)
    job = inside.jobs.submit(problem.document, problem.digest, priority=query.priority, key_id=key_id)
    if not job.is_finished:
        inside.doorbell.ring()
    return _submitted(job, inside, wait_seconds(prefer))


def _submit_list(
    documents: list[object], inside: Resources, holder: ApiKey | None, priority: int
) -> Response:
    answers = accept_many(inside, documents, holder)
    accepted = [answer for answer in answers if isinstance(answer, Accepted)]
    if not accepted:
        raise _nothing_accepted(answers)
    jobs = iter(
        inside.jobs.submit_many(
            [(problem.document, problem.digest) for problem in accepted],
            priority=priority,
            key_id=None if holder is None else holder.id,
        )
    )
    inside.doorbell.ring()
    items = [
        _refused(answer)
        if isinstance(answer, ApiError)
        else JobItemOut(status=HTTPStatus.ACCEPTED, job=_out(next(jobs)), problem=None)
        for answer in answers
    ]
    return json_response(JobListOut(items=items), status=HTTPStatus.ACCEPTED)


def _refused(refusal: ApiError) -> JobItemOut:
    return JobItemOut(status=refusal.status, job=None, problem=refusal.document())


def _nothing_accepted(answers: Sequence[Accepted | ApiError]) -> ApiError:
    refusals = [answer for answer in answers if isinstance(answer, ApiError)]
    faults = [
        replace(fault, pointer=f"/{index}{fault.pointer}")
        for index, refusal in enumerate(refusals)
        for fault in refusal.faults
    ]
    return ApiError(
        HTTPStatus.UNPROCESSABLE_ENTITY,
        "no_problem_accepted",
        f"of {len(answers)} problems none is accepted; items says why",
        faults=faults,
        extras={"items": [_refused(refusal).model_dump() for refusal in refusals]},
    )


def _submitted(job: Job, inside: Resources, seconds: int | None) -> Response:
    """Return the new job; wait for it if that is wished and there is a place for one more."""
    status, headers = HTTPStatus.ACCEPTED, {"Location": f"/v1/jobs/{job.id}"}
    if seconds is not None and inside.waiting.acquire(blocking=False):
        try:
            inside.doorbell.wait_for(
                job.id, is_finished=lambda: inside.jobs.get(job.id).is_finished, timeout=seconds
            )
        finally:
            inside.waiting.release()
        headers["Preference-Applied"] = f"wait={seconds}"
        job = inside.jobs.get(job.id)
        if job.is_finished:
            status = HTTPStatus.OK
    return json_response(_out(job), status=status, headers=headers)


@router.get("", response_model=JobPageOut, responses=refusals(), openapi_extra=query_parameters(JobsQuery))
def list_jobs(query: Annotated[JobsQuery, Depends(query_of(JobsQuery))], inside: Inside) -> Response:
    """List jobs, newest first."""
    page = inside.jobs.list_jobs(state=query.state, limit=query.limit, offset=query.offset)
    items = [_out(job) for job in page.jobs]
    return json_response(JobPageOut(items=items, total=page.total, limit=query.limit, offset=query.offset))


@router.get("/{job_id}", response_model=JobOut, responses=refusals(404), dependencies=[without_query])
def get_job(job_id: JobId, inside: Inside) -> Response:
    """Show a job."""
    return json_response(_out(inside.jobs.get(job_id)))


@router.post(
    "/{job_id}/cancel", response_model=JobOut, responses=refusals(404, 409), dependencies=[without_query]
)
def cancel_job(job_id: JobId, inside: Inside, holder: Holder) -> Response:
    """Cancel a queued or running job at once; cancelling again changes nothing.

    Of a job that was submitted with another key it takes the role operate.
    """
    check_owner(holder, inside.jobs.get(job_id).key_id)
    job = inside.jobs.cancel(job_id)
    inside.doorbell.ring()
    # Whoever waits for it need not wait on.
    inside.doorbell.announce(job.id)
    return json_response(_out(job))


def _out(job: Job) -> JobOut:
    return JobOut(
        id=job.id,
        state=job.state.value,
        priority=job.priority,
        attempt=job.attempt,
        progress=job.progress,
        error=None if job.error is None else dict(job.error),
        reused=job.reused,
        solution=job.solution_id,
        problem=dict(job.problem),
        created_at=job.created_at,
        started_at=job.started_at,
        finished_at=job.finished_at,
    )
