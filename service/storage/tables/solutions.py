"""The tables of solutions and their arrays."""

from sqlalchemy import ForeignKey, Index, String, Uuid
from sqlalchemy.orm import Mapped, mapped_column

from service.schemas.reading.marks import LONGEST_NOTE
from service.storage.tables.base import ASKED_DOCUMENT, Base, Document

SORTED_NUMBERS = ("created_at", "A", "C", "period", "energy", "error")
"""Columns that lists of solutions were sorted by before there was a language for queries."""
ASKED_NUMBERS = ("B", "lambda_", "drift", "trace", "seconds")
"""Further numbers that are asked for often."""


class SolutionRow(Base):
    """A solution without its arrays; the numbers that are filtered and sorted by have columns of their own.

    It outlives its job: the problem is kept here too, and ``job_id`` says where
    it came from without being a foreign key.
    """

    __tablename__ = "solutions"
    __table_args__ = (
        # For every sort order of the list, in both directions.
        *(Index(f"ix_solutions_{name}_id", name, "id") for name in (*SORTED_NUMBERS, *ASKED_NUMBERS)),
        # Covers all filters, so that counting reads no documents.
        Index(
            "ix_solutions_filters",
            "family",
            "method",
            "tier",
            *SORTED_NUMBERS,
            *ASKED_NUMBERS,
            "stability",
            "aperiodic",
            "id",
        ),
    )

    id: Mapped[str] = mapped_column(Uuid(as_uuid=False), primary_key=True)
    job_id: Mapped[str] = mapped_column(Uuid(as_uuid=False), unique=True)
    digest: Mapped[str] = mapped_column(index=True)
    problem: Mapped[Document]
    summary: Mapped[Document]
    created_at: Mapped[float]
    family: Mapped[str | None] = mapped_column(String(32))
    method: Mapped[str | None] = mapped_column(String(32))
    tier: Mapped[str | None] = mapped_column(String(32))
    A: Mapped[float | None]
    C: Mapped[float | None]
    period: Mapped[float | None]
    energy: Mapped[float | None]
    error: Mapped[float | None]
    B: Mapped[float | None]
    lambda_: Mapped[float | None]
    drift: Mapped[float | None]
    """The largest departure of any integral."""
    trace: Mapped[float | None]
    seconds: Mapped[float | None]
    """Seconds that computing took."""
    stability: Mapped[str | None] = mapped_column(String(16))
    """The verdict."""
    aperiodic: Mapped[str | None] = mapped_column(String(16))
    facts: Mapped[Document | None] = mapped_column(ASKED_DOCUMENT)
    """The numbers of the problem by JSON pointer: see :mod:`service.schemas.query.facts`."""
    note: Mapped[str | None] = mapped_column(String(LONGEST_NOTE))


class DenseOutputRow(Base):
    """The solution as a function of time, encoded; a table of its own, so that lists never read it."""

    __tablename__ = "dense_outputs"

    solution_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("solutions.id", ondelete="CASCADE"), primary_key=True
    )
    data: Mapped[bytes]


class SamplesRow(Base):
    """The samples that were asked for with the problem, encoded."""

    __tablename__ = "samples"

    solution_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey("solutions.id", ondelete="CASCADE"), primary_key=True
    )
    data: Mapped[bytes]
