"""/v1/jobs: submit, list, show and cancel jobs."""

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from http import HTTPStatus
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Body, Inside, Resources, read_json
from service.api.descriptions import request_body
from service.api.formats.lists import ListedRows, list_responses
from service.api.keys.idempotency import IdempotencyKey, read_key, receipt_of
from service.api.middleware.heavy_answers import listed, read_list, while_connected
from service.api.middleware.security import Holder, check_owner, check_priority
from service.api.queries.lists import PageQuery
from service.api.queries.queries import (
    Asked,
    Prefer,
    QueryModel,
    asked_of,
    query_of,
    query_parameters,
    wait_seconds,
    without_query,
)
from service.api.replies import ApiError, JobId, job_out, json_response, refusals
from service.api.submission import (
    ESTIMATE_WORK,
    Made,
    SubmissionTerms,
    accept,
    accept_many,
    check,
    check_each,
    estimate_jobs,
    nothing_accepted,
    queue,
    refused_item,
)
from service.api.verdicts.examiner import Submission
from service.jobs.queue import Lane
from service.jobs.records import Job, JobKind, JobPage, JobState
from service.schemas.query.terms import ListQuery, in_state
from service.schemas.reading.documents import Document
from service.schemas.replies.job import AttemptsOut, JobItemOut, JobListOut, JobOut, JobPageOut
from service.schemas.replies.sweep import CostEstimateOut, QueryEstimateOut
from service.settings import Settings
from service.storage.keys import Receipt
from service.storage.searching.sources import OF_JOB_ROWS, OF_STUDY_ROWS

router = APIRouter(prefix="/v1/jobs", tags=["jobs"])

