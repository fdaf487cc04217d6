"""Stores the jobs that make documents (atlases, studies) or audits, and reads what they have made.

An audit solves the problem of a stored solution again; what is read is the comparison.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import select

from service.jobs.queue import Lane
from service.jobs.records import (
    AuditNotFoundError,
    Job,
    JobKind,
    JobPage,
    ResultNotFoundError,
    SolutionNotFoundError,
)
from service.schemas.query.terms import ListQuery, Value
from service.schemas.reading.documents import UNANNOTATED, Document, Part
from service.storage.codecs.packing import decode_document
from service.storage.database.database import Database
from service.storage.database.rows import is_id
from service.storage.examinations import CacheRow, Examination, store_rows
from service.storage.jobs.queue import announce, insert_jobs
from service.storage.jobs.rows import job_of, jobs_of, page_of_jobs
from service.storage.keys import Receipt, write_key
from service.storage.searching.sources import OF_ATLAS_ROWS, OF_STUDY_ROWS, audits_of
from service.storage.tables.base import table_of
from service.storage.tables.jobs import AuditRow, JobRow, ResultRow
from service.storage.tables.solutions import SolutionRow

_RESULTS, _JOBS = table_of(ResultRow), table_of(JobRow)
_ROWS = {JobKind.ATLAS: OF_ATLAS_ROWS, JobKind.STUDY: OF_STUDY_ROWS}
"""The jobs of each kind, for lists."""


class ResultStore:
    """Writes the jobs, and reads the documents."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def submit(
        self,
        kind: JobKind,
        document: Document,
        digest: str,
        *,
        priority: int = 0,
        key_id: str | None = None,
        receipt: Receipt[tuple[Job, ...]] | None = None,
    ) -> Job:
        """Store a job that makes what a valid ``document`` asks for; its lane is that of single problems.

        The rest is as :meth:`service.storage.jobs.job_store.JobStore.submit` takes it; nothing is reused.
        """
        with self._database.write() as session:
            (row,) = insert_jobs(
                session, [(document, digest)], lane=Lane.SINGLE, priority=priority, key_id=key_id, kind=kind
            )
            announce(self._database, session.connection())
            job = job_of(row, UNANNOTATED)
            if receipt is not None:
                write_key(session.connection(), receipt.given, receipt.answer((job,)))
            return job

    def get(self, kind: JobKind, its_id: str) -> Document:
        """Return what the job of that kind and id has made, or raise :class:`ResultNotFoundError`."""
        statement = select(ResultRow.data).join(JobRow, JobRow.id == ResultRow.job_id)
        of_job = JobRow.id == its_id, JobRow.kind == kind.value
        with self._database.read() as session:
            data = session.scalar(statement.where(*of_job)) if is_id(its_id) else None
        if data is None:
            raise ResultNotFoundError(kind, its_id)
        return decode_document(data)

    def find(self, kind: JobKind, query: ListQuery) -> JobPage:
        """Return one page of the jobs of that kind, asked like jobs."""
        return page_of_jobs(self._database, _ROWS[kind], query)


def known_atlas(database: Database, its_id: str) -> str:
    """Return the id of an atlas as it is stored, unread, or raise :class:`ResultNotFoundError`."""
    return _known(database, JobKind.ATLAS, its_id)


def known_study(database: Database, its_id: str) -> str:
    """Do the same for the answer of a study."""
    return _known(database, JobKind.STUDY, its_id)


def _known(database: Database, kind: JobKind, its_id: str) -> str:
    found = None
    if is_id(its_id):
        statement = select(_RESULTS.c.job_id).join(_JOBS, _JOBS.c.id == _RESULTS.c.job_id)
        with database.read_rows() as connection:
            found = connection.scalar(statement.where(_JOBS.c.id == its_id, _JOBS.c.kind == kind.value))
    if found is None:
        raise ResultNotFoundError(kind, its_id)
    return str(found)


@dataclass(frozen=True, slots=True)
class Audit:
    """A job that solves the problem of a stored solution again."""

    job: Job
    solution_id: str
    """The audited solution; the job's own is the new one."""
    comparison: Part | None
    """The comparison of the two solutions; None as long as there is no second one."""


@dataclass(frozen=True, slots=True)
class AuditPage:
    """Some audits of one solution, in the order that was asked for."""

    audits: tuple[Audit, ...]
    page: JobPage

    @property
    def total(self) -> int | None:
        """The number of all of them, if that was wanted."""
        return self.page.total

    @property
    def values(self) -> tuple[tuple[Value | None, ...], ...]:
        """The wanted columns of each, in place of the audits."""
        return self.page.values

    @property
    def next(self) -> tuple[Value | None, ...] | None:
        """The values at which the following page begins; None if there is none."""
        return self.page.next


class AuditStore:
    """Writes and reads audits."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def submit(
        self,
        solution_id: str,
        problem: Part,
        digest: str,
        *,
        priority: int = 0,
        key_id: str | None = None,
        examination: Examination | None = None,
        found: Sequence[CacheRow] = (),
        receipt: Receipt[tuple[Job, ...]] | None = None,
    ) -> Job:
        """Store a job that solves ``problem``, that of a solution or one like it, to compare the two.

        The rest is as :meth:`service.storage.jobs.job_store.JobStore.submit` takes it; nothing is reused.

        Raises
        ------
        SolutionNotFoundError
            There is no such solution, or none any more.
        """
        with self._database.write() as session:
            # Locked: it is not deleted before this job refers to it.
            held = select(SolutionRow.id).where(SolutionRow.id == solution_id)
            if session.scalar(held.with_for_update(read=True, key_share=True)) is None:
                raise SolutionNotFoundError(solution_id)
            store_rows(session.connection(), found)
            (row,) = insert_jobs(
                session,
                [(problem, digest)],
                lane=Lane.SINGLE,
                priority=priority,
                key_id=key_id,
                examinations=[examination],
                audited=solution_id,
            )
            announce(self._database, session.connection())
            job = job_of(row, UNANNOTATED)
            if receipt is not None:
                write_key(session.connection(), receipt.given, receipt.answer((job,)))
            return job

    def get(self, solution_id: str, audit_id: str) -> Audit:
        """Return an audit of a solution, or raise :class:`AuditNotFoundError`."""
        if is_id(solution_id) and is_id(audit_id):
            with self._database.read() as session:
                row = session.get(JobRow, audit_id)
                audit = session.get(AuditRow, audit_id)
                if row is not None and audit is not None and audit.solution_id == solution_id:
                    return Audit(jobs_of(session, [row])[0], solution_id, audit.comparison)
        raise AuditNotFoundError(solution_id, audit_id)

    def find(self, solution_id: str, query: ListQuery) -> AuditPage:
        """Return one page of the audits of a solution that match, asked like jobs."""
        page = page_of_jobs(self._database, audits_of(solution_id), query)
        statement = select(AuditRow.job_id, AuditRow.comparison).where(
            AuditRow.job_id.in_([job.id for job in page.jobs])
        )
        with self._database.read() as session:
            compared = {row.job_id: row.comparison for row in session.execute(statement)}
        return AuditPage(tuple(Audit(job, solution_id, compared.get(job.id)) for job in page.jobs), page)
