"""Stores the jobs that make documents (atlases, studies), and reads what they have made."""

from sqlalchemy import select

from service.jobs.queue import Lane
from service.jobs.records import Job, JobKind, JobPage, ResultNotFoundError
from service.schemas.query.conditions import ListQuery
from service.schemas.reading.annotation import UNANNOTATED
from service.schemas.reading.documents import Document
from service.storage.codecs.packing import decode_document
from service.storage.database.database import Database
from service.storage.database.rows import is_id
from service.storage.jobs.queue import announce
from service.storage.jobs.records import job_of, page_of_jobs
from service.storage.jobs.submitting import insert_jobs
from service.storage.keys.idempotency_store import Receipt, write_key
from service.storage.searching.sources import OF_ATLAS_ROWS, OF_STUDY_ROWS
from service.storage.tables.base import table_of
from service.storage.tables.jobs import JobRow, ResultRow

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
