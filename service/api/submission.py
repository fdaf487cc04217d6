"""Reads, checks and examines problems before they are queued, one or many at once."""

import asyncio
import json
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus

from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Resources
from service.api.keys.limits import check_problem_samples
from service.api.middleware.error_handlers import refusal_of
from service.api.replies.errors import ApiError
from service.api.verdicts.children import examine, verdict_in
from service.api.verdicts.verdict_queue import Claimant
from service.dynamics.accuracy import AccuracyTable
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, Problem
from service.jobs.keys import ApiKey
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.problem.budgets import choose_tier, window_of, with_tier
from service.schemas.problem.problem import CheckedProblem, check_problem, problem_digest
from service.schemas.reading.faults import Fault, InvalidProblemError, first_of
from service.settings import Settings
from service.storage.solutions.accuracy_store import AccuracyStore
from service.verdicts.examination import examine_problem, examine_problems

MOST_PROBLEMS = 1000
"""Problems in one request, whose body has a size limit too."""
LIST_VERDICTS = 3
"""A list may take so many times the time limit of one verdict."""
_TOGETHER = 50
"""Problems of one potential that are examined by one call."""
_FAULTS_TOLD = 1000
"""Faults listed for a whole list; later problems get one fault each."""
_AT_WORK = 2
"""Calls of one list that wait or run at the same time."""

_Document = dict[str, object]
_Verdict = Mapping[str, object] | None
_BUSY = HTTPStatus.SERVICE_UNAVAILABLE
_LIMITS = (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError)


@dataclass(frozen=True, slots=True)
class Checked:
    """A problem whose document is valid."""

    checked: CheckedProblem
    document: _Document
    text: str
    """The document as JSON."""

    @property
    def needs_verdict(self) -> bool:
        """False for a motion from any state."""
        return needs_verdict(self.checked)


@dataclass(frozen=True, slots=True)
class Accepted:
    """A problem that can be queued."""

    document: _Document
    digest: str
    problem: Problem


@dataclass(frozen=True, slots=True)
class JudgedDocument:
    """A problem with its verdict, and the data by which a budget's tier is chosen."""

    problem: Checked
    verdict: _Verdict
    table: AccuracyTable | None

    def accepted(self) -> Accepted:
        """Return the problem as it is queued: a budget is turned into a tier."""
        window = window_of(self.verdict)
        return settle(self.problem.document, self.problem.checked, window, self.table)

    def accepted_or_refusal(self) -> Accepted | ApiError:
        """Return the same, or the refusal if no tier is expected to keep its budget."""
        try:
            return self.accepted()
        except DynamicsError as fault:
            return refusal_of(fault)


def needs_verdict(checked: CheckedProblem) -> bool:
    """Whether a problem is queued only after its potential and its motion have been examined."""
    return isinstance(checked.problem.motion, PlanarMotion)


def check(document: object, settings: Settings) -> Checked:
    """Validate the document of one problem, which takes a while for a large one. Raises its refusal."""
    checked = check_problem(document)
    check_problem_samples(checked.problem, settings)
    assert isinstance(document, dict)
    return Checked(checked, document, json.dumps(document))


def check_each(documents: Sequence[object], settings: Settings) -> list[Checked | ApiError]:
    """Validate each document of a list; a refusal takes the place of its problem.

    Raises
    ------
    InvalidProblemError
        The list is empty or too long.
    """
    if not 1 <= len(documents) <= MOST_PROBLEMS:
        message = f"{len(documents)} problems; 1 to {MOST_PROBLEMS} are accepted at once"
        raise InvalidProblemError([Fault("", "out_of_range", message)])
    answers: list[Checked | ApiError] = []
    told = 0
    for document in documents:
        try:
            answers.append(check(document, settings))
        except InvalidProblemError as error:
            # After many faults in a list, only the first fault of each later problem is listed.
            fault = error if told < _FAULTS_TOLD else InvalidProblemError(first_of(error.faults, 1))
            told += len(fault.faults)
            answers.append(refusal_of(fault))
        except DynamicsError as error:
            answers.append(refusal_of(error))
    return answers


async def accept(inside: Resources, problem: Checked, holder: ApiKey | None) -> JudgedDocument:
    """Examine one problem. Raises its refusal."""
    table = await run_in_threadpool(_reserve, inside, holder, [problem])
    verdict = None
    if problem.needs_verdict:
        claimant = Claimant(None if holder is None else holder.id)
        verdict = await examine(inside.verdicts, examine_problem, problem.text, claimant)
    return JudgedDocument(problem, verdict, table)


