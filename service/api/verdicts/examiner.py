"""Examines problems: by what this process or the store has cached, and by a child process for the rest.

The formulas of a verdict are simplified as far as there is time.
"""

import json
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from http import HTTPStatus
from typing import Protocol

from starlette.concurrency import run_in_threadpool

from service.api.replies import ApiError
from service.api.verdicts.verdict_queue import Claimant, VerdictQueue
from service.api.verdicts.verdict_queue import Examination as Call
from service.cache import Cache
from service.dynamics.accuracy import AccuracyTable
from service.sandbox import SandboxError
from service.schemas.problem.documents import CheckedProblem
from service.schemas.problem.problem import check_problem, choose_tier, problem_digest, with_tier
from service.schemas.reading.documents import UNANNOTATED, Annotation, Document, Fault, Part
from service.storage.examinations import CacheRow, Examination, ExaminationKeys, ExaminationStore
from service.typesetting.equations import Format
from service.verdicts.examination import examine_problems
from service.verdicts.formulas import examine_question_with_formulas, simplify_formula, with_simplified

MOST_BYTES = 32_000_000
"""Largest size of the contents that one process holds in memory, in front of the store."""


class RowStore(Protocol):
    """A store that other processes share."""

    def get(self, keys: Sequence[str]) -> Mapping[str, str]:
        """Return the contents of those keys that are there."""
        ...


