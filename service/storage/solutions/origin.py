"""Reads where a solution comes from: its problem, its job, and the attempts at it."""

from dataclasses import dataclass

from service.jobs.records import Attempt, SolutionNotFoundError
from service.storage.annotations import annotations_of
from service.storage.database.database import Database
from service.storage.database.rows import is_id
from service.storage.jobs.moves import history
from service.storage.solutions.solution_store import Solution, solution_of
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SolutionRow


@dataclass(frozen=True, slots=True)
class SolutionOrigin:
    """The stored records of the making of a solution."""

    solution: Solution
    digest: str
    """Hash of the problem and of the numerics version that solved it."""
    examination: str | None
    """Key of the windows that its examination found; None where none was kept."""
    examined_seconds: float | None
    """Seconds that the examination took; None if that is not known."""
    attempts: tuple[Attempt, ...]
    """At its job, oldest first; the last one that succeeded made it."""


def origin_of(database: Database, solution_id: str) -> SolutionOrigin:
    """Return the origin of a solution, or raise :class:`SolutionNotFoundError`."""
    with database.read() as session:
        row = session.get(SolutionRow, solution_id) if is_id(solution_id) else None
        if row is None:
            raise SolutionNotFoundError(solution_id)
        job = session.get(JobRow, row.job_id)
        return SolutionOrigin(
            solution_of(row, *annotations_of(session, [row])),
            row.digest,
            None if job is None else job.examination,
            None if job is None else job.examined_seconds,
            history(session, row.job_id),
        )