EXAMPLES: Document = {
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
            "labels": {"project": "thesis"},
            "note": "figure 3",
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
    """The conditions on jobs, and the page of the list."""

    state: JobState | None = Field(default=None, description="Only jobs in this state.")


class KindQuery(JobsQuery):
    """The same, of one kind."""

    kind: Literal["solve", "study"] = Field(
        default="solve",
        description="`solve`: jobs that solve a problem; `study`: those that answer a question.",
    )


PRIORITY = (
    "Larger first; above 0 only for keys of the role operate. Of equal priority single problems come before "
    "lists, lists before sweeps, and keys take turns."
)


class UrgencyQuery(QueryModel):
    """The urgency of a job."""

    priority: int = Field(default=0, ge=-100, le=100, description=PRIORITY)


class SubmitQuery(UrgencyQuery):
    """The urgency of a submitted job, or the wish for an estimate."""

    estimate: bool = Field(default=False, description=ESTIMATE_WORK)


@router.post(
    "",
    operation_id="submit_job",  # it names the schema of the answer, too
    response_model=JobOut | JobListOut,
    status_code=HTTPStatus.ACCEPTED,
    responses={
        200: {
            "model": JobOut | CostEstimateOut,
            "description": "With `Prefer: wait=S`: the job has finished in time; with `estimate`: its cost",
        },
        **refusals(400, 408, 409, 413, 415, 503),
    },
    openapi_extra={**request_body("JobIn", EXAMPLES, several=True), **query_parameters(SubmitQuery)},
)
async def submit_job(
    request: Request,
    content: Body,
    inside: Inside,
    holder: Holder,
    query: Annotated[SubmitQuery, Depends(query_of(SubmitQuery))],
    prefer: Prefer = None,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Check a problem and queue it; if an equal problem was solved before, reuse its solution.

    A budget is turned into the tier that the accuracy table of the installation
    expects to fit it; the job's problem shows which.

    Of a list of up to 1000 problems, the accepted ones are queued in one transaction:
    `items` has for each problem, in order, its job or its refusal. The list is refused
    if none is accepted. `Prefer: wait` does not apply to a list.

    With `estimate=true` nothing is queued: the answer tells what it would cost, as if nothing of it had been
    solved before.
    """
    check_priority(holder, query.priority, "?priority")
    given = read_key(idempotency_key, request, content, holder)
    terms = SubmissionTerms(holder, query.priority, given, wait_seconds(prefer))
    if query.estimate:
        found = await inside.reading.run(len(content), _checked, content, inside.settings)
        problems = found if isinstance(found, list) else [found]
        estimating = estimate_jobs(inside, problems, holder, is_list=isinstance(found, list))
        return json_response(await while_connected(request, estimating))

    async def work() -> Response:
        found = await inside.reading.run(len(content), _checked, content, inside.settings)
        if isinstance(found, list):
            submitting = _submit_list(found, inside, terms)
        else:
            submitting = _submit_one(found, inside, terms)
        return await while_connected(request, submitting)

    return await inside.idempotency.once(given, work)


def _checked(content: bytes, settings: Settings) -> Submission | list[Submission | ApiError]:
    document = read_json(content)
    return check_each(document, settings) if isinstance(document, list) else check(document, settings)


async def _submit_one(problem: Submission, inside: Resources, terms: SubmissionTerms) -> Response:
    accepted = await accept(inside, problem, terms.holder)

    def store(receipt: Receipt[Made] | None) -> Job:
        return inside.jobs.submit(
            accepted.document,
            accepted.digest,
            priority=terms.priority,
            key_id=terms.key_id,
            receipt=receipt,
            examination=accepted.examination,
            found=accepted.entries,
            annotation=accepted.annotation,
        )

    return await queue(inside, terms, store, shown)


def shown(job: Job) -> tuple[JobOut, str]:
    """Return a job as it is shown, and its path."""
    return job_out(job), f"/v1/jobs/{job.id}"


async def _submit_list(
    problems: list[Submission | ApiError], inside: Resources, terms: SubmissionTerms
) -> Response:
    answers = await accept_many(inside, problems, terms.holder)
    return await run_in_threadpool(_queue_list, answers, inside, terms)


def _queue_list(
    answers: Sequence[Submission | ApiError], inside: Resources, terms: SubmissionTerms
) -> Response:
    accepted = [answer for answer in answers if isinstance(answer, Submission)]
    if not accepted:
        raise nothing_accepted(answers)
    jobs = inside.jobs.submit_many(
        [(problem.document, problem.digest) for problem in accepted],
        priority=terms.priority,
        key_id=terms.key_id,
        # A list of one problem waits in the lane of single problems.
        lane=Lane.SINGLE if len(accepted) == 1 else Lane.LIST,
        receipt=receipt_of(terms.given, lambda made: _list_submitted(answers, made)),
        examinations=[problem.examination for problem in accepted],
        found=[entry for problem in accepted for entry in problem.entries],
        annotations=[problem.annotation for problem in accepted],
    )
    inside.wake_up.notify()
    return _list_submitted(answers, jobs)


def _list_submitted(answers: Sequence[Submission | ApiError], made: Sequence[Job]) -> Response:
    jobs = iter(made)
    items = [
        refused_item(answer)
        if isinstance(answer, ApiError)
        else JobItemOut(status=HTTPStatus.ACCEPTED, job=job_out(next(jobs)), problem=None)
        for answer in answers
    ]
    return json_response(JobListOut(items=items), status=HTTPStatus.ACCEPTED)


@router.get(
    "",
    responses=list_responses(JobPageOut | QueryEstimateOut),
    openapi_extra=query_parameters(KindQuery),
)
async def list_jobs(
    request: Request, asked: Annotated[Asked[KindQuery], Depends(asked_of(KindQuery))], inside: Inside
) -> Response:
    """List jobs, newest first or as asked; `GET /v1/atlases` lists those that draw atlases."""
    source, find = OF_JOB_ROWS, inside.jobs.find
    if asked.parameters.kind == "study":
        source, find = OF_STUDY_ROWS, partial(inside.results.find, JobKind.STUDY)
    listing = await read_list(inside, asked, source, conditions=in_state(asked.parameters.state))
    return await listed(request, inside, listing, jobs_listed(find))


def jobs_listed(find: Callable[[ListQuery], JobPage]) -> ListedRows[JobPage]:
    """Return a list of jobs, whatever they do."""
    return ListedRows(JobPageOut, find, lambda page: list(map(job_out, page.jobs)))


@router.get("/{job_id}", response_model=JobOut, responses=refusals(404), dependencies=[without_query])
def get_job(job_id: JobId, inside: Inside) -> Response:
    """Show a job."""
    return json_response(job_out(inside.jobs.get(job_id)))


@router.get(
    "/{job_id}/attempts",
    response_model=AttemptsOut,
    responses=refusals(404),
    dependencies=[without_query],
)
def get_attempts(job_id: JobId, inside: Inside) -> Response:
    """List the attempts at a job, each with its worker, its times, and how and why it ended."""
    items = [asdict(attempt) for attempt in inside.jobs.attempts(job_id)]
    return json_response(AttemptsOut.model_validate({"items": items}))


@router.post(
    "/{job_id}/cancel", response_model=JobOut, responses=refusals(404, 409), dependencies=[without_query]
)
def cancel_job(job_id: JobId, inside: Inside, holder: Holder) -> Response:
    """Cancel a queued or running job at once; cancelling again changes nothing.

    Cancelling a job that was submitted with another key needs the role operate.
    """
    check_owner(holder, inside.jobs.get(job_id).key_id)
    job = inside.jobs.cancel(job_id)
    inside.wake_up.notify()
    # Release the clients that wait for it.
    inside.wake_up.announce(job.id)
    return json_response(job_out(job))
