"""Finds solutions by their numbers and reads them, with or without their arrays, and where they come from.

:mod:`service.storage.jobs.job_store` writes a solution only together with the success
of its job; so every stored solution comes from a succeeded job.
What a solution is, its standing, is also read without loading its documents or arrays.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cache
from typing import Any  # the types of the columns of a table that is not mapped

from sqlalchemy import Connection, Select, bindparam, exists, select
from sqlalchemy.orm import Session

from service.jobs.records import Attempt, SolutionNotFoundError
from service.schemas.query.terms import ListQuery, Value
from service.schemas.reading.documents import Annotation, Part
from service.schemas.replies.summary import SolutionSummary
from service.storage.annotations import annotations_of, rewrite
from service.storage.database.database import Database
from service.storage.database.rows import instant, is_id, rows_of_page
from service.storage.jobs.finishing import solved
from service.storage.jobs.rows import history
from service.storage.searching.pages import find
from service.storage.searching.sources import OF_SOLUTION_ROWS
from service.storage.tables.base import table_of
from service.storage.tables.jobs import JobRow, SolutionLabelRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow

_SOLUTIONS, _SAMPLES, _LABELS = table_of(SolutionRow), table_of(SamplesRow), table_of(SolutionLabelRow)


@dataclass(frozen=True, slots=True)
class SolutionStanding:
    """The facts that decide which bytes an answer about a solution has."""

    id: str
    digest: str
    """Hash of the problem and of the numerics version that solved it."""
    has_samples: bool
    """False once retention has deleted them: made again, they may differ in their last digits."""


def standing_of(database: Database, solution_id: str) -> SolutionStanding:
    """Return what a solution is, or raise :class:`SolutionNotFoundError`."""
    _require_id(solution_id)
    with database.read_rows() as connection:
        return _found(connection, solution_id)[0]


def standing_and_annotation(database: Database, solution_id: str) -> tuple[SolutionStanding, Annotation]:
    """Return what a solution is, with its labels and its note, or raise :class:`SolutionNotFoundError`."""
    _require_id(solution_id)
    with database.read_rows() as connection:
        standing, note = _found(connection, solution_id)
        labels = connection.execute(_labels(), {"id": solution_id}).all()
    return standing, Annotation(dict(sorted((key, value) for key, value in labels)), note)


def _require_id(solution_id: str) -> None:
    """Refuse what is no id without asking the database."""
    if not is_id(solution_id):
        raise SolutionNotFoundError(solution_id)


def _found(connection: Connection, solution_id: str) -> tuple[SolutionStanding, str | None]:
    found = connection.execute(_statement(), {"id": solution_id}).one_or_none()
    if found is None:
        raise SolutionNotFoundError(solution_id)
    return SolutionStanding(str(found[0]), found[1], bool(found[2])), found[3]


@cache
def _statement() -> Select[Any]:
    """Return the statement, which takes longer to build than to execute."""
    has_samples = exists().where(_SAMPLES.c.solution_id == _SOLUTIONS.c.id)
    columns = _SOLUTIONS.c.id, _SOLUTIONS.c.digest, has_samples, _SOLUTIONS.c.note
    return select(*columns).where(_SOLUTIONS.c.id == bindparam("id"))


@cache
def _labels() -> Select[Any]:
    return select(_LABELS.c.key, _LABELS.c.value).where(_LABELS.c.solution_id == bindparam("id"))


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
