"""Converts rows of jobs and attempts to the records of service.jobs, and reads pages of them."""

from service.jobs.records import Attempt, AttemptOutcome, Job, JobKind, JobPage, JobState
from service.schemas.query.conditions import ListQuery
from service.schemas.reading.annotation import Annotation
from service.storage.annotations import annotations_of
from service.storage.database.database import Database
from service.storage.database.rows import instant, optional_instant, rows_of_page
from service.storage.searching.pages import find
from service.storage.searching.sources import Source
from service.storage.tables.jobs import AttemptRow, JobRow


def job_of(row: JobRow, annotation: Annotation) -> Job:
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
        annotation=annotation,
        kind=JobKind(row.kind),
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
        jobs = tuple(map(job_of, rows, annotations_of(session, rows)))
        return JobPage(jobs, found.total, found.values, found.next)
