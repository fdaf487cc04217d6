"""The table of verdicts and windows that were found before."""

from sqlalchemy import String
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base


class ExaminationRow(Base):
    """A kept verdict, or the kept windows of a curve: nothing in it that cannot be found again."""

    __tablename__ = "examinations"

    key: Mapped[str] = mapped_column(primary_key=True)
    version: Mapped[str] = mapped_column(String(128))
    """Version of the code that found it; see :func:`service.verdicts.cache_rows.examination_version`."""
    content: Mapped[bytes]
    """JSON, in UTF-8."""
    seal: Mapped[str]
    """Checksum of key and content."""
    used_at: Mapped[float] = mapped_column(index=True)
    """When a job or a question last came with it, to within a day."""
