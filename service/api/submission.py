"""Reads, checks and examines problems before they are queued, one or many at once; estimates costs.

One accepted problem is queued here, and answered at once, or when its job has ended.
"""

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from http import HTTPStatus
from typing import Any

from fastapi import Response
from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Resources
from service.api.keys.idempotency import receipt_of
from service.api.keys.limits import check_problem_samples
from service.api.middleware.error_handlers import refusal_of
from service.api.replies import ApiError, json_response
from service.api.verdicts.examiner import Submission
from service.api.verdicts.verdict_queue import Claimant
from service.dynamics.accuracy import AccuracyTable
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion
from service.jobs.kernels import most_missing
from service.jobs.keys import ApiKey
from service.jobs.records import Job, JobKind
from service.sandbox import SandboxError, SandboxTimeoutError
from service.schemas.problem.documents import CheckedProblem, JobIn
from service.schemas.problem.problem import check_problem, problem_digest, window_of
from service.schemas.reading.documents import Document, Fault, InvalidProblemError, first_of, split_annotation
from service.schemas.replies.job import JobItemOut
from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.sweep import CostEstimateOut, RefusedItemOut, SlowPart
from service.schemas.sweep.estimates import (
    UNEXAMINED,
    CostEstimate,
    ExaminedPoint,
    estimate_of_jobs,
    estimate_of_sweep,
    sampled_points,
)
from service.schemas.sweep.sweep import Sweep
from service.settings import Settings
from service.storage.examinations import keys_of
from service.storage.keys import GivenKey, Receipt
from service.storage.solutions.accuracy_store import AccuracyStore
from service.storage.solutions.shipped_accuracy import shipped_table
from service.storage.upkeep.presence import WorkerRegistry

MOST_PROBLEMS = 1000
"""Problems in one request, whose body has a size limit too."""
LIST_VERDICTS = 3
"""A list may take so many times the time limit of one verdict."""
_TOGETHER = 50
"""Problems of one potential that are examined by one call."""
_FAULTS_LISTED = 1000
"""Faults listed for a whole list; later problems get one fault each."""

ESTIMATE_WORK = (
    "Nothing is stored: the answer tells what it would cost, `{points, tier, seconds, bytes, slow, ready_in,"
    " refused}`."
)

_BUSY = HTTPStatus.SERVICE_UNAVAILABLE


def needs_verdict(checked: CheckedProblem) -> bool:
    """Whether a problem is queued only after its potential and its motion have been examined."""
    return isinstance(checked.problem.motion, PlanarMotion)


def check(document: Any, settings: Settings) -> Submission:  # noqa: ANN401 (what a client sent)
    """Validate the document of one problem, which takes a while for a large one. Raises its refusal."""
    checked = check_problem(document, JobIn)
    check_problem_samples(checked.problem, settings)
    stated, annotation = split_annotation(document)
    if not needs_verdict(checked):
        return Submission(stated, checked, annotation)
    return Submission(stated, checked, annotation, keys_of(checked.canonical), json.dumps(stated))


def check_each(documents: Sequence[object], settings: Settings) -> list[Submission | ApiError]:
    """Validate each document of a list; a refusal takes the place of its problem.

    Raises
    ------
    InvalidProblemError
        The list is empty or too long.
    """
    if not 1 <= len(documents) <= MOST_PROBLEMS:
        message = f"{len(documents)} problems; 1 to {MOST_PROBLEMS} are accepted at once"
        raise InvalidProblemError([Fault("", "out_of_range", message)])
    answers: list[Submission | ApiError] = []
    listed = 0
    for document in documents:
        try:
            answers.append(check(document, settings))
        except InvalidProblemError as error:
            # After many faults in a list, only the first fault of each later problem is listed.
            fault = error if listed < _FAULTS_LISTED else InvalidProblemError(first_of(error.faults, 1))
            listed += len(fault.faults)
            answers.append(refusal_of(fault))
        except DynamicsError as error:
            answers.append(refusal_of(error))
    return answers


