"""Deletes jobs, solutions and sweeps with all that belongs to them; one function is one transaction."""

from sqlalchemy import ColumnElement, and_, delete, func, or_, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from service.jobs.records import (
    FINISHED,
    SUBMITTED,
    InUseError,
    JobNotFoundError,
    JobState,
    SolutionNotFoundError,
    StillAtWorkError,
    SweepNotFoundError,
)
from service.storage.database.database import Database
from service.storage.database.rows import is_id
from service.storage.jobs import chunks
from service.storage.keys.key_store import charge
from service.storage.tables.jobs import AuditRow, JobRow, ResultRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow
from service.storage.tables.sweeps import SweepChunkRow, SweepRow

_MOST_TOLD = 100
"""Jobs that are named when they keep a solution from being deleted."""


def delete_job(database: Database, job_id: str) -> None:
    """Delete a finished job, its attempts, and the atlas that it has drawn, which is no longer charged.

    Raises
    ------
    InUseError
        A solution comes from it: deleting the solution deletes the job, too.
    StillAtWorkError, JobNotFoundError
    """
    with database.write() as session:
        row = None
        if is_id(job_id):
            row = session.scalar(
                select(JobRow).where(JobRow.id == job_id, JobRow.kind.in_(SUBMITTED)).with_for_update()
            )
        if row is None:
            raise JobNotFoundError(job_id)
        _require_end("job", row.id, JobState(row.state))
        if own := session.scalar(select(SolutionRow.id).where(SolutionRow.job_id == row.id)):
            raise InUseError(f"job {row.id}", [f"/v1/solutions/{own}"], 1)
        size, key_id = _bytes_of(session, ResultRow.data, ResultRow.job_id == row.id), row.key_id
        session.execute(delete(JobRow).where(JobRow.id == row.id))
        charge(session.connection(), key_id, -size)


def delete_solution(database: Database, solution_id: str) -> None:
    """Delete a solution, its arrays and the job that computed it; its bytes are no longer charged.

    Raises
    ------
    InUseError
        Later jobs have reused it, or a live one audits it.
    SolutionNotFoundError
    """
    with database.write() as session:
        row = None
        if is_id(solution_id):
            # Locked: whoever is about to reuse it waits, and finds that it is gone.
            row = session.execute(
                select(SolutionRow.id, SolutionRow.job_id)
                .where(SolutionRow.id == solution_id)
                .with_for_update()
            ).one_or_none()
        if row is None:
            raise SolutionNotFoundError(solution_id)
        audits = select(AuditRow.job_id).where(AuditRow.solution_id == row.id)
        is_audit = and_(JobRow.id.in_(audits), JobRow.finished_at.is_(None))
        others = or_(JobRow.solution_id == row.id, is_audit), JobRow.id != row.job_id
        if count := session.scalar(select(func.count()).select_from(JobRow).where(*others)):
            found = session.scalars(select(JobRow.id).where(*others).order_by(JobRow.id).limit(_MOST_TOLD))
            raise InUseError(f"solution {row.id}", [f"/v1/jobs/{job_id}" for job_id in found], count)
        size = sum(
            _bytes_of(session, table.data, table.solution_id == row.id)
            for table in (DenseOutputRow, SamplesRow)
        )
        key_id = session.scalar(select(JobRow.key_id).where(JobRow.id == row.job_id))
        session.execute(delete(JobRow).where(JobRow.id == row.job_id))
        session.execute(delete(SolutionRow).where(SolutionRow.id == row.id))
        charge(session.connection(), key_id, -size)


def delete_sweep(database: Database, sweep_id: str) -> None:
    """Delete a finished sweep, its points and its chunks; its bytes are no longer charged.

    Raises
    ------
    StillAtWorkError, SweepNotFoundError
    """
    with database.write() as session:
        row = chunks.hold(session, sweep_id) if is_id(sweep_id) else None
        if row is None:
            raise SweepNotFoundError(sweep_id)
        _require_end("sweep", row.id, JobState(row.state))
        stored = select(func.sum(func.length(SweepChunkRow.data))).where(SweepChunkRow.sweep_id == row.id)
        size, key_id = session.scalar(stored) or 0, row.key_id
        session.execute(
            delete(SweepRow).where(SweepRow.id == row.id).execution_options(synchronize_session=False)
        )
        charge(session.connection(), key_id, -int(size))


def key_of_solution(database: Database, solution_id: str) -> str | None:
    """Return the key that submitted the job that a solution comes from; None if that is not known.

    Raises
    ------
    SolutionNotFoundError
    """
    statement = (
        select(SolutionRow.id, JobRow.key_id)
        .outerjoin(JobRow, JobRow.id == SolutionRow.job_id)
        .where(SolutionRow.id == solution_id)
    )
    with database.read() as session:
        row = session.execute(statement).one_or_none() if is_id(solution_id) else None
    if row is None:
        raise SolutionNotFoundError(solution_id)
    return None if row.key_id is None else str(row.key_id)


def _bytes_of(session: Session, data: InstrumentedAttribute[bytes], condition: ColumnElement[bool]) -> int:
    return session.scalar(select(func.length(data)).where(condition)) or 0


def _require_end(kind: str, its_id: str, state: JobState) -> None:
    if state not in FINISHED:
        raise StillAtWorkError(kind, its_id, state)