class CachedExaminations:
    """The rows used last in this process, then those of the store. Safe between threads."""

    def __init__(self, store: RowStore, *, most_bytes: int = MOST_BYTES) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._cache: Cache[str, str] = Cache(most_bytes, len)
        self._hits = self._misses = 0

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of the keys that were found, in memory or in the store, and of those that were not."""
        with self._lock:
            return self._hits, self._misses

    def get(self, keys: Sequence[str]) -> dict[str, str]:
        """Return the contents of those keys that are there; what is not in memory is read from the store."""
        found = self.in_memory(keys)
        missing = [key for key in dict.fromkeys(keys) if key not in found]
        if missing:
            stored = self._store.get(missing)
            self.put(CacheRow(key, content) for key, content in stored.items())
            found.update(stored)
        with self._lock:
            self._hits += len(found)
            self._misses += sum(key not in found for key in missing)
        return found

    def in_memory(self, keys: Sequence[str]) -> dict[str, str]:
        """Return the contents of those keys that this process has."""
        cached = {key: self._cache.get(key) for key in keys}
        return {key: content for key, content in cached.items() if content is not None}

    def put(self, rows: Iterable[CacheRow]) -> None:
        """Hold rows in memory, and drop those that were not used for longest."""
        for row in rows:
            self._cache.put(row.key, row.content)


async def examine(verdicts: VerdictQueue, examination: Call, text: str, claimant: Claimant) -> Part | None:
    """Return the examination's answer to the JSON document ``text``: a verdict, or None if it needs none.

    Raises
    ------
    ApiError
        422 with what the examination found; 503 if too many wait for verdicts.
    SandboxError
        The computation did not finish.
    """
    return verdict_in(json.loads(await verdicts.ask(examination, text, claimant)))


def verdict_in(answer: Part) -> Part | None:
    """Return the verdict in an answer of the child, None if it has none; raise the error in it."""
    if "error" in answer:
        raise _refusal(answer["error"])
    verdict: Part | None = answer["verdict"]
    return verdict


def _refusal(error: Document) -> ApiError:
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
    document: Document,
    formats: Sequence[Format],
    claimant: Claimant,
    *,
    seconds: float,
) -> Part | None:
    """Return the verdict with its formulas, which are simplified for ``seconds`` at most; raises as examine.

    A formula for which SymPy takes too long or too much memory stays as it is, and so does one for which the
    queue is full.
    """
    asked = json.dumps({"document": document, "formats": formats})
    verdict = await examine(verdicts, examine_question_with_formulas, asked, claimant)
    if verdict is None:
        return None
    works = verdict["works"]
    answers: list[str] = []
    deadline = time.monotonic() + seconds
    for work in works:
        rest = deadline - time.monotonic()
        if rest <= 0:
            break
        with suppress(ApiError, SandboxError):
            answers.append(await verdicts.ask(simplify_formula, work, claimant, crashes=0, seconds=rest))
    return with_simplified(verdict, answers)


@dataclass(frozen=True, slots=True)
class Submission:
    """One problem on its way into the queue; each step fills in what it finds."""

    document: Part
    """As it is stored: without labels and note, and in the end with a tier in place of a budget."""
    checked: CheckedProblem
    """The document as it states the problem."""
    annotation: Annotation = UNANNOTATED
    keys: ExaminationKeys | None = None
    """Keys of its examination; None for a motion that needs none."""
    text: str = ""
    """The document as JSON, for a child that examines it."""
    answer: Part | None = None
    """The answer of its examination; None before it, and where none is needed."""
    entries: tuple[CacheRow, ...] = ()
    """Its verdict and the windows of its curve: to be stored with its job, unless they are there."""
    seconds: float = 0.0
    """Seconds that a child took for it."""

    @property
    def verdict(self) -> Part | None:
        """The verdict, None without one; raises the refusal that its examination answered."""
        return None if self.answer is None else verdict_in(self.answer)

    @property
    def digest(self) -> str:
        """The digest of the problem; it takes as long as printing its formula."""
        return problem_digest(self.checked.canonical)

    @property
    def examination(self) -> Examination | None:
        """Rows of its examination that are stored with its job."""
        return None if self.keys is None else Examination(self.keys.windows, self.seconds)

    def to_examine(self) -> ExaminationKeys:
        """Return the keys of its examination; raises ValueError if it needs none."""
        if self.keys is None:
            raise ValueError("the problem needs no examination")
        return self.keys

    def settled(self, window: Part | None, table: AccuracyTable | None) -> "Submission":
        """Return it with its budget turned into a tier.

        ``window`` is that of a planar motion, ``table`` the accuracy table. Raises
        :class:`BudgetTooSmallError` where no tier is expected to keep it.
        """
        if self.checked.problem.accuracy.budget_seconds is None or table is None:
            return self
        document = with_tier(self.document, choose_tier(self.checked.problem, window, table))
        return replace(self, document=document, checked=check_problem(document))


class Examiner:
    """Examines problems; what equal ones have in common is found once for the whole installation."""

    def __init__(self, verdicts: VerdictQueue, cache: CachedExaminations, store: ExaminationStore) -> None:
        self._verdicts, self._cache, self._store = verdicts, cache, store

    def known(self, problem: Submission) -> Submission | None:
        """Return a problem with its answer, if this process has examined it before."""
        key = problem.to_examine().answer
        content = self._cache.in_memory([key]).get(key)
        return None if content is None else self._answered(problem, json.loads(content), 0.0)

    def cached(self, problems: Sequence[Submission]) -> dict[str, str]:
        """Return what is cached of problems; what is not in memory is read from the store."""
        return self._cache.get(_keys(problems))

    async def examine(
        self,
        problems: Sequence[Submission],
        claimant: Claimant,
        *,
        crashes: int = 1,
        cached: Mapping[str, str] | None = None,
    ) -> list[Submission]:
        """Return problems with the answers of one child; raises what :meth:`VerdictQueue.ask` raises.

        ``cached`` is what :meth:`cached` returns of them, for callers who have asked already.

        If all are refused, what was found is stored here, since there is no job to store it with.
        """
        keys = _keys(problems)
        if cached is None and len(self._cache.in_memory(keys)) == len(keys):
            cached = self._cache.get(keys)
        elif cached is None:
            cached = await run_in_threadpool(self._cache.get, keys)
        reply = json.loads(
            await self._verdicts.ask(examine_problems, _text(problems, cached), claimant, crashes=crashes)
        )
        entries = tuple(CacheRow(key, content) for key, content in reply["found"].items())
        self._cache.put(entries)
        answers: list[Part] = reply["answers"]
        self._cache.put(
            CacheRow(problem.to_examine().answer, json.dumps(answer))
            for problem, answer in zip(problems, answers, strict=True)
            if "error" not in answer
        )
        if entries and all("error" in answer for answer in answers):
            await run_in_threadpool(self._store.add, entries)
        return [
            self._answered(problem, answer, seconds)
            for problem, answer, seconds in zip(problems, answers, reply["seconds"], strict=True)
        ]

    def _answered(self, problem: Submission, answer: Part, seconds: float) -> Submission:
        found = {} if "error" in answer else self._cache.in_memory(_keys([problem]))
        entries = tuple(CacheRow(key, content) for key, content in found.items())
        return replace(problem, answer=answer, entries=entries, seconds=seconds)


def _keys(problems: Sequence[Submission]) -> list[str]:
    """Return the keys of the verdicts and the windows, each once."""
    found = (problem.to_examine() for problem in problems)
    return list(dict.fromkeys(key for keys in found for key in (keys.verdict, keys.windows)))


def _text(problems: Sequence[Submission], cached: Mapping[str, str]) -> str:
    """Return the problems with what is cached of them; documents are JSON already."""
    parts = (
        f'{{"document":{problem.text},"verdict":"{keys.verdict}","windows":"{keys.windows}"}}'
        for problem, keys in ((problem, problem.to_examine()) for problem in problems)
    )
    return f'{{"problems":[{",".join(parts)}],"cached":{json.dumps(cached)}}}'
