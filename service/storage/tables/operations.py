"""The tables of the installation: keys, stored answers, live processes, calibrations, examinations.

Every table is listed at the end, each after the tables that it refers to.
"""

from sqlalchemy import JSON, BigInteger, String, Uuid, true
from sqlalchemy.orm import Mapped, mapped_column

from service.jobs.keys import Role
from service.schemas.reading.documents import Document
from service.storage.tables.base import Base, Word
from service.storage.tables.jobs import (
    AttemptRow,
    AuditRow,
    JobLabelRow,
    JobRow,
    ResultRow,
    SolutionLabelRow,
    SweepLabelRow,
)
from service.storage.tables.solutions import (
    DenseOutputRow,
    SamplesRow,
    SolutionNumberRow,
    SolutionRow,
    SweepChunkRow,
    SweepRow,
)


class ApiKeyRow(Base):
    """A key without its secret: only the hash is kept."""

    __tablename__ = "api_keys"

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    prefix: Mapped[str] = mapped_column(String(32), unique=True)
    hash: Mapped[bytes]
    name: Mapped[str] = mapped_column(String(128))
    role: Mapped[str] = mapped_column(Word(Role))
    created_at: Mapped[float]
    expires_at: Mapped[float | None]
    revoked_at: Mapped[float | None]
    last_used_at: Mapped[float | None]
    requests_per_second: Mapped[float | None]
    max_queued_jobs: Mapped[int | None]
    max_stored_bytes: Mapped[int | None] = mapped_column(BigInteger)
    stored_bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    """Bytes of stored arrays of its results."""


class WorkerRow(Base):
    """A live worker process or service; a regular shutdown removes the row.

    The row of a service has the engine ``service`` and no slots.
    """

    __tablename__ = "workers"

    name: Mapped[str] = mapped_column(String(128), primary_key=True)
    host: Mapped[str] = mapped_column(String(255))
    engine: Mapped[str] = mapped_column(String(32))
    slots: Mapped[int]
    started_at: Mapped[float]
    seen_at: Mapped[float]
    is_warm: Mapped[bool] = mapped_column(default=True, server_default=true())
    """It has loaded all that any job needs, or has logged why it could not."""
    kernels: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    """How far they are compiled, see :class:`service.jobs.kernels.Kernels`; null: there is nothing to do."""
    cluster: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    """The cluster on which it computes, a :class:`service.jobs.kernels.ClusterState`; null: by children."""


class IdempotencyKeyRow(Base):
    """The answer to a request that a client may send twice, written with what the request made."""

    __tablename__ = "idempotency_keys"

    principal: Mapped[str] = mapped_column(primary_key=True)
    """Id of the API key that sent it, empty without keys; no reference, so that API keys can be removed."""
    key: Mapped[str] = mapped_column(String(255), primary_key=True)
    fingerprint: Mapped[str]
    status: Mapped[int]
    headers: Mapped[Document]
    body: Mapped[bytes]
    created_at: Mapped[float] = mapped_column(index=True)


class CalibrationRow(Base):
    """A measured table of accuracy and speed; the latest one is used, the older ones are kept."""

    __tablename__ = "calibrations"

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    created_at: Mapped[float] = mapped_column(index=True)
    document: Mapped[Document]


class ExaminationRow(Base):
    """A cached verdict, or the cached windows of a curve: nothing in it that cannot be computed again."""

    __tablename__ = "examinations"

    key: Mapped[str] = mapped_column(primary_key=True)
    version: Mapped[str] = mapped_column(String(128))
    """Version of the code that found it; see :func:`service.storage.examinations.examination_version`."""
    content: Mapped[bytes]
    """JSON, in UTF-8."""
    seal: Mapped[str]
    """Checksum of key and content."""
    used_at: Mapped[float] = mapped_column(index=True)
    """When a job or a question last came with it, to within a day."""


TABLES: tuple[type[Base], ...] = (
    ApiKeyRow,
    IdempotencyKeyRow,
    WorkerRow,
    CalibrationRow,
    ExaminationRow,
    SolutionRow,
    SolutionNumberRow,
    DenseOutputRow,
    SamplesRow,
    SweepRow,
    SweepChunkRow,
    JobRow,
    AttemptRow,
    AuditRow,
    ResultRow,
    JobLabelRow,
    SolutionLabelRow,
    SweepLabelRow,
)

METADATA = Base.metadata
