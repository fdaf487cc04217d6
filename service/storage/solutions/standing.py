"""Tells what a stored solution is without reading its documents or arrays."""

from dataclasses import dataclass
from functools import cache
from typing import Any  # the types of the columns of a table that is not mapped

from sqlalchemy import Select, bindparam, exists, select
from sqlalchemy.orm import load_only

from service.jobs.errors import SolutionNotFoundError
from service.schemas.reading.marks import Marks
from service.storage.database.database import Database
from service.storage.database.ids import is_id
from service.storage.marks.mark_rows import marks_of
from service.storage.tables.base import table_of
from service.storage.tables.solutions import SamplesRow, SolutionRow

_SOLUTIONS, _SAMPLES = table_of(SolutionRow), table_of(SamplesRow)


@dataclass(frozen=True, slots=True)
class SolutionStanding:
    """What decides which bytes an answer about a solution has."""

    id: str
    digest: str
    """Of the problem and the numerics version that solved it."""
    has_samples: bool
    """False once retention has deleted them: made again, they may differ in their last digits."""


def marks_of_solution(database: Database, solution_id: str) -> Marks:
    """Return the labels and the note of a solution, or raise :class:`SolutionNotFoundError`."""
    note = select(SolutionRow).options(load_only(SolutionRow.id, SolutionRow.note))
    with database.read() as session:
        row = session.scalar(note.where(SolutionRow.id == solution_id)) if is_id(solution_id) else None
        if row is None:
            raise SolutionNotFoundError(solution_id)
        (marks,) = marks_of(session, [row])
        return marks


def standing_of(database: Database, solution_id: str) -> SolutionStanding:
    """Return what a solution is, or raise :class:`SolutionNotFoundError`."""
    if not is_id(solution_id):
        raise SolutionNotFoundError(solution_id)
    with database.read_rows() as connection:
        found = connection.execute(_statement(), {"id": solution_id}).one_or_none()
    if found is None:
        raise SolutionNotFoundError(solution_id)
    return SolutionStanding(str(found[0]), found[1], bool(found[2]))


@cache
def _statement() -> Select[Any]:
    """Return the statement, which takes longer to build than to execute."""
    has_samples = exists().where(_SAMPLES.c.solution_id == _SOLUTIONS.c.id)
    return select(_SOLUTIONS.c.id, _SOLUTIONS.c.digest, has_samples).where(_SOLUTIONS.c.id == bindparam("id"))
