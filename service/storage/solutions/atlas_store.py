"""Stores the jobs that draw atlases, and reads what they have drawn."""

from sqlalchemy import select

from service.jobs.queue import Lane
from service.jobs.records import AtlasNotFoundError, Job, JobKind, JobPage
from service.jobs.store import Receipt
from service.schemas.query.conditions import ListQuery
from service.schemas.reading.annotation import UNANNOTATED
from service.schemas.reading.documents import Document
from service.storage.codecs.packing import decode_document
from service.storage.database.database import Database
from service.storage.database.rows import is_id
from service.storage.jobs.queue import announce
from service.storage.jobs.records import job_of, page_of_jobs
from service.storage.jobs.submitting import insert_jobs
from service.storage.keys.idempotency_store import write_key
from service.storage.searching.sources import OF_ATLAS_ROWS
from service.storage.tables.base import table_of
from service.storage.tables.jobs import AtlasRow

_ATLASES = table_of(AtlasRow)


class AtlasStore:
    """Writes and reads atlases."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def submit(
        self,
        document: Document,
        digest: str,
        *,
        priority: int = 0,
        key_id: str | None = None,
        receipt: Receipt[tuple[Job, ...]] | None = None,
    ) -> Job:
        """Store a job that draws what a valid ``document`` asks for; its lane is that of single problems.

        The rest is as :meth:`service.jobs.store.JobStore.submit` takes it; nothing is reused.
        """
        with self._database.write() as session:
            (row,) = insert_jobs(
                session,
                [(document, digest)],
                lane=Lane.SINGLE,
                priority=priority,
                key_id=key_id,
                kind=JobKind.ATLAS,
            )
            announce(self._database, session.connection())
            job = job_of(row, UNANNOTATED)
            if receipt is not None:
                write_key(session.connection(), receipt.given, receipt.answer((job,)))
            return job

    def get(self, atlas_id: str) -> Document:
        """Return an atlas, or raise :class:`AtlasNotFoundError`."""
        with self._database.read() as session:
            row = session.get(AtlasRow, atlas_id) if is_id(atlas_id) else None
            data = None if row is None else row.data
        if data is None:
            raise AtlasNotFoundError(atlas_id)
        return decode_document(data)

    def find(self, query: ListQuery) -> JobPage:
        """Return one page of the jobs that draw atlases, asked like jobs."""
        return page_of_jobs(self._database, OF_ATLAS_ROWS, query)


def known_atlas(database: Database, atlas_id: str) -> str:
    """Return the id of an atlas as it is stored, unread, or raise :class:`AtlasNotFoundError`."""
    found = None
    if is_id(atlas_id):
        with database.read_rows() as connection:
            found = connection.scalar(select(_ATLASES.c.job_id).where(_ATLASES.c.job_id == atlas_id))
    if found is None:
        raise AtlasNotFoundError(atlas_id)
    return str(found)
