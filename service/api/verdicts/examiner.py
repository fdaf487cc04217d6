"""Examines problems: by what this process or the store keeps, and by a child process for the rest.

The formulas of a verdict are simplified as far as there is time.
"""

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any  # a document that was read from JSON

from starlette.concurrency import run_in_threadpool

from service.api.replies.errors import ApiError
from service.api.verdicts.verdict_queue import Claimant, Examination, VerdictQueue
from service.sandbox import SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.schemas.reading.documents import Fault
from service.storage.examinations import ExaminationStore
from service.typesetting.equations import Format
from service.verdicts.cache_rows import Entry, ExaminationKeys
from service.verdicts.examination import examine_problems
from service.verdicts.formulas import examine_question_with_formulas, simplify_formula, with_simplified
from service.verdicts.memory import KeptExaminations


async def examine(
    verdicts: VerdictQueue, examination: Examination, text: str, claimant: Claimant
) -> Mapping[str, object] | None:
    """Return the examination's answer to the JSON document ``text``: a verdict, or None if it needs none.

    Raises
    ------
    ApiError
        422 with what the examination found; 503 if too many wait for verdicts.
    SandboxTimeoutError, SandboxMemoryError, SandboxCrashError
        The computation did not finish.
    """
    return verdict_in(json.loads(await verdicts.ask(examination, text, claimant)))


def verdict_in(answer: Mapping[str, Any]) -> Mapping[str, object] | None:
    """Return the verdict in an answer of the child, None if it has none; raise the error in it."""
    if "error" in answer:
        raise _refusal(answer["error"])
    verdict: Mapping[str, object] | None = answer["verdict"]
    return verdict


def _refusal(error: Mapping[str, object]) -> ApiError:
    extras = dict(error)
    code, detail, pointer = (str(extras.pop(name)) for name in ("code", "detail", "pointer"))
    given = extras.pop("faults", None)
    if isinstance(given, list):
        faults = [Fault(**fault) for fault in given]
    else:
        faults = [Fault(pointer, code, detail)] if pointer else []
    return ApiError(HTTPStatus.UNPROCESSABLE_ENTITY, code, detail, faults=faults, extras=extras)


async def examine_with_formulas(
    verdicts: VerdictQueue,
    document: Mapping[str, object],
    formats: Sequence[Format],
    claimant: Claimant,
    *,
    seconds: float,
) -> Mapping[str, object] | None:
    """Return the verdict with its formulas, which are simplified for ``seconds`` at most; raises as examine.

    A formula for which SymPy takes too long or too much memory stays as it is, and so does one for which the
    queue has no place.
    """
    asked = json.dumps({"document": document, "formats": formats})
    verdict = await examine(verdicts, examine_question_with_formulas, asked, claimant)
    if verdict is None:
        return None
    works = verdict["works"]
    assert isinstance(works, list)
    answers: list[str] = []
    deadline = time.monotonic() + seconds
    for work in works:
        rest = deadline - time.monotonic()
        if rest <= 0:
            break
        with suppress(ApiError, SandboxTimeoutError, SandboxMemoryError, SandboxCrashError):
            answers.append(await verdicts.ask(simplify_formula, work, claimant, crashes=0, seconds=rest))
    return with_simplified(verdict, answers)


Answer = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class ToExamine:
    """A problem with a planar motion, as it is passed to a child."""

    text: str
    """The document as JSON."""
    keys: ExaminationKeys


@dataclass(frozen=True, slots=True)
class ExaminedProblem:
    """The answer to one problem."""

    answer: Answer
    entries: tuple[Entry, ...] = ()
    """Its verdict and the windows of its curve: to be stored with its job, unless they are there."""
    seconds: float = 0.0
    """Seconds that a child took for it."""


class Examiner:
    """Examines problems; what equal ones have in common is found once for the whole installation."""

    def __init__(self, verdicts: VerdictQueue, kept: KeptExaminations, store: ExaminationStore) -> None:
        self._verdicts, self._kept, self._store = verdicts, kept, store

    def known(self, problem: ToExamine) -> ExaminedProblem | None:
        """Return the answer to a problem that this process has examined before."""
        content = self._kept.in_memory([problem.keys.answer]).get(problem.keys.answer)
        return None if content is None else ExaminedProblem(json.loads(content), self._entries(problem))

    def kept(self, problems: Sequence[ToExamine]) -> dict[str, str]:
        """Return what is kept of problems; the store is asked for what this process does not know."""
        return self._kept.get(_keys(problems))

    async def examine(
        self,
        problems: Sequence[ToExamine],
        claimant: Claimant,
        *,
        crashes: int = 1,
        kept: Mapping[str, str] | None = None,
    ) -> list[ExaminedProblem]:
        """Return the answers of one child to some problems; raises what :meth:`VerdictQueue.ask` raises.

        ``kept`` is what :meth:`kept` returns of them, for callers who have asked already.

        If all are refused, what was found is stored here, since there is no job to store it with.
        """
        keys = _keys(problems)
        if kept is None and len(self._kept.in_memory(keys)) == len(keys):
            kept = self._kept.get(keys)
        elif kept is None:
            kept = await run_in_threadpool(self._kept.get, keys)
        reply = json.loads(
            await self._verdicts.ask(examine_problems, _text(problems, kept), claimant, crashes=crashes)
        )
        entries = tuple(Entry(key, content) for key, content in reply["found"].items())
        self._kept.remember(entries)
        answers: list[Answer] = reply["answers"]
        self._kept.remember(
            Entry(problem.keys.answer, json.dumps(answer))
            for problem, answer in zip(problems, answers, strict=True)
            if "error" not in answer
        )
        if entries and all("error" in answer for answer in answers):
            await run_in_threadpool(self._store.add, entries)
        return [
            ExaminedProblem(answer, () if "error" in answer else self._entries(problem), seconds)
            for problem, answer, seconds in zip(problems, answers, reply["seconds"], strict=True)
        ]

    def _entries(self, problem: ToExamine) -> tuple[Entry, ...]:
        kept = self._kept.in_memory([problem.keys.verdict, problem.keys.windows])
        return tuple(Entry(key, content) for key, content in kept.items())


def _keys(problems: Sequence[ToExamine]) -> list[str]:
    return list({key for problem in problems for key in (problem.keys.verdict, problem.keys.windows)})


def _text(problems: Sequence[ToExamine], kept: Mapping[str, str]) -> str:
    """Return the problems with what is kept of them; documents are JSON already."""
    parts = (
        f'{{"document":{problem.text},"verdict":"{problem.keys.verdict}","windows":"{problem.keys.windows}"}}'
        for problem in problems
    )
    return f'{{"problems":[{",".join(parts)}],"kept":{json.dumps(kept)}}}'
