"""Converts rows of jobs and attempts to the records of service.jobs."""

from service.jobs.records import Attempt, AttemptOutcome, Job, JobKind, JobState
from service.jobs.store import Delivery
from service.schemas.reading.marks import Marks
from service.storage.database.clock import instant, optional_instant
from service.storage.tables.jobs import AttemptRow, JobRow


def job_of(row: JobRow, marks: Marks) -> Job:
    """Return the record of a job, whose labels are in another table."""
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
        marks=marks,
        kind=JobKind(row.kind),
    )


def delivery_of(row: JobRow) -> Delivery:
    """Return the delivery of a queued job, from which it may be claimed."""
    return Delivery(row.id, row.attempt, row.priority, row.ready_at)


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
