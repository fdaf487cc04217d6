"""Reads, checks and examines problems before they are queued, one or many at once."""

import asyncio
import json
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from http import HTTPStatus

from starlette.concurrency import run_in_threadpool

from service.api.dependencies import Resources
from service.api.keys.limits import check_problem_samples
from service.api.middleware.error_handlers import refusal_of
from service.api.replies.errors import ApiError
from service.api.verdicts.examiner import ExaminedProblem, ToExamine, verdict_in
from service.api.verdicts.verdict_queue import Claimant
from service.dynamics.accuracy import AccuracyTable
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, Problem
from service.jobs.keys import ApiKey
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.problem.budgets import choose_tier, window_of, with_tier
from service.schemas.problem.documents import JobIn
from service.schemas.problem.problem import check_problem, problem_digest
from service.schemas.problem.rules import CheckedProblem
from service.schemas.reading.documents import Fault, InvalidProblemError, first_of
from service.schemas.reading.marks import UNMARKED, Marks, split_marks
from service.settings import Settings
from service.storage.solutions.accuracy_store import AccuracyStore
from service.verdicts.cache_rows import Entry, Examination, keys_of

MOST_PROBLEMS = 1000
"""Problems in one request, whose body has a size limit too."""
LIST_VERDICTS = 3
"""A list may take so many times the time limit of one verdict."""
_TOGETHER = 50
"""Problems of one potential that are examined by one call."""
_FAULTS_TOLD = 1000
"""Faults listed for a whole list; later problems get one fault each."""

_Document = dict[str, object]
_Verdict = Mapping[str, object] | None
_BUSY = HTTPStatus.SERVICE_UNAVAILABLE
_LIMITS = (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError)


@dataclass(frozen=True, slots=True)
class Checked:
    """A problem whose document is valid."""

    checked: CheckedProblem
    document: _Document
    to_examine: ToExamine | None
    """None for a motion from any state, which needs no verdict."""
    marks: Marks = UNMARKED


@dataclass(frozen=True, slots=True)
class Accepted:
    """A problem that can be queued."""

    document: _Document
    digest: str
    problem: Problem
    examination: Examination | None = None
    """None for a motion from any state."""
    entries: tuple[Entry, ...] = ()
    """The results of its examination, to be stored with it."""
    marks: Marks = UNMARKED


@dataclass(frozen=True, slots=True)
class JudgedDocument:
    """A problem with its verdict, and the data by which a budget's tier is chosen."""

    problem: Checked
    verdict: _Verdict
    table: AccuracyTable | None
    entries: tuple[Entry, ...] = ()
    seconds: float = 0.0
    """Seconds that the examination took."""

    def accepted(self) -> Accepted:
        """Return the problem as it is queued: a budget is turned into a tier."""
        window, asked = window_of(self.verdict), self.problem.to_examine
        settled = settle(self.problem.document, self.problem.checked, window, self.table)
        examination = None if asked is None else Examination(asked.keys.windows, self.seconds)
        return replace(settled, examination=examination, entries=self.entries, marks=self.problem.marks)

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
    checked = check_problem(document, JobIn)
    check_problem_samples(checked.problem, settings)
    assert isinstance(document, dict)
    stated, marks = split_marks(document)
    to_examine = None
    if needs_verdict(checked):
        to_examine = ToExamine(json.dumps(stated), keys_of(checked.canonical))
    return Checked(checked, stated, to_examine, marks)


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

    def prepare() -> tuple[AccuracyTable | None, Mapping[str, str]]:
        table = _reserve(inside, holder, [problem])
        return table, {} if problem.to_examine is None else inside.examiner.kept([problem.to_examine])

    table, kept = await run_in_threadpool(prepare)
    if problem.to_examine is None:
        return JudgedDocument(problem, None, table)
    found = inside.examiner.known(problem.to_examine)
    if found is None:
        claimant = Claimant(None if holder is None else holder.id)
        (found,) = await inside.examiner.examine([problem.to_examine], claimant, kept=kept)
    return JudgedDocument(problem, verdict_in(found.answer), table, found.entries, found.seconds)


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
    examined = await _examine(
        inside, {k: each.to_examine for k, each in given.items() if each.to_examine is not None}, claimant
    )
    answers: list[JudgedDocument | ApiError] = []
    for index, problem in enumerate(problems):
        found = examined.get(index)
        if isinstance(problem, ApiError):
            answers.append(problem)
        elif isinstance(found, ApiError):
            answers.append(found)
        else:
            answers.append(_judged(problem, found, table))
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


def _judged(
    problem: Checked, found: ExaminedProblem | None, table: AccuracyTable | None
) -> JudgedDocument | ApiError:
    if found is None:
        return JudgedDocument(problem, None, table)
    try:
        return JudgedDocument(problem, verdict_in(found.answer), table, found.entries, found.seconds)
    except ApiError as refusal:
        return refusal


async def _examine(
    inside: Resources, problems: Mapping[int, ToExamine], claimant: Claimant
) -> dict[int, ExaminedProblem | ApiError]:
    """Examine problems by queued calls; one call takes problems with the same potential."""
    deadline = time.monotonic() + LIST_VERDICTS * inside.settings.verdict_seconds
    found: dict[int, ExaminedProblem | ApiError] = {}
    for index, problem in problems.items():
        known = inside.examiner.known(problem)
        if known is not None:
            found[index] = known
    waiting = deque(_batches({k: each for k, each in problems.items() if k not in found}))

    async def examine_some() -> None:
        while waiting:
            batch = waiting.popleft()
            if time.monotonic() > deadline:
                found.update(dict.fromkeys(batch, refusal_of(SandboxTimeoutError())))
                continue
            alone = len(batch) == 1
            try:
                answers = await inside.examiner.examine(
                    [problems[index] for index in batch], claimant, crashes=1 if alone else 0
                )
            except ApiError as busy:
                found.update(dict.fromkeys(batch, busy))
            except _LIMITS as fault:
                if alone:
                    found[batch[0]] = refusal_of(fault)
                else:
                    # One of them caused it and must not fail the others.
                    waiting.extend([index] for index in batch)
            else:
                found.update(zip(batch, answers, strict=True))

    async with asyncio.TaskGroup() as group:
        for _ in range(min(inside.verdicts.most, len(waiting))):
            group.create_task(examine_some())
    return found


def _batches(problems: Mapping[int, ToExamine]) -> list[list[int]]:
    settings: dict[str, list[int]] = {}
    for index, problem in problems.items():
        settings.setdefault(problem.keys.verdict, []).append(index)
    # Problems with different potentials share calls too, since each call has a fixed cost.
    alone = [indices[0] for indices in settings.values() if len(indices) == 1]
    several = [indices for indices in settings.values() if len(indices) > 1]
    return [
        indices[start : start + _TOGETHER]
        for indices in [*several, alone]
        for start in range(0, len(indices), _TOGETHER)
    ]
