"""The table of audits: jobs that solve the problem of a stored solution again, to compare the two."""

from sqlalchemy import JSON, ForeignKey, Uuid
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base, Document
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SolutionRow


class AuditRow(Base):
    """The fact that a job is an audit; it goes with the job, and so with either of the two solutions."""

    __tablename__ = "audits"

    job_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey(JobRow.id, ondelete="CASCADE"), primary_key=True
    )
    solution_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey(SolutionRow.id, ondelete="CASCADE"), index=True
    )
    """The audited solution, not the one that the job makes."""
    comparison: Mapped[Document | None] = mapped_column(JSON(none_as_null=True))
    """The comparison of the two solutions; null as long as there is no second one."""
