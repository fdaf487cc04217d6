"""Converts rows of jobs and attempts to the records of service.jobs, and reads pages of them."""

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.jobs.records import Attempt, AttemptOutcome, Job, JobKind, JobPage, JobState
from service.schemas.query.conditions import ListQuery
from service.schemas.reading.annotation import Annotation
from service.schemas.reading.documents import Document
from service.storage.annotations import annotations_of
from service.storage.database.database import Database
from service.storage.database.rows import instant, optional_instant, rows_of_page
from service.storage.searching.pages import find
from service.storage.searching.sources import Source
from service.storage.tables.jobs import AttemptRow, JobRow, ResultRow


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
