"""Finds solutions by their numbers and reads them, with or without their arrays.

:mod:`service.storage.jobs.job_store` writes a solution only together with the success
of its job; so every stored solution comes from a succeeded job.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.jobs.records import SolutionNotFoundError
from service.schemas.query.conditions import ListQuery, Value
from service.schemas.reading.annotation import Annotation
from service.schemas.reading.documents import Part
from service.schemas.replies.summary import SolutionSummary
from service.storage.annotations import annotations_of, rewrite
from service.storage.database.database import Database
from service.storage.database.rows import instant, is_id, rows_of_page
from service.storage.jobs.finishing import solved
from service.storage.searching.pages import find
from service.storage.searching.sources import OF_SOLUTION_ROWS
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow


@dataclass(frozen=True, slots=True)
class Solution:
    """A solution without its arrays."""

    id: str
    job_id: str
    """The job that computed it; later jobs may have reused it."""
    problem: Part
    summary: SolutionSummary
    created_at: datetime
    annotation: Annotation


@dataclass(frozen=True, slots=True)
class SolutionPage:
    """Some of the solutions that match, in the order that was asked for."""

    solutions: tuple[Solution, ...]
    total: int | None
    """How many there are in all, if that was wanted."""
    values: tuple[tuple[Value | None, ...], ...] = ()
    """The wanted columns of each, in place of the solutions."""
    next: tuple[Value | None, ...] | None = None
    """Where the following page begins; None if there is none."""


class SolutionStore:
    """Reads solutions from the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, solution_id: str) -> Solution:
        """Return a solution, or raise :class:`SolutionNotFoundError`."""
        with self._database.read() as session:
            row = _row(session, solution_id)
            return solution_of(row, *annotations_of(session, [row]))

    def annotate(self, solution_id: str, change: Callable[[Solution], Annotation]) -> Solution:
        """Give a solution the labels and the note that ``change`` makes of those that it has.

        Nothing is changed if it raises. Raises :class:`SolutionNotFoundError`.
        """
        with self._database.write() as session:
            row = _row(session, solution_id, is_locked=True)
            solution = solution_of(row, *annotations_of(session, [row]))
            annotation = change(solution)
            rewrite(session, row, annotation, solution.annotation.labels)
            return replace(solution, annotation=annotation)

    def of_problem(self, digest: str) -> str | None:
        """Return the id of the first solution of the problem with this digest, None if there is none."""
        with self._database.read() as session:
            return solved(session.connection(), [digest], hold=False).get(digest)

    def find(self, query: ListQuery) -> SolutionPage:
        """Return one page of the solutions that match; only the wanted columns, if there are any."""
        with self._database.search() as session:
            found = find(session, OF_SOLUTION_ROWS, query)
            rows = [] if query.columns else rows_of_page(session, SolutionRow, found.ids)
            solutions = tuple(map(solution_of, rows, annotations_of(session, rows)))
            return SolutionPage(solutions, found.total, found.values, found.next)

    def dense(self, solution_id: str) -> bytes:
        """Return the encoded dense output, or raise :class:`SolutionNotFoundError`."""
        return self._data(DenseOutputRow, solution_id)

    def samples(self, solution_id: str) -> bytes:
        """Return the encoded samples, or raise :class:`SolutionNotFoundError`; retention may delete them."""
        return self._data(SamplesRow, solution_id)

    def samples_if_kept(self, solution_id: str) -> bytes | None:
        """Return the encoded samples; None if there are none any more."""
        try:
            return self._data(SamplesRow, solution_id)
        except SolutionNotFoundError:
            return None

    def _data(self, table: type[DenseOutputRow] | type[SamplesRow], solution_id: str) -> bytes:
        if not is_id(solution_id):
            raise SolutionNotFoundError(solution_id)
        with self._database.read() as session:
            data = session.scalar(select(table.data).where(table.solution_id == solution_id))
        if data is None:
            raise SolutionNotFoundError(solution_id)
        return data


def _row(session: Session, solution_id: str, *, is_locked: bool = False) -> SolutionRow:
    row = session.get(SolutionRow, solution_id, with_for_update=is_locked) if is_id(solution_id) else None
    if row is None:
        raise SolutionNotFoundError(solution_id)
    return row


def solution_of(row: SolutionRow, annotation: Annotation) -> Solution:
    """Return the record of a row."""
    return Solution(
        id=row.id,
        job_id=row.job_id,
        problem=row.problem,
        summary=row.summary,
        created_at=instant(row.created_at),
        annotation=annotation,
    )
