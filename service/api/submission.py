"""From documents to problems that can be queued: one, or many at once."""

import json
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from service.api.errors import ApiError
from service.api.examining import examine, verdict_in
from service.api.handlers import refusal_of
from service.api.limits import check_problem_samples
from service.api.resources import Resources
from service.dynamics.accuracy import AccuracyTable
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import PlanarMotion, Problem
from service.examination import examine_problem, examine_problems
from service.jobs.keys import ApiKey
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError, result_of
from service.schemas.budgets import choose_tier, window_of, with_tier
from service.schemas.faults import Fault, InvalidProblemError
from service.schemas.problem import CheckedProblem, check_problem, problem_digest
from service.storage.solutions.accuracy_store import AccuracyStore

MOST_PROBLEMS = 1000
"""In one request; its body has a limit besides."""
LIST_VERDICTS = 3
"""A list is examined for at most so many times the limit of one verdict."""
_TOGETHER = 50
"""Problems of one potential that are examined by one call."""
_AT_WORK = 2
"""Calls that wait or run at the same time: others want verdicts too."""

_Document = dict[str, object]
_Verdict = Mapping[str, object] | None
_LIMITS = (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError)


@dataclass(frozen=True, slots=True)
class Accepted:
    """A problem that can be queued."""

    document: _Document
    digest: str
    problem: Problem


def accept(inside: Resources, document: object, holder: ApiKey | None) -> Accepted:
    """Check and examine one problem; a budget is turned into a tier. Raises what refuses it."""
    checked, given = _check(inside, document)
    inside.limits.reserve_jobs(holder)
    verdict = examine(inside, examine_problem, given) if needs_verdict(checked) else None
    return settle(given, checked, window_of(verdict), _table_for(inside, [checked]))


def accept_many(
    inside: Resources, documents: Sequence[object], holder: ApiKey | None
) -> list[Accepted | ApiError]:
    """Do the same for each of a list; what refuses one is put in its place.

    Raises
    ------
    InvalidProblemError
        The list is empty or too long.
    """
    if not 1 <= len(documents) <= MOST_PROBLEMS:
        message = f"{len(documents)} problems; 1 to {MOST_PROBLEMS} are accepted at once"
        raise InvalidProblemError([Fault("", "out_of_range", message)])
    answers: list[Accepted | ApiError | None] = [None] * len(documents)
    given: dict[int, tuple[CheckedProblem, _Document]] = {}
    for index, document in enumerate(documents):
        try:
            given[index] = _check(inside, document)
        except (InvalidProblemError, DynamicsError) as fault:
            answers[index] = refusal_of(fault)
    if given:
        inside.limits.reserve_jobs(holder, len(given))
    verdicts = _examine(inside, {k: each for k, (checked, each) in given.items() if needs_verdict(checked)})
    table = _table_for(inside, [checked for checked, _ in given.values()])
    for index, (checked, document) in given.items():
        verdict = verdicts.get(index)
        if isinstance(verdict, ApiError):
            answers[index] = verdict
        else:
            answers[index] = settle(document, checked, window_of(verdict), table)
    return [answer for answer in answers if answer is not None]


def _check(inside: Resources, document: object) -> tuple[CheckedProblem, _Document]:
    checked = check_problem(document)
    check_problem_samples(checked.problem, inside.settings)
    assert isinstance(document, dict)
    return checked, document


def needs_verdict(checked: CheckedProblem) -> bool:
    """Whether a problem is queued only after its potential and its motion have been examined."""
    return isinstance(checked.problem.motion, PlanarMotion)


def _table_for(inside: Resources, problems: Sequence[CheckedProblem]) -> AccuracyTable | None:
    """Return the table that budgets are judged by, if there are any."""
    has_budgets = any(checked.problem.accuracy.budget_seconds is not None for checked in problems)
    return AccuracyStore(inside.database).current() if has_budgets else None


def settle(
    document: _Document, checked: CheckedProblem, window: _Verdict, table: AccuracyTable | None
) -> Accepted:
    """Return what is queued: the problem, its budget turned into a tier.

    ``window`` is the one of a planar motion, ``table`` what budgets are judged by.
    """
    if checked.problem.accuracy.budget_seconds is not None and table is not None:
        choice = choose_tier(checked.problem, window, table)
        document = with_tier(document, choice)
        checked = check_problem(document)
    return Accepted(document, problem_digest(checked.canonical), checked.problem)


def _examine(inside: Resources, documents: Mapping[int, _Document]) -> dict[int, _Verdict | ApiError]:
    """Examine problems by several children at once; those with the same potential together."""
    seconds = inside.settings.verdict_seconds
    deadline = time.monotonic() + LIST_VERDICTS * seconds
    verdicts: dict[int, _Verdict | ApiError] = {}
    calls: deque[tuple[list[int], Future[str]]] = deque()
    waiting = deque(_batches(documents))
    crashed = set[int]()
    while waiting or calls:
        while waiting and len(calls) < _AT_WORK:
            batch = waiting.popleft()
            if time.monotonic() > deadline:
                verdicts.update(dict.fromkeys(batch, refusal_of(SandboxTimeoutError())))
                continue
            text = json.dumps([documents[index] for index in batch])
            calls.append((batch, inside.sandbox.submit(examine_problems, text, seconds=seconds)))
        if calls:
            batch, call = calls.popleft()
            try:
                answers = json.loads(result_of(call))
            except _LIMITS as fault:
                if len(batch) > 1:
                    # One of them is to blame, and must not take the others with it.
                    waiting.extend([index] for index in batch)
                elif isinstance(fault, SandboxCrashError) and batch[0] not in crashed:
                    # Once more: somebody else may have killed the child.
                    crashed.add(batch[0])
                    waiting.append(batch)
                else:
                    verdicts[batch[0]] = refusal_of(fault)
            else:
                verdicts.update(zip(batch, map(_verdict_or_refusal, answers), strict=True))
    return verdicts


def _batches(documents: Mapping[int, _Document]) -> Iterator[list[int]]:
    settings: dict[str, list[int]] = {}
    for index, document in documents.items():
        settings.setdefault(json.dumps([document["body"], document["potential"]]), []).append(index)
    # Potentials of their own share calls too: a call has its price.
    alone = [indices[0] for indices in settings.values() if len(indices) == 1]
    several = [indices for indices in settings.values() if len(indices) > 1]
    for indices in [*several, alone]:
        for start in range(0, len(indices), _TOGETHER):
            yield indices[start : start + _TOGETHER]


def _verdict_or_refusal(answer: Mapping[str, object]) -> _Verdict | ApiError:
    try:
        return verdict_in(answer)
    except ApiError as refusal:
        return refusal
