"""Solves stored solutions again, chosen by chance, and compares: what ``polhode doctor`` samples."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from random import Random

from sqlalchemy import func, select

from service.jobs.records import Refused, StoredSolution
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.storage.database.database import Database
from service.storage.jobs.claiming import stored_solutions
from service.storage.tables.solutions import SolutionRow
from workers.computation.audit import Sameness, compare_solutions
from workers.computation.compute import solve_document, way_to_repeat


@dataclass(frozen=True, slots=True)
class Repetition:
    """The result for one solution."""

    solution: str
    sameness: Sameness
    detail: str

    @property
    def is_clean(self) -> bool:
        """The stored numbers are confirmed."""
        return self.sameness in (Sameness.IDENTICAL, Sameness.WITHIN_ERRORS)


def repeat_solutions(
    database: Database, sandbox: Sandbox, *, count: int, seconds: float, random: Random
) -> Iterator[Repetition]:
    """Solve ``count`` of the stored problems, chosen by ``random``, in ``seconds`` each at most; compare."""
    for solution_id, stored in _chosen(database, count, random):
        sameness, detail = _repeat(stored, sandbox, seconds)
        yield Repetition(solution_id, sameness, detail)


def _chosen(database: Database, count: int, random: Random) -> Iterator[tuple[str, StoredSolution]]:
    with database.read() as session:
        total = session.scalar(select(func.count()).select_from(SolutionRow)) or 0
    for place in random.sample(range(total), min(count, total)):
        one = select(SolutionRow.id).order_by(SolutionRow.id).offset(place).limit(1)
        with database.read() as session:
            found = session.scalars(one).all()
            yield from stored_solutions(session.connection(), found).items()


def _repeat(stored: StoredSolution, sandbox: Sandbox, seconds: float) -> tuple[Sameness, str]:
    try:
        problem, way = json.dumps(stored.problem), way_to_repeat(stored)
        outcome = sandbox.run(solve_document, problem, "", way, seconds=seconds)
    except (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError) as fault:
        return Sameness.FAILED, f"it cannot be solved again: {fault}"
    if isinstance(outcome, Refused):
        return Sameness.FAILED, "it cannot be solved again: {code}: {detail}".format(**outcome.error)
    comparison = compare_solutions(stored, outcome)
    return comparison.sameness, comparison.detail
