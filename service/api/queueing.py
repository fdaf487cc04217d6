"""Queues one accepted problem, and answers at once, or when its job has ended."""

from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus

from fastapi import Response
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Resources
from service.api.keys.idempotency import receipt_of
from service.api.replies.responses import json_response
from service.jobs.keys import ApiKey
from service.jobs.records import Job, JobKind
from service.schemas.problem.problem import problem_digest
from service.schemas.reading.documents import Document
from service.schemas.replies.response_model import ResponseModel
from service.storage.keys.idempotency_store import GivenKey, Receipt

Made = tuple[Job, ...]
Store = Callable[[Receipt[Made] | None], Job]
"""Stores the job, with the answer of a receipt."""
Show = Callable[[Job], tuple[ResponseModel, str]]
"""Returns what the answer shows of a job, and its path."""


@dataclass(frozen=True, slots=True)
class SubmissionTerms:
    """The key that submits, the priority, the Idempotency-Key, and how long the client waits."""

    holder: ApiKey | None
    priority: int
    given: GivenKey | None
    seconds: int | None

    @property
    def key_id(self) -> str | None:
        """Id of the key that is charged."""
        return None if self.holder is None else self.holder.id


async def queue(
    inside: Resources,
    terms: SubmissionTerms,
    store: Store,
    show: Show,
    *,
    in_time: HTTPStatus = HTTPStatus.OK,
) -> Response:
    """Store a job, and answer with what ``show`` tells of it: 202, or ``in_time`` if it has ended in time."""

    def submitted(job: Job) -> Response:
        model, place = show(job)
        return json_response(model, status=HTTPStatus.ACCEPTED, headers={"Location": place})

    def put() -> tuple[Job, Response]:
        job = store(receipt_of(terms.given, lambda jobs: submitted(*jobs)))
        if not job.is_finished:
            inside.wake_up.notify()
        return job, submitted(job)

    def waited(ended: Job) -> Response:
        model, place = show(ended)
        headers = {"Location": place, "Preference-Applied": f"wait={terms.seconds}"}
        status = in_time if ended.is_finished else HTTPStatus.ACCEPTED
        answer = json_response(model, status=status, headers=headers)
        inside.idempotency.keep(terms.given, answer)
        return answer

    job, answer = await run_in_threadpool(put)
    # No waiting if the limit of waiting clients is reached.
    if terms.seconds is None or not inside.waiting.acquire(blocking=False):
        return answer
    try:
        ended = await _finish(job, inside, terms.seconds)
    finally:
        inside.waiting.release()
    # A thread is needed to write into the database only.
    return waited(ended) if terms.given is None else await run_in_threadpool(waited, ended)


async def queue_result(
    inside: Resources,
    terms: SubmissionTerms,
    kind: JobKind,
    document: Document,
    show: Show,
    *,
    in_time: HTTPStatus = HTTPStatus.OK,
) -> Response:
    """Store a job that makes a document, of a kind whose result is stored, and answer as :func:`queue`."""

    def store(receipt: Receipt[Made] | None) -> Job:
        return inside.results.submit(
            kind,
            document,
            problem_digest({kind.value: document}),
            priority=terms.priority,
            key_id=terms.key_id,
            receipt=receipt,
        )

    await run_in_threadpool(inside.limits.reserve_jobs, terms.holder)
    return await queue(inside, terms, store, show, in_time=in_time)


async def _finish(job: Job, inside: Resources, seconds: int) -> Job:
    """Return a job as it is when it has ended, or when the time is over; wait without blocking a thread."""
    ended = job

    async def is_finished() -> bool:
        nonlocal ended
        ended = await run_in_threadpool(inside.jobs.get, job.id)
        return ended.is_finished

    if not job.is_finished:
        await inside.wake_up.wait_for(job.id, is_finished=is_finished, timeout=seconds, is_new=True)
    return ended
