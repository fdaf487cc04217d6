"""From rows to the records that the rest of the program sees."""

from datetime import UTC, datetime

from service.jobs.job import Attempt, Claim, Job
from service.jobs.states import AttemptOutcome, JobState
from service.storage.tables import AttemptRow, JobRow


def instant(seconds: float) -> datetime:
    """Return the UTC instant of a stored number of seconds."""
    return datetime.fromtimestamp(seconds, UTC)


def optional_instant(seconds: float | None) -> datetime | None:
    """Return :func:`instant` of what may be missing."""
    return None if seconds is None else instant(seconds)


def job_of(row: JobRow) -> Job:
    """Return the record of a job."""
    return Job(
        id=row.id,
        state=JobState(row.state),
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
    )


def claim_of(row: JobRow) -> Claim:
    """Return the claim that a running job's row stands for."""
    if row.owner is None:
        raise ValueError(f"job {row.id} is {row.state}: nobody holds a claim on it")
    return Claim(job_id=row.id, attempt=row.attempt, worker=row.owner, problem=row.problem)


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
