"""The tables of the installation: who may use it, who works for it, what it has measured."""

from sqlalchemy import BigInteger, CheckConstraint, String, Uuid
from sqlalchemy.orm import Mapped, mapped_column

from service.jobs.keys import Role
from service.storage.base import Base, Document, one_of


class ApiKeyRow(Base):
    """A key without its secret: only the hash is kept."""

    __tablename__ = "api_keys"
    __table_args__ = (CheckConstraint(one_of("role", Role), name="role"),)

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    prefix: Mapped[str] = mapped_column(String(32), unique=True)
    hash: Mapped[bytes]
    name: Mapped[str] = mapped_column(String(128))
    role: Mapped[str] = mapped_column(String(16))
    created_at: Mapped[float]
    expires_at: Mapped[float | None]
    revoked_at: Mapped[float | None]
    last_used_at: Mapped[float | None]
    requests_per_second: Mapped[float | None]
    max_queued_jobs: Mapped[int | None]
    max_stored_bytes: Mapped[int | None] = mapped_column(BigInteger)
    stored_bytes: Mapped[int] = mapped_column(BigInteger, default=0)
    """Arrays of its results that are stored now."""


class WorkerRow(Base):
    """A worker process, or a service, that has been seen; its row is removed when it stops in order.

    The row of a service has the engine ``service`` and no slots.
    """

    __tablename__ = "workers"

    name: Mapped[str] = mapped_column(String(128), primary_key=True)
    host: Mapped[str] = mapped_column(String(255))
    engine: Mapped[str] = mapped_column(String(32))
    slots: Mapped[int]
    started_at: Mapped[float]
    seen_at: Mapped[float]


class CalibrationRow(Base):
    """A measured table of accuracy and speed; the latest one counts, the older ones are kept."""

    __tablename__ = "calibrations"

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    created_at: Mapped[float] = mapped_column(index=True)
    document: Mapped[Document]
