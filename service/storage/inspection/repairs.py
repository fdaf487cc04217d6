"""Repairs violated invariants of jobs and results without losing anything.

A repair is given the query for the violating rows and runs it again inside its own
transaction, so that rows which are valid by then are left alone.
"""

from collections.abc import Callable
from typing import Any  # the row type does not matter for a count

from sqlalchemy import (
    ColumnElement,
    Delete,
    Select,
    Table,
    Update,
    and_,
    case,
    delete,
    exists,
    func,
    not_,
    select,
    update,
)
from sqlalchemy.orm import Session

from service.jobs.records import AttemptOutcome, JobState
from service.storage.database.database import Database
from service.storage.jobs.moves import end_attempt, move
from service.storage.tables.base import DatabaseNow
from service.storage.tables.jobs import AttemptRow, AuditRow, JobRow, ResultRow

Broken = Select[str]
"""Selects the ids of the rows that violate an invariant."""
Repair = Callable[[Database, Broken], int]
"""Repairs them; returns how many."""

_OUTCOME = {
    JobState.SUCCEEDED: AttemptOutcome.SUCCEEDED,
    JobState.FAILED: AttemptOutcome.FAILED,
    JobState.CANCELLED: AttemptOutcome.CANCELLED,
}
"""The outcome of the last attempt, by the state of a finished job."""


def delete_orphans(table: Table, reference: ColumnElement[str]) -> Repair:
    """Return a repair that deletes the rows whose ``reference`` points to a missing row."""

    def repair(database: Database, broken: Broken) -> int:
        with database.write() as session:
            return _changed(session, delete(table).where(reference.in_(broken)))

    return repair


def compute_again(database: Database, broken: Broken) -> int:
    """Requeue the jobs that have succeeded but whose solutions are missing."""
    return _queue(database, JobRow.solution_id.in_(broken), solution_id=None, reused=False)


def make_again(database: Database, broken: Broken) -> int:
    """Requeue the jobs that have succeeded but whose atlases, or answers, are missing."""
    return _queue(database, JobRow.id.in_(broken))


def _queue(database: Database, condition: ColumnElement[bool], **values: object) -> int:
    anew = {"state": JobState.QUEUED.value, "progress": 0.0, "finished_at": None}
    with database.write() as session:
        return _changed(session, update(JobRow).where(condition).values(**anew, **values))


def date_ends(database: Database, broken: Broken) -> int:
    """Set the end of finished jobs to that of their last attempt, and clear it for the others."""
    last = select(func.max(AttemptRow.ended_at)).where(AttemptRow.job_id == JobRow.id).scalar_subquery()
    ended = case((JobRow.finished_at.is_(None), func.coalesce(last, DatabaseNow())), else_=None)
    with database.write() as session:
        return _changed(session, update(JobRow).where(JobRow.id.in_(broken)).values(finished_at=ended))


def open_attempts() -> ColumnElement[bool]:
    """Return the condition that an attempt has no end and is not the current one of its job."""
    is_present = and_(
        JobRow.id == AttemptRow.job_id,
        JobRow.state == JobState.RUNNING.value,
        JobRow.attempt == AttemptRow.number,
    )
    return and_(AttemptRow.ended_at.is_(None), not_(exists().where(is_present)))


def end_attempts(database: Database, broken: Broken) -> int:
    """End abandoned attempts: the last one of a job with the job's outcome, the others as returned."""
    outcome = case(
        *(
            (exists().where(_is_last(), JobRow.state == state.value), outcome.value)
            for state, outcome in _OUTCOME.items()
        ),
        # Nobody knows whether it had begun.
        else_=AttemptOutcome.RETURNED.value,
    )
    values = {"ended_at": DatabaseNow(), "outcome": outcome}
    statement = update(AttemptRow).where(AttemptRow.job_id.in_(broken), open_attempts()).values(**values)
    with database.write() as session:
        return _changed(session, statement)


def forget_comparisons(database: Database, broken: Broken) -> int:
    """Remove the comparisons of audits."""
    with database.write() as session:
        return _changed(session, update(AuditRow).where(AuditRow.job_id.in_(broken)).values(comparison=None))


def forget_results(database: Database, broken: Broken) -> int:
    """Remove atlases and answers of studies."""
    with database.write() as session:
        return _changed(session, delete(ResultRow).where(ResultRow.job_id.in_(broken)))


def release_leases(database: Database, broken: Broken) -> int:
    """Requeue the jobs whose workers are gone."""
    with database.read() as session:
        found = session.execute(select(JobRow.id, JobRow.attempt).where(JobRow.id.in_(broken))).all()
    released = 0
    for job_id, attempt in found:
        still = JobRow.id == job_id, JobRow.attempt == attempt, JobRow.id.in_(broken)
        with database.write() as session:
            if move(session, JobState.QUEUED, *still, alone=True):
                why = "its lease was released by hand"
                end_attempt(session, job_id, attempt, AttemptOutcome.RETURNED, why)
                released += 1
    return released


def _is_last() -> ColumnElement[bool]:
    return and_(JobRow.id == AttemptRow.job_id, JobRow.attempt == AttemptRow.number)


def _changed(session: Session, statement: Update | Delete) -> int:
    result: Any = session.execute(statement.execution_options(synchronize_session=False))
    return int(result.rowcount)
