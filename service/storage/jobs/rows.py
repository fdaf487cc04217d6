"""Rows of jobs and attempts: read as records of service.jobs, moved between states, found as changed.

A move is a guarded UPDATE within the caller's transaction. The guard comes from the table of legal moves; a
worker's UPDATE also requires its claim. The number of changed rows tells whether the move happened: nothing
is read first and written afterwards.

Every write of such a row sets ``changed_at`` by the database's clock. A transaction is
seen only when it is committed, which may be later than a change that was written
after it: whoever reads what is new looks back by ``SETTLED_SECONDS``, and passes
over what it has reported already.
"""

import random
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

from sqlalchemy import ColumnElement, and_, exists, func, literal_column, or_, select, update
from sqlalchemy.orm import Session

from service.jobs.records import (
    FINISHED,
    MOST_DOUBTS,
    Attempt,
    AttemptOutcome,
    Claim,
    Job,
    JobKind,
    JobPage,
    JobState,
    after_loss,
    pause_after,
    sources,
)
from service.schemas.query.terms import ListQuery
from service.schemas.reading.documents import Annotation, Document, instant_text
from service.storage.annotations import annotations_of
from service.storage.database.database import Database
from service.storage.database.rows import database_now, instant, optional_instant, rows_of_page
from service.storage.searching.pages import find
from service.storage.searching.sources import Source
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import AttemptRow, JobRow, ResultRow
from service.storage.tables.solutions import SweepRow


def jobs_of(session: Session, rows: Sequence[JobRow]) -> tuple[Job, ...]:
    """Return the records of jobs, with their labels and the answers of studies."""
    made_by = [row.id for row in rows if row.kind == JobKind.STUDY.value and row.finished_at is not None]
    results: dict[str, Document] = {}
    if made_by:
        # A worker, which finishes jobs and shows none, loads no arrays.
        from service.storage.codecs.packing import decode_document  # noqa: PLC0415

        columns = select(ResultRow.job_id, ResultRow.data).where(ResultRow.job_id.in_(made_by))
        results = {job_id: decode_document(data) for job_id, data in session.execute(columns)}
    annotations = annotations_of(session, rows)
    return tuple(
        job_of(row, annotation, results.get(row.id))
        for row, annotation in zip(rows, annotations, strict=True)
    )


def job_of(row: JobRow, annotation: Annotation, result: Document | None = None) -> Job:
    """Return the record of a job, whose labels and result are in other tables."""
    return Job(
        id=row.id,
        state=JobState(row.state),
        priority=row.priority,
        attempt=row.attempt,
        progress=row.progress,
        error=row.error,
        reused=row.reused,
        solution_id=row.solution_id,
        problem=row.problem,
        digest=row.digest,
        created_at=instant(row.created_at),
        started_at=optional_instant(row.started_at),
        finished_at=optional_instant(row.finished_at),
        key_id=row.key_id,
        annotation=annotation,
        kind=JobKind(row.kind),
        result=result,
    )


def attempt_of(row: AttemptRow) -> Attempt:
    """Return the record of one try."""
    return Attempt(
        number=row.number,
        worker=row.worker,
        started_at=instant(row.started_at),
        ended_at=optional_instant(row.ended_at),
        outcome=None if row.outcome is None else AttemptOutcome(row.outcome),
        detail=row.detail,
    )


def page_of_jobs(database: Database, source: Source, query: ListQuery) -> JobPage:
    """Return one page of the jobs that match; only the wanted columns of them, if there are any."""
    with database.search() as session:
        found = find(session, source, query)
        rows = [] if query.columns else rows_of_page(session, JobRow, found.ids)
        return JobPage(jobs_of(session, rows), found.total, found.values, found.next)


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