async def accept_many(
    inside: Resources, problems: Sequence[Checked | ApiError], holder: ApiKey | None
) -> list[JudgedDocument | ApiError]:
    """Examine each problem of a list; a refusal takes the place of its problem.

    Raises
    ------
    ApiError
        503: too many requests wait for verdicts, and no problem of the list was examined.
    """
    given = {index: each for index, each in enumerate(problems) if isinstance(each, Checked)}
    table = None
    if given:
        table = await run_in_threadpool(_reserve, inside, holder, list(given.values()))
    claimant = Claimant(None if holder is None else holder.id, is_list=True)
    verdicts = await _examine(inside, {k: each for k, each in given.items() if each.needs_verdict}, claimant)
    answers: list[JudgedDocument | ApiError] = []
    for index, problem in enumerate(problems):
        verdict = verdicts.get(index)
        if isinstance(problem, ApiError):
            answers.append(problem)
        elif isinstance(verdict, ApiError):
            answers.append(verdict)
        else:
            answers.append(JudgedDocument(problem, verdict, table))
    if all(isinstance(answer, ApiError) and answer.status == _BUSY for answer in answers):
        assert isinstance(answers[0], ApiError)
        raise answers[0]
    return answers


def _reserve(inside: Resources, holder: ApiKey | None, problems: Sequence[Checked]) -> AccuracyTable | None:
    """Admit the problems to the queue; return the accuracy table if any of them has a budget."""
    inside.limits.reserve_jobs(holder, len(problems))
    has_budgets = any(each.checked.problem.accuracy.budget_seconds is not None for each in problems)
    return AccuracyStore(inside.database).current() if has_budgets else None


def settle(
    document: _Document, checked: CheckedProblem, window: _Verdict, table: AccuracyTable | None
) -> Accepted:
    """Return the problem to queue, with its budget turned into a tier.

    ``window`` is that of a planar motion, ``table`` the accuracy table. Raises
    :class:`BudgetTooSmallError` where no tier is expected to keep it.
    """
    if checked.problem.accuracy.budget_seconds is not None and table is not None:
        choice = choose_tier(checked.problem, window, table)
        document = with_tier(document, choice)
        checked = check_problem(document)
    return Accepted(document, problem_digest(checked.canonical), checked.problem)


async def _examine(
    inside: Resources, problems: Mapping[int, Checked], claimant: Claimant
) -> dict[int, _Verdict | ApiError]:
    """Examine problems by queued calls; one call takes problems with the same potential."""
    deadline = time.monotonic() + LIST_VERDICTS * inside.settings.verdict_seconds
    verdicts: dict[int, _Verdict | ApiError] = {}
    waiting = deque(await run_in_threadpool(_batches, problems))

    async def examine_some() -> None:
        while waiting:
            batch = waiting.popleft()
            if time.monotonic() > deadline:
                verdicts.update(dict.fromkeys(batch, refusal_of(SandboxTimeoutError())))
                continue
            text = f"[{', '.join(problems[index].text for index in batch)}]"
            alone = len(batch) == 1
            try:
                answers = json.loads(
                    await inside.verdicts.ask(examine_problems, text, claimant, crashes=1 if alone else 0)
                )
            except ApiError as busy:
                verdicts.update(dict.fromkeys(batch, busy))
            except _LIMITS as fault:
                if alone:
                    verdicts[batch[0]] = refusal_of(fault)
                else:
                    # One of them caused it and must not fail the others.
                    waiting.extend([index] for index in batch)
            else:
                verdicts.update(zip(batch, map(_verdict_or_refusal, answers), strict=True))

    async with asyncio.TaskGroup() as group:
        for _ in range(min(_AT_WORK, len(waiting))):
            group.create_task(examine_some())
    return verdicts


def _batches(problems: Mapping[int, Checked]) -> list[list[int]]:
    settings: dict[str, list[int]] = {}
    for index, problem in problems.items():
        document = problem.document
        settings.setdefault(json.dumps([document["body"], document["potential"]]), []).append(index)
    # Problems with different potentials share calls too, since each call has a fixed cost.
    alone = [indices[0] for indices in settings.values() if len(indices) == 1]
    several = [indices for indices in settings.values() if len(indices) > 1]
    return [
        indices[start : start + _TOGETHER]
        for indices in [*several, alone]
        for start in range(0, len(indices), _TOGETHER)
    ]


def _verdict_or_refusal(answer: Mapping[str, object]) -> _Verdict | ApiError:
    try:
        return verdict_in(answer)
    except ApiError as refusal:
        return refusal
