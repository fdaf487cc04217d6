"""Finds the jobs and sweeps that have changed, for those who follow them.

Every write of such a row sets ``changed_at`` by the database's clock. A transaction is
seen only when it is committed, which may be later than a change that was written
after it: whoever reads what is new looks back by ``SETTLED_SECONDS``, and passes
over what it has reported already.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import and_, literal_column, or_, select
from sqlalchemy.orm import Session

from service.jobs.records import Job
from service.storage.database.database import Database
from service.storage.database.rows import database_now
from service.storage.jobs.records import jobs_of
from service.storage.tables.jobs import JobRow
from service.storage.tables.sweeps import SweepRow

SETTLED_SECONDS = 5.0
"""A transaction that changes a job or a sweep is committed, or rolled back, after this time."""
_TOGETHER = 500
"""Ids in one statement: databases limit its parameters."""


class Followable(StrEnum):
    """The kinds of resources that can be followed."""

    JOB = "job"
    SWEEP = "sweep"


@dataclass(frozen=True, slots=True, order=True)
class LastChange:
    """The last change of a job or a sweep; in the order of time."""

    at: float
    id: str
    kind: Followable


_ROWS: Mapping[Followable, type[JobRow | SweepRow]] = {Followable.JOB: JobRow, Followable.SWEEP: SweepRow}
# A literal, not a parameter, so that SQLite can use the partial index.
_NO_CHUNK = JobRow.kind == literal_column("'solve'")


class ChangeReader:
    """Reads the last changes. Thread-safe."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def now(self) -> float:
        """Return the time of the database's clock."""
        with self._database.read() as session:
            return database_now(session)

    def of(self, kind: Followable, ids: Collection[str]) -> dict[str, float]:
        """Return when each of these last changed; those that are gone are left out."""
        row, wanted = _ROWS[kind], list(ids)
        found: dict[str, float] = {}
        with self._database.read() as session:
            for start in range(0, len(wanted), _TOGETHER):
                some = row.id.in_(wanted[start : start + _TOGETHER])
                found.update(
                    (each, at) for each, at in session.execute(select(row.id, row.changed_at).where(some))
                )
        return found

    def since(self, at: float) -> tuple[float, list[LastChange]]:
        """Return the time, and all that changed after ``at``, or after that time if it is earlier.

        Both less ``SETTLED_SECONDS``. The clock may have been set back.
        """
        with self._database.read() as session:
            now = database_now(session)
            return now, _read(session, (min(at, now) - SETTLED_SECONDS, None), None)

    def page(self, after: tuple[float, str | None], limit: int) -> list[LastChange]:
        """Return the first ``limit`` changes after that instant, or those at that instant with larger ids."""
        with self._database.read() as session:
            return _read(session, after, limit)

    def jobs(self, ids: Sequence[str]) -> list[tuple[float, Job]]:
        """Return jobs, and when they last changed; those that are gone are left out."""
        found: list[tuple[float, Job]] = []
        with self._database.read() as session:
            for start in range(0, len(ids), _TOGETHER):
                some = select(JobRow).where(JobRow.id.in_(ids[start : start + _TOGETHER]))
                rows = session.scalars(some).all()
                found += zip((row.changed_at for row in rows), jobs_of(session, rows), strict=True)
        return found


def _read(session: Session, after: tuple[float, str | None], limit: int | None) -> list[LastChange]:
    at, last = after
    changes: list[LastChange] = []
    for kind, row in _ROWS.items():
        later = row.changed_at > at
        if last:
            later = and_(row.changed_at >= at, or_(row.changed_at > at, row.id > last))
        found = select(row.changed_at, row.id).where(later, *((_NO_CHUNK,) if kind is Followable.JOB else ()))
        if limit is not None:
            found = found.order_by(row.changed_at, row.id).limit(limit)
        changes += [LastChange(changed_at, row_id, kind) for changed_at, row_id in session.execute(found)]
    return sorted(changes)[:limit]
