"""Finds solutions by their numbers and reads them, with or without their arrays.

:mod:`service.storage.jobs.job_store` writes a solution only together with the success
of its job; so every stored solution comes from a succeeded job.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal, get_args

from sqlalchemy import ColumnElement, Select, func, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from service.jobs.errors import SolutionNotFoundError
from service.storage.database.clock import instant
from service.storage.database.database import Database
from service.storage.database.ids import is_id
from service.storage.database.paging import rows_of_page
from service.storage.jobs.finishing import solved
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow

Condition = ColumnElement[bool]
NumberColumn = Literal["A", "C", "period", "energy", "error"]
SortColumn = Literal["created_at", "A", "C", "period", "energy", "error"]
SORT_COLUMNS: tuple[SortColumn, ...] = get_args(SortColumn)
NUMBER_COLUMNS: tuple[NumberColumn, ...] = get_args(NumberColumn)


@dataclass(frozen=True, slots=True)
class Solution:
    """A solution without its arrays."""

    id: str
    job_id: str
    """The job that computed it; later jobs may have reused it."""
    problem: Mapping[str, object]
    summary: Mapping[str, object]
    created_at: datetime


@dataclass(frozen=True, slots=True)
class NumberRange:
    """lower ≤ x ≤ upper; None is no bound. A missing number is in no interval."""

    lower: float | None = None
    upper: float | None = None


@dataclass(frozen=True, slots=True)
class SolutionQuery:
    """Which solutions, in which order. Every condition must hold; None is no condition."""

    job_id: str | None = None
    family: str | None = None
    method: str | None = None
    tier: str | None = None
    intervals: Mapping[NumberColumn, NumberRange] = field(default_factory=dict)
    sort: SortColumn = "created_at"
    descending: bool = True
    """Solutions without the number come last either way."""
    limit: int = 50
    offset: int = 0


@dataclass(frozen=True, slots=True)
class SolutionPage:
    """Some of the solutions that match, and how many match in all."""

    solutions: tuple[Solution, ...]
    total: int


class SolutionStore:
    """Reads solutions from the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, solution_id: str) -> Solution:
        """Return a solution, or raise :class:`SolutionNotFoundError`."""
        if not is_id(solution_id):
            raise SolutionNotFoundError(solution_id)
        with self._database.read() as session:
            row = session.get(SolutionRow, solution_id)
            if row is None:
                raise SolutionNotFoundError(solution_id)
            return _solution_of(row)

    def of_problem(self, digest: str) -> str | None:
        """Return the id of the first solution of the problem with this digest, None if there is none."""
        with self._database.read() as session:
            return solved(session.connection(), [digest], hold=False).get(digest)

    def find(self, query: SolutionQuery) -> SolutionPage:
        """Return one page of the solutions that match."""
        conditions = _conditions(query)
        with self._database.read() as session:
            total = session.scalar(select(func.count()).select_from(SolutionRow).where(*conditions)) or 0
            rows = _rows(session, query, conditions)
            return SolutionPage(tuple(map(_solution_of, rows)), total)

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


def _conditions(query: SolutionQuery) -> list[Condition]:
    conditions: list[Condition] = []
    if query.job_id is not None:
        conditions.append(
            SolutionRow.job_id == query.job_id if is_id(query.job_id) else SolutionRow.id.is_(None)
        )
    if query.family is not None:
        conditions.append(SolutionRow.family == query.family)
    if query.method is not None:
        conditions.append(SolutionRow.method == query.method)
    if query.tier is not None:
        conditions.append(SolutionRow.tier == query.tier)
    for name, interval in query.intervals.items():
        if interval.lower is not None:
            conditions.append(_column(name) >= interval.lower)
        if interval.upper is not None:
            conditions.append(_column(name) <= interval.upper)
    return conditions


def _rows(session: Session, query: SolutionQuery, conditions: Sequence[Condition]) -> list[SolutionRow]:
    """Return the rows of a page: first of the solutions with the number, then of those without.

    Databases put nulls at different ends of an index, and no single index gives
    "nulls last" in both directions; each of the two parts can use an index.
    """
    key = _column(query.sort)
    if query.sort == "created_at":
        return rows_of_page(session, SolutionRow, _ids(query, conditions, query.offset, query.limit))
    known = [*conditions, key.is_not(None)]
    rows = rows_of_page(session, SolutionRow, _ids(query, known, query.offset, query.limit))
    missing = query.limit - len(rows)
    if not missing or query.sort in query.intervals:
        # A solution without the number is outside every interval.
        return rows
    before = query.offset + len(rows)
    if not rows and query.offset:
        before = session.scalar(select(func.count()).select_from(SolutionRow).where(*known)) or 0
    skipped = max(0, query.offset - before)
    unknown = [*conditions, key.is_(None)]
    return [*rows, *rows_of_page(session, SolutionRow, _ids(query, unknown, skipped, missing))]


def _ids(query: SolutionQuery, conditions: Sequence[Condition], offset: int, limit: int) -> Select[str]:
    key = _column(query.sort)
    order = (key.desc(), SolutionRow.id.desc()) if query.descending else (key.asc(), SolutionRow.id.asc())
    return select(SolutionRow.id).where(*conditions).order_by(*order).limit(limit).offset(offset)


def _column(name: SortColumn) -> InstrumentedAttribute[float] | InstrumentedAttribute[float | None]:
    columns: dict[SortColumn, InstrumentedAttribute[float] | InstrumentedAttribute[float | None]] = {
        "created_at": SolutionRow.created_at,
        "A": SolutionRow.A,
        "C": SolutionRow.C,
        "period": SolutionRow.period,
        "energy": SolutionRow.energy,
        "error": SolutionRow.error,
    }
    return columns[name]


def _solution_of(row: SolutionRow) -> Solution:
    return Solution(
        id=row.id,
        job_id=row.job_id,
        problem=row.problem,
        summary=row.summary,
        created_at=instant(row.created_at),
    )
