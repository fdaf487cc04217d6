"""The guarded UPDATEs that change a job's state, within the caller's transaction.

The guard comes from the table of legal moves; a worker's UPDATE also requires its
claim. The number of changed rows tells whether the move happened: nothing is read
first and written afterwards.
"""

import random
from collections.abc import Sequence

from sqlalchemy import ColumnElement, exists, func, or_, select, update
from sqlalchemy.orm import Session

from service.jobs.records import (
    FINISHED,
    MOST_DOUBTS,
    Attempt,
    AttemptOutcome,
    Claim,
    JobState,
    after_loss,
    pause_after,
    sources,
)
from service.schemas.reading.documents import Document, instant_text
from service.storage.database.rows import database_now
from service.storage.jobs.records import attempt_of
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import AttemptRow, JobRow

BEGUN = "its child has begun"
"""Detail of an attempt at a job that is computed alone, while it runs: then the loss of its worker counts."""
_JOBS = table_of(JobRow)


def may_become(target: JobState) -> ColumnElement[bool]:
    """Return the guard of every move to ``target``."""
    # OR instead of IN: SQLAlchemy expands the list of an IN at each execution.
    return or_(*(_JOBS.c.state == state.value for state in sources(target)))


def fence(claim: Claim) -> tuple[ColumnElement[bool], ...]:
    """Return the condition for a worker's write: the job still runs under its claim."""
    return (
        JobRow.id == claim.job_id,
        JobRow.state == JobState.RUNNING.value,
        JobRow.owner == claim.worker,
        JobRow.attempt == claim.attempt,
    )


def move(session: Session, target: JobState, *guard: ColumnElement[bool], **values: object) -> bool:
    """Move a job to ``target`` if the table of legal moves and ``guard`` allow; end its lease."""
    if target in FINISHED:
        values["finished_at"] = DatabaseNow()
    statement = (
        update(JobRow)
        .where(may_become(target), *guard)
        .values(state=target.value, owner=None, lease_until=None, **values)
        .returning(JobRow.id)
        .execution_options(synchronize_session=False)
    )
    return session.scalar(statement) is not None


def end_attempt(
    session: Session,
    job_id: str,
    number: int,
    outcome: AttemptOutcome,
    detail: str | None = None,
    *,
    at: float | None = None,
) -> None:
    """Write how a running attempt ended, now or ``at`` an instant; one that has ended is left alone."""
    session.execute(
        update(AttemptRow)
        .where(AttemptRow.job_id == job_id, AttemptRow.number == number, AttemptRow.ended_at.is_(None))
        .values(
            ended_at=DatabaseNow() if at is None else at,
            outcome=outcome.value,
            detail=detail and detail[:512],
        )
        .execution_options(synchronize_session=False)
    )


def lose(
    session: Session,
    guard: Sequence[ColumnElement[bool]],
    attempt: tuple[str, int],
    detail: str,
    max_attempts: int,
    retry_seconds: float,
    *,
    has_begun: bool,
) -> bool:
    """Requeue a job whose worker or child died, or fail it with its history as the error.

    ``attempt`` is the job's id and the number of the attempt; ``guard`` says
    when it is lost. If it may not ``has_begun``, that is not counted where others may be to
    blame; it is computed alone from then on.
    """
    job_id, number = attempt
    if not has_begun and _is_in_doubt(session, attempt):
        if not move(session, JobState.QUEUED, *guard, alone=True):
            return False
        end_attempt(session, job_id, number, AttemptOutcome.RETURNED, detail)
        return True
    lost = AttemptRow.job_id == job_id, AttemptRow.outcome == AttemptOutcome.LOST.value
    losses = 1 + (session.scalar(select(func.count()).select_from(AttemptRow).where(*lost)) or 0)
    target = after_loss(losses, max_attempts)
    pause = pause_after(losses, retry_seconds, random.uniform(-1.0, 1.0))
    now = database_now(session)
    if not move(session, target, *guard, alone=True, ready_at=now + pause):
        return False
    end_attempt(session, job_id, number, AttemptOutcome.LOST, detail, at=now)
    if target is JobState.FAILED:
        error = _lost_worker_error(history(session, job_id), losses)
        session.execute(update(JobRow).where(JobRow.id == job_id).values(error=error))
    return True


def _is_in_doubt(session: Session, attempt: tuple[str, int]) -> bool:
    """Tell whether others than this job may be to blame for the loss of its worker.

    It was not alone with its child; or its child is not known to have begun, or its worker had other jobs
    beside it, and has not for too many times.
    """
    row = (
        select(JobRow.alone, AttemptRow.worker, AttemptRow.started_at, AttemptRow.detail)
        .join_from(AttemptRow, JobRow, JobRow.id == AttemptRow.job_id)
        .where(AttemptRow.job_id == attempt[0], AttemptRow.number == attempt[1])
    )
    found = session.execute(row).one_or_none()
    if found is None or not found.alone:
        return found is not None  # else it is gone, with all that is known of it
    worker, began = found.worker, found.started_at
    returned = AttemptRow.outcome == AttemptOutcome.RETURNED.value
    doubts = select(func.count()).select_from(AttemptRow).where(AttemptRow.job_id == attempt[0], returned)
    beside = JobRow.owner == worker, JobRow.id != attempt[0]
    unended = or_(returned, AttemptRow.outcome == AttemptOutcome.LOST.value)
    since = AttemptRow.worker == worker, AttemptRow.job_id != attempt[0], AttemptRow.ended_at >= began
    return (session.scalar(doubts) or 0) < MOST_DOUBTS and (
        found.detail != BEGUN
        or bool(session.scalar(select(or_(exists().where(*beside), exists().where(*since, unended)))))
    )


def history(session: Session, job_id: str) -> tuple[Attempt, ...]:
    """Return the attempts at a job, oldest first."""
    statement = select(AttemptRow).where(AttemptRow.job_id == job_id).order_by(AttemptRow.number)
    return tuple(attempt_of(row) for row in session.scalars(statement))


def _lost_worker_error(history: Sequence[Attempt], losses: int) -> Document:
    return {
        "code": "lost_worker",
        "detail": f"{losses} workers or their child processes died at this job; it is not tried again",
        "attempts": [
            {
                "attempt": attempt.number,
                "worker": attempt.worker,
                "started_at": instant_text(attempt.started_at),
                "ended_at": attempt.ended_at and instant_text(attempt.ended_at),
                "outcome": attempt.outcome,
                "detail": attempt.detail,
            }
            for attempt in history
        ],
    }
