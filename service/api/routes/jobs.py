"""/v1/jobs: submit, list, show and cancel jobs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from service.api.bodies import Body, read_json
from service.api.dependencies import Inside, Resources
from service.api.descriptions import request_body
from service.api.keys.idempotency import IdempotencyKey, read_key, receipt_of
from service.api.middleware.disconnects import while_connected
from service.api.middleware.security import Holder, check_owner, check_priority
from service.api.queries.lists import Listing, PageQuery, link_to, read_listing
from service.api.queries.prefer import wait_seconds
from service.api.queries.queries import (
    Asked,
    QueryModel,
    asked_of,
    query_of,
    query_parameters,
    without_query,
)
from service.api.replies.errors import ApiError
from service.api.replies.places import JobId
from service.api.replies.responses import json_response, refusals
from service.api.submission import Accepted, Checked, JudgedDocument, accept, accept_many, check, check_each
from service.jobs.idempotency import GivenKey
from service.jobs.job import Job
from service.jobs.keys import ApiKey
from service.jobs.lanes import Lane
from service.jobs.states import JobState
from service.schemas.query.list_query import in_state
from service.schemas.reading.faults import first_of
from service.schemas.replies.job import JobItemOut, JobListOut, JobOut, JobPageOut
from service.settings import Settings
from service.storage.searching.sources import OF_JOB_ROWS

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


class JobsQuery(PageQuery):
    """Which jobs."""

    state: JobState | None = Field(default=None, description="Only jobs in this state.")


PRIORITY = (
    "Larger first; above 0 only for keys of the role operate. Of equal priority single problems come before "
    "lists, lists before sweeps, and keys take turns."
)


class SubmitQuery(QueryModel):
    """How urgent."""

    priority: int = Field(default=0, ge=-100, le=100, description=PRIORITY)


@router.post(
    "",
    response_model=JobOut | JobListOut,
    status_code=HTTPStatus.ACCEPTED,
    responses={
        200: {"model": JobOut, "description": "With `Prefer: wait=S`: the job has finished in time"},
        **refusals(400, 408, 409, 413, 415, 503),
    },
    openapi_extra={**request_body("ProblemIn", EXAMPLES, several=True), **query_parameters(SubmitQuery)},
)
async def submit_job(
    request: Request,
    content: Body,
    inside: Inside,
    holder: Holder,
    query: Annotated[SubmitQuery, Depends(query_of(SubmitQuery))],
    prefer: Annotated[
        str | None, Header(description="`wait=S`: wait up to S ≤ 60 seconds for the job to finish.")
    ] = None,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Check a problem and queue it; if an equal problem was solved before, reuse its solution.

    A budget is turned into the tier that the accuracy table of the installation
    expects to fit it; the job's problem shows which.

    Of a list of up to 1000 problems, the accepted ones are queued in one transaction:
    `items` has for each problem, in order, its job or its refusal. The list is refused
    if none is accepted. `Prefer: wait` does not apply to a list.
    """
    check_priority(holder, query.priority, "?priority")
    given = read_key(idempotency_key, request, content, holder)
    terms, seconds = _Terms(holder, query.priority, given), wait_seconds(prefer)

    async def work() -> Response:
        found = await inside.reading.run(len(content), _checked, content, inside.settings)
        if isinstance(found, list):
            submitting = _submit_list(found, inside, terms)
        else:
            submitting = _submit_one(found, inside, terms, seconds)
        return await while_connected(request, submitting)

    return await inside.idempotency.once(given, work)


def _checked(content: bytes, settings: Settings) -> Checked | list[Checked | ApiError]:
    document = read_json(content)
    return check_each(document, settings) if isinstance(document, list) else check(document, settings)


@dataclass(frozen=True, slots=True)
class _Terms:
    """Who submits, how urgently, and under which Idempotency-Key."""

    holder: ApiKey | None
    priority: int
    given: GivenKey | None

    @property
    def key_id(self) -> str | None:
        return None if self.holder is None else self.holder.id


async def _submit_one(problem: Checked, inside: Resources, terms: _Terms, seconds: int | None) -> Response:
    examined = await accept(inside, problem, terms.holder)
    job = await run_in_threadpool(_queue, examined, inside, terms)
    # No waiting if the limit of waiting clients is reached.
    if seconds is None or not inside.waiting.acquire(blocking=False):
        return await run_in_threadpool(_submitted, job)
    try:
        await _finish(job, inside, seconds)
    finally:
        inside.waiting.release()
    answer = await run_in_threadpool(_waited, job.id, inside, seconds)
    await run_in_threadpool(inside.idempotency.keep, terms.given, answer)
    return answer


