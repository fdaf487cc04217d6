"""The tables of sweeps and of their computed points."""

from sqlalchemy import JSON, BigInteger, CheckConstraint, ForeignKey, Index, SmallInteger, String, Uuid
from sqlalchemy.orm import Mapped, mapped_column

from service.jobs.records import JobState
from service.schemas.reading.annotation import LONGEST_NOTE
from service.schemas.reading.documents import Document
from service.storage.tables.base import ASKED_DOCUMENT, Base, DatabaseNow, Word


class SweepRow(Base):
    """One sweep: the document that defines its points, and its progress; the points are in chunks."""

    __tablename__ = "sweeps"
    __table_args__ = (
        CheckConstraint("done <= next_index AND next_index <= points", name="progress"),
        CheckConstraint("refused <= done", name="refused"),
        Index("ix_sweeps_state_id", "state", "id"),
        Index("ix_sweeps_changed", "changed_at", "id"),
    )

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    state: Mapped[str] = mapped_column(Word(JobState))
    document: Mapped[Document]
    facts: Mapped[Document | None] = mapped_column(ASKED_DOCUMENT)
    """Family and numbers of the base, for conditions."""
    points: Mapped[int] = mapped_column(BigInteger)
    next_index: Mapped[int] = mapped_column(BigInteger, default=0)
    """Index of the first point that is in no chunk yet."""
    done: Mapped[int] = mapped_column(BigInteger, default=0)
    """Points in stored chunks, the refused ones among them."""
    refused: Mapped[int] = mapped_column(BigInteger, default=0)
    chunk_points: Mapped[int] = mapped_column(default=0)
    """Size of the last chunk that was made."""
    point_seconds: Mapped[float | None]
    """Seconds a point took, as last measured."""
    priority: Mapped[int] = mapped_column(default=0)
    key_id: Mapped[str | None] = mapped_column(Uuid(as_uuid=False), index=True)
    error: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    created_at: Mapped[float]
    started_at: Mapped[float | None]
    finished_at: Mapped[float | None]
    way: Mapped[str | None] = mapped_column(String(16))
    """The way in which all its points are computed; chosen when its first chunk is claimed."""
    note: Mapped[str | None] = mapped_column(String(LONGEST_NOTE))
    changed_at: Mapped[float] = mapped_column(
        default=DatabaseNow(), onupdate=DatabaseNow(), server_default="0"
    )
    """When anything of it was last written: see :mod:`..jobs.changes`."""
    provenances: Mapped[list[Document] | None] = mapped_column(JSON(none_as_null=True))
    """Origins of its chunks: each provenance of a solution once, with the names of its ``hosts``."""


class SweepChunkRow(Base):
    """Some neighbouring computed points, in columns."""

    __tablename__ = "sweep_chunks"
    __table_args__ = (CheckConstraint("count > 0 AND refused <= count", name="count"),)

    sweep_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("sweeps.id", ondelete="CASCADE"), primary_key=True
    )
    first: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    count: Mapped[int]
    refused: Mapped[int]
    bounds: Mapped[Document]
    """{number: [smallest, largest]} of the kept numbers: a filter skips chunks without reading them."""
    data: Mapped[bytes]
    host: Mapped[str | None] = mapped_column(String(255))
    provenance: Mapped[int | None] = mapped_column(SmallInteger)
    """Its place among the provenances of its sweep; null where that is not known, as of older ones."""
