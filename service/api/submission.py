"""From documents to problems that can be queued: one, or many at once."""

import asyncio
import json
import time
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus

from starlette.concurrency import run_in_threadpool

from service.api.errors import ApiError
from service.api.examining import examine, verdict_in
from service.api.handlers import refusal_of
from service.api.limits import check_problem_samples
from service.api.resources import Resources
from service.api.verdict_queue import Claimant
from service.dynamics.accuracy import AccuracyTable
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, Problem
from service.examination import examine_problem, examine_problems
from service.jobs.keys import ApiKey
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.budgets import choose_tier, window_of, with_tier
from service.schemas.faults import Fault, InvalidProblemError, first_of
from service.schemas.problem import CheckedProblem, check_problem, problem_digest
from service.settings import Settings
from service.storage.solutions.accuracy_store import AccuracyStore

MOST_PROBLEMS = 1000
"""In one request; its body has a limit besides."""
LIST_VERDICTS = 3
"""A list is examined for at most so many times the limit of one verdict."""
_TOGETHER = 50
"""Problems of one potential that are examined by one call."""
_FAULTS_TOLD = 1000
"""Of a list; the problems after them are told one fault each."""
_AT_WORK = 2
"""Calls of one list that wait or run at the same time."""

_Document = dict[str, object]
_Verdict = Mapping[str, object] | None
_BUSY = HTTPStatus.SERVICE_UNAVAILABLE
_LIMITS = (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError)


@dataclass(frozen=True, slots=True)
class Checked:
    """A problem whose form is right."""

    checked: CheckedProblem
    document: _Document
    text: str
    """The document as JSON."""

    @property
    def needs_verdict(self) -> bool:
        """A motion from any state needs none."""
        return needs_verdict(self.checked)


@dataclass(frozen=True, slots=True)
class Accepted:
    """A problem that can be queued."""

    document: _Document
    digest: str
    problem: Problem


@dataclass(frozen=True, slots=True)
class Examined:
    """A problem that has its verdict, and what the tier of a budget is chosen by."""

    problem: Checked
    verdict: _Verdict
    table: AccuracyTable | None

    def accepted(self) -> Accepted:
        """Return the problem as it is queued: a budget is turned into a tier."""
        window = window_of(self.verdict)
        return settle(self.problem.document, self.problem.checked, window, self.table)

    def accepted_or_refusal(self) -> Accepted | ApiError:
        """Return the same, or what refuses it: no tier is expected to keep its budget."""
        try:
            return self.accepted()
        except DynamicsError as fault:
            return refusal_of(fault)


def needs_verdict(checked: CheckedProblem) -> bool:
    """Whether a problem is queued only after its potential and its motion have been examined."""
    return isinstance(checked.problem.motion, PlanarMotion)


def check(document: object, settings: Settings) -> Checked:
    """Check the form of one problem, which may take a while for a large one. Raises what refuses it."""
    checked = check_problem(document)
    check_problem_samples(checked.problem, settings)
    assert isinstance(document, dict)
    return Checked(checked, document, json.dumps(document))


def check_each(documents: Sequence[object], settings: Settings) -> list[Checked | ApiError]:
    """Do the same for each of a list; what refuses one is put in its place.

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
            # Of many problems with many faults, the later ones are told more shortly.
            fault = error if told < _FAULTS_TOLD else InvalidProblemError(first_of(error.faults, 1))
            told += len(fault.faults)
            answers.append(refusal_of(fault))
        except DynamicsError as error:
            answers.append(refusal_of(error))
    return answers


async def accept(inside: Resources, problem: Checked, holder: ApiKey | None) -> Examined:
    """Examine one problem. Raises what refuses it."""
    table = await run_in_threadpool(_reserve, inside, holder, [problem])
    verdict = None
    if problem.needs_verdict:
        claimant = Claimant(None if holder is None else holder.id)
        verdict = await examine(inside.verdicts, examine_problem, problem.text, claimant)
    return Examined(problem, verdict, table)


async def accept_many(
    inside: Resources, problems: Sequence[Checked | ApiError], holder: ApiKey | None
) -> list[Examined | ApiError]:
    """Do the same for each of a list; what refuses one is put in its place.

    Raises
    ------
    ApiError
        503: too many wait for verdicts, and none of the list was examined.
    """
    given = {index: each for index, each in enumerate(problems) if isinstance(each, Checked)}
    table = None
    if given:
        table = await run_in_threadpool(_reserve, inside, holder, list(given.values()))
    claimant = Claimant(None if holder is None else holder.id, is_list=True)
    verdicts = await _examine(inside, {k: each for k, each in given.items() if each.needs_verdict}, claimant)
    answers: list[Examined | ApiError] = []
    for index, problem in enumerate(problems):
        verdict = verdicts.get(index)
        if isinstance(problem, ApiError):
            answers.append(problem)
        elif isinstance(verdict, ApiError):
            answers.append(verdict)
        else:
            answers.append(Examined(problem, verdict, table))
    if all(isinstance(answer, ApiError) and answer.status == _BUSY for answer in answers):
        assert isinstance(answers[0], ApiError)
        raise answers[0]
    return answers


def _reserve(inside: Resources, holder: ApiKey | None, problems: Sequence[Checked]) -> AccuracyTable | None:
    """Let the problems into the queue; return the table that budgets are judged by, if there are any."""
    inside.limits.reserve_jobs(holder, len(problems))
    has_budgets = any(each.checked.problem.accuracy.budget_seconds is not None for each in problems)
    return AccuracyStore(inside.database).current() if has_budgets else None


def settle(
    document: _Document, checked: CheckedProblem, window: _Verdict, table: AccuracyTable | None
) -> Accepted:
    """Return what is queued: the problem, its budget turned into a tier.

    ``window`` is the one of a planar motion, ``table`` what budgets are judged by. Raises
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
    """Examine problems by calls that wait for their turns; those with the same potential together."""
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
                    # One of them is to blame, and must not take the others with it.
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
    # Potentials of their own share calls too: a call has its price.
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
