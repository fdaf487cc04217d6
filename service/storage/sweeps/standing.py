"""Tells how far a sweep is without reading its document or its points."""

from dataclasses import dataclass
from functools import cache
from typing import Any  # the types of the columns of a table that is not mapped

from sqlalchemy import Select, bindparam, select

from service.jobs.records import SweepNotFoundError, SweepRecord
from service.storage.database.database import Database
from service.storage.database.ids import is_id
from service.storage.tables.base import table_of
from service.storage.tables.sweeps import SweepRow

_SWEEPS = table_of(SweepRow)


@dataclass(frozen=True, slots=True)
class SweepStanding:
    """The facts that decide which points there are: as long as the way is one, chunks are only ever added."""

    id: str
    done: int
    refused: int
    way: str | None
    is_finished: bool


def standing_in(record: SweepRecord) -> SweepStanding:
    """Return how far a sweep was when its record was read."""
    return SweepStanding(record.id, record.done, record.refused, record.way, record.finished_at is not None)


def sweep_standing_of(database: Database, sweep_id: str) -> SweepStanding:
    """Return how far a sweep is, or raise :class:`SweepNotFoundError`."""
    if not is_id(sweep_id):
        raise SweepNotFoundError(sweep_id)
    with database.read_rows() as connection:
        found = connection.execute(_statement(), {"id": sweep_id}).one_or_none()
    if found is None:
        raise SweepNotFoundError(sweep_id)
    return SweepStanding(str(found.id), found.done, found.refused, found.way, found.finished_at is not None)


@cache
def _statement() -> Select[Any]:
    """Return the statement, which takes longer to build than to execute."""
    columns = _SWEEPS.c.id, _SWEEPS.c.done, _SWEEPS.c.refused, _SWEEPS.c.way, _SWEEPS.c.finished_at
    return select(*columns).where(_SWEEPS.c.id == bindparam("id"))
