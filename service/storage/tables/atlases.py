"""The table of atlases that jobs have drawn."""

from sqlalchemy import ForeignKey, Uuid
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base
from service.storage.tables.jobs import JobRow


class AtlasRow(Base):
    """An atlas; it has the id of its job, and goes with it."""

    __tablename__ = "atlases"

    job_id: Mapped[str] = mapped_column(
        Uuid(as_uuid=False), ForeignKey(JobRow.id, ondelete="CASCADE"), primary_key=True
    )
    data: Mapped[bytes]
    """Encoded by :mod:`service.storage.codecs.documents`."""
