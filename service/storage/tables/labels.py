"""The tables of labels: one for each kind of resource that has labels."""

from collections.abc import Mapping

from sqlalchemy import ForeignKey, Index, String, Uuid
from sqlalchemy.orm import Mapped, mapped_column

from service.schemas.reading.annotation import LONGEST_KEY, LONGEST_VALUE
from service.storage.tables.base import Base
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SolutionRow
from service.storage.tables.sweeps import SweepRow


class JobLabelRow(Base):
    """A label of a job."""

    __tablename__ = "job_labels"
    __table_args__ = (
        # To find by a label; a page in the order of time or of ids is read from these indexes as it is.
        Index("ix_job_labels_key_value", "key", "value", "created_at", "job_id"),
        Index("ix_job_labels_key_value_id", "key", "value", "job_id"),
    )

    owner_id: Mapped[str] = mapped_column(
        "job_id", Uuid(as_uuid=False), ForeignKey(JobRow.id, ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(String(LONGEST_KEY), primary_key=True)
    value: Mapped[str] = mapped_column(String(LONGEST_VALUE))
    created_at: Mapped[float]
    """When the job was stored, not the label."""


class SolutionLabelRow(Base):
    """A label of a solution."""

    __tablename__ = "solution_labels"
    __table_args__ = (
        Index("ix_solution_labels_key_value", "key", "value", "created_at", "solution_id"),
        Index("ix_solution_labels_key_value_id", "key", "value", "solution_id"),
    )

    owner_id: Mapped[str] = mapped_column(
        "solution_id", Uuid(as_uuid=False), ForeignKey(SolutionRow.id, ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(String(LONGEST_KEY), primary_key=True)
    value: Mapped[str] = mapped_column(String(LONGEST_VALUE))
    created_at: Mapped[float]
    """When the solution was stored."""


class SweepLabelRow(Base):
    """A label of a sweep."""

    __tablename__ = "sweep_labels"
    __table_args__ = (
        Index("ix_sweep_labels_key_value", "key", "value", "created_at", "sweep_id"),
        Index("ix_sweep_labels_key_value_id", "key", "value", "sweep_id"),
    )

    owner_id: Mapped[str] = mapped_column(
        "sweep_id", Uuid(as_uuid=False), ForeignKey(SweepRow.id, ondelete="CASCADE"), primary_key=True
    )
    key: Mapped[str] = mapped_column(String(LONGEST_KEY), primary_key=True)
    value: Mapped[str] = mapped_column(String(LONGEST_VALUE))
    created_at: Mapped[float]
    """When the sweep was stored."""


AnyLabelRow = JobLabelRow | SolutionLabelRow | SweepLabelRow

LABELS_OF: Mapping[type[JobRow | SolutionRow | SweepRow], type[AnyLabelRow]] = {
    JobRow: JobLabelRow,
    SolutionRow: SolutionLabelRow,
    SweepRow: SweepLabelRow,
}