async def accept(
    inside: Resources, problem: Submission, holder: ApiKey | None, *, is_estimate: bool = False
) -> Submission:
    """Return a problem that has been examined, with its budget turned into a tier. Raises its refusal."""

    def prepare() -> tuple[AccuracyTable | None, Mapping[str, str]]:
        table = _reserve(inside, holder, [problem], is_estimate=is_estimate)
        return table, {} if problem.keys is None else inside.examiner.cached([problem])

    table, cached = await run_in_threadpool(prepare)
    if problem.keys is not None:
        claimant = Claimant(None if holder is None else holder.id)
        found = inside.examiner.known(problem)
        problem = found or (await inside.examiner.examine([problem], claimant, cached=cached))[0]
    window = window_of(problem.verdict)
    return problem if table is None else await run_in_threadpool(problem.settled, window, table)


async def accept_many(
    inside: Resources,
    problems: Sequence[Submission | ApiError],
    holder: ApiKey | None,
    *,
    is_estimate: bool = False,
) -> list[Submission | ApiError]:
    """Do the same with each problem of a list; a refusal takes the place of its problem.

    Raises
    ------
    ApiError
        503: the children for verdicts have no time, and no problem of the list was examined.
    """
    given = {index: each for index, each in enumerate(problems) if isinstance(each, Submission)}
    reserve = partial(_reserve, inside, holder, list(given.values()), is_estimate=is_estimate)
    table = await run_in_threadpool(reserve) if given else None
    claimant = Claimant(None if holder is None else holder.id, is_list=True)
    examined = await _examine(inside, given, claimant)
    found = [examined.get(index, problem) for index, problem in enumerate(problems)]
    refusals = [each for each in found if isinstance(each, ApiError)]
    if len(refusals) == len(found) and all(refusal.status == _BUSY for refusal in refusals):
        raise refusals[0]
    return await run_in_threadpool(lambda: [_settled(each, table) for each in found])


def _reserve(
    inside: Resources, holder: ApiKey | None, problems: Sequence[Submission], *, is_estimate: bool
) -> AccuracyTable | None:
    """Admit the problems to the queue; return the accuracy table if any of them has a budget."""
    inside.limits.reserve_jobs(holder, len(problems), is_estimate=is_estimate)
    has_budgets = any(each.checked.problem.accuracy.budget_seconds is not None for each in problems)
    return AccuracyStore(inside.database).current() if has_budgets else None


def _settled(problem: Submission | ApiError, table: AccuracyTable | None) -> Submission | ApiError:
    """Return a problem as it is queued, or its refusal."""
    if isinstance(problem, ApiError):
        return problem
    try:
        return problem.settled(window_of(problem.verdict), table)
    except ApiError as refusal:
        return refusal
    except DynamicsError as fault:
        return refusal_of(fault)


async def estimate_jobs(
    inside: Resources, problems: Sequence[Submission | ApiError], holder: ApiKey | None, *, is_list: bool
) -> CostEstimateOut:
    """Return what problems are expected to cost. Raises the refusal of a single one."""
    if is_list:
        answers = await accept_many(inside, problems, holder, is_estimate=True)
    elif isinstance(problems[0], ApiError):
        raise problems[0]
    else:
        answers = [await accept(inside, problems[0], holder, is_estimate=True)]
    accepted = {index: each for index, each in enumerate(answers) if isinstance(each, Submission)}
    if not accepted:
        raise nothing_accepted(answers)
    given = {
        index if is_list else None: (each.checked.problem, _sampled(each)) for index, each in accepted.items()
    }
    refused = {index: each for index, each in enumerate(answers) if isinstance(each, ApiError)}
    return await run_in_threadpool(_estimate_out, inside, partial(estimate_of_jobs, given), refused)


async def estimate_sweep(inside: Resources, sweep: Sweep, holder: ApiKey | None) -> CostEstimateOut:
    """Return what a sweep is expected to cost, from the examination of some of its points."""

    def checked() -> dict[int, Submission]:
        found: dict[int, Submission] = {}
        for index in sampled_points(sweep):
            # What is no problem is a point with a reason, and costs next to nothing.
            with suppress(InvalidProblemError, DynamicsError):
                found[index] = check(sweep.document(index), inside.settings)
        return found

    points = await run_in_threadpool(checked)
    claimant = Claimant(None if holder is None else holder.id, is_list=True)
    examined = await _examine(inside, points, claimant)
    sampled = [(each.checked.problem, _sampled(examined.get(index, each))) for index, each in points.items()]
    return await run_in_threadpool(_estimate_out, inside, partial(estimate_of_sweep, sweep, sampled), {})