def _queue(examined: JudgedDocument, inside: Resources, terms: _Terms) -> Job:
    problem = examined.accepted()
    job = inside.jobs.submit(
        problem.document,
        problem.digest,
        priority=terms.priority,
        key_id=terms.key_id,
        receipt=receipt_of(terms.given, lambda jobs: _submitted(*jobs)),
        examination=problem.windows,
        found=problem.entries,
    )
    if not job.is_finished:
        inside.doorbell.ring()
    return job


async def _finish(job: Job, inside: Resources, seconds: int) -> None:
    """Wait for a job without blocking a thread."""

    async def is_finished() -> bool:
        return (await run_in_threadpool(inside.jobs.get, job.id)).is_finished

    await inside.doorbell.wait_for(job.id, is_finished=is_finished, timeout=seconds)


def _submitted(job: Job) -> Response:
    return json_response(_out(job), status=HTTPStatus.ACCEPTED, headers=_location(job.id))


def _waited(job_id: str, inside: Resources, seconds: int) -> Response:
    job = inside.jobs.get(job_id)
    headers = {**_location(job_id), "Preference-Applied": f"wait={seconds}"}
    return json_response(
        _out(job), status=HTTPStatus.OK if job.is_finished else HTTPStatus.ACCEPTED, headers=headers
    )


def _location(job_id: str) -> dict[str, str]:
    return {"Location": f"/v1/jobs/{job_id}"}


async def _submit_list(problems: list[Checked | ApiError], inside: Resources, terms: _Terms) -> Response:
    examined = await accept_many(inside, problems, terms.holder)
    return await run_in_threadpool(_queue_list, examined, inside, terms)


def _queue_list(examined: Sequence[JudgedDocument | ApiError], inside: Resources, terms: _Terms) -> Response:
    answers = [each if isinstance(each, ApiError) else each.accepted_or_refusal() for each in examined]
    accepted = [answer for answer in answers if isinstance(answer, Accepted)]
    if not accepted:
        raise _nothing_accepted(answers)
    jobs = inside.jobs.submit_many(
        [(problem.document, problem.digest) for problem in accepted],
        priority=terms.priority,
        key_id=terms.key_id,
        # A list of one problem waits in the lane of single problems.
        lane=Lane.SINGLE if len(accepted) == 1 else Lane.LIST,
        receipt=receipt_of(terms.given, lambda made: _list_submitted(answers, made)),
        examinations=[problem.windows for problem in accepted],
        found=[entry for problem in accepted for entry in problem.entries],
    )
    inside.doorbell.ring()
    return _list_submitted(answers, jobs)


def _list_submitted(answers: Sequence[Accepted | ApiError], made: Sequence[Job]) -> Response:
    jobs = iter(made)
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
        f"none of the {len(answers)} problems is accepted; items has the reasons",
        faults=first_of(faults),
        extras={"items": [_refused(refusal).model_dump() for refusal in refusals]},
    )


@router.get("", response_model=JobPageOut, responses=refusals(), openapi_extra=query_parameters(JobsQuery))
async def list_jobs(
    request: Request, asked: Annotated[Asked[JobsQuery], Depends(asked_of(JobsQuery))], inside: Inside
) -> Response:
    """List jobs, newest first or as asked."""
    # What is wrong is told without a thread, of which a slow database may leave none.
    listing = read_listing(asked, OF_JOB_ROWS, conditions=in_state(asked.parameters.state))
    return await run_in_threadpool(_page, request, listing, inside)


def _page(request: Request, listing: Listing, inside: Resources) -> Response:
    page, query = inside.jobs.find(listing.query), listing.query
    items = listing.rows(page.values) if query.columns else [_out(job) for job in page.jobs]
    following = listing.next_page(request, page.next)
    answer = JobPageOut(items=items, total=page.total, limit=query.limit, offset=query.offset, next=following)
    return json_response(answer, headers=link_to(following))


@router.get("/{job_id}", response_model=JobOut, responses=refusals(404), dependencies=[without_query])
def get_job(job_id: JobId, inside: Inside) -> Response:
    """Show a job."""
    return json_response(_out(inside.jobs.get(job_id)))


@router.post(
    "/{job_id}/cancel", response_model=JobOut, responses=refusals(404, 409), dependencies=[without_query]
)
def cancel_job(job_id: JobId, inside: Inside, holder: Holder) -> Response:
    """Cancel a queued or running job at once; cancelling again changes nothing.

    Cancelling a job that was submitted with another key needs the role operate.
    """
    check_owner(holder, inside.jobs.get(job_id).key_id)
    job = inside.jobs.cancel(job_id)
    inside.doorbell.ring()
    # Release the clients that wait for it.
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


def job_content(job: Job) -> bytes:
    """Return the bytes of the answer that shows a job."""
    return bytes(json_response(_out(job)).body)
