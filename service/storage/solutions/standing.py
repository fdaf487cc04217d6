"""Tells what a stored solution is without reading its documents or arrays."""

from dataclasses import dataclass
from functools import cache
from typing import Any  # the types of the columns of a table that is not mapped

from sqlalchemy import Connection, Select, bindparam, exists, select

from service.jobs.records import SolutionNotFoundError
from service.schemas.reading.annotation import Annotation
from service.storage.database.database import Database
from service.storage.database.rows import is_id
from service.storage.tables.base import table_of
from service.storage.tables.labels import SolutionLabelRow
from service.storage.tables.solutions import SamplesRow, SolutionRow

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