def _sampled(found: Submission | ApiError) -> ExaminedPoint:
    """Return what an examination has found, as far as there was time for it."""
    if isinstance(found, ApiError):
        return UNEXAMINED
    seconds = 0.0 if found.keys is None else found.seconds or UNEXAMINED.seconds
    try:
        return ExaminedPoint(window_of(found.verdict), seconds)
    except ApiError:
        return ExaminedPoint(None, seconds, is_refused=True)


def _estimate_out(
    inside: Resources,
    estimate: Callable[[AccuracyTable, AccuracyTable], CostEstimate],
    refused: Mapping[int, ApiError],
) -> CostEstimateOut:
    found = estimate(AccuracyStore(inside.database).current(), shipped_table())
    registry = WorkerRegistry(inside.database, lease_seconds=inside.settings.lease_seconds)
    kernels = most_missing(registry.kernels())
    return CostEstimateOut(
        points=found.points,
        tier=found.tier,
        seconds=found.seconds,
        bytes=found.bytes,
        slow=[SlowPart(pointer=each.pointer, why=each.why) for each in found.slow],
        ready_in=None if kernels is None else kernels.seconds,
        refused=[
            RefusedItemOut(index=index, problem=refusal.document()) for index, refusal in refused.items()
        ],
    )


def nothing_accepted(answers: Sequence[Submission | ApiError]) -> ApiError:
    """Return the refusal of a list none of whose problems is accepted."""
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
        extras={"items": [refused_item(refusal).model_dump() for refusal in refusals]},
    )


def refused_item(refusal: ApiError) -> JobItemOut:
    """Return what stands in the place of a refused problem."""
    return JobItemOut(status=refusal.status, job=None, problem=refusal.document())


async def _examine(
    inside: Resources, given: Mapping[int, Submission], claimant: Claimant
) -> dict[int, Submission | ApiError]:
    """Examine those that need it by queued calls; one call takes problems with the same potential."""
    problems = {index: each for index, each in given.items() if each.keys is not None}
    deadline = time.monotonic() + LIST_VERDICTS * inside.settings.verdict_seconds
    found: dict[int, Submission | ApiError] = {}
    for index, problem in problems.items():
        known = inside.examiner.known(problem)
        if known is not None:
            found[index] = known
    waiting = deque(_batches({k: each for k, each in problems.items() if k not in found}))

    async def examine_some() -> None:
        while waiting:
            batch = waiting.popleft()
            if time.monotonic() > deadline:
                # Nothing is known of formulas that no child has had: they are to be sent again.
                unseen = inside.verdicts.busy("the time of its list was over before it was examined")
                found.update({index: unseen for index in batch if index not in found})
                continue
            alone = len(batch) == 1
            try:
                answers = await inside.examiner.examine(
                    [problems[index] for index in batch], claimant, crashes=1 if alone else 0
                )
            except ApiError as busy:
                found.update(dict.fromkeys(batch, busy))
            except SandboxError as fault:
                if alone or isinstance(fault, SandboxTimeoutError):
                    found.update(dict.fromkeys(batch, refusal_of(fault)))
                if not alone:
                    # One of them caused it and must not fail the others, for which there may be time.
                    waiting.extend([index] for index in batch)
            else:
                found.update(zip(batch, answers, strict=True))

    async with asyncio.TaskGroup() as group:
        for _ in range(min(inside.verdicts.most, len(waiting))):
            group.create_task(examine_some())
    return found


def _batches(problems: Mapping[int, Submission]) -> list[list[int]]:
    settings: dict[str, list[int]] = {}
    for index, problem in problems.items():
        settings.setdefault(problem.to_examine().verdict, []).append(index)
    # Problems with different potentials share calls too, since each call has a fixed cost.
    alone = [indices[0] for indices in settings.values() if len(indices) == 1]
    several = [indices for indices in settings.values() if len(indices) > 1]
    return [
        indices[start : start + _TOGETHER]
        for indices in [*several, alone]
        for start in range(0, len(indices), _TOGETHER)
    ]


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
