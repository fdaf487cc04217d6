"""Checks and errors that backups of SQLite and Postgres share."""

from collections.abc import Mapping
from dataclasses import dataclass

from service.storage.database.revisions import known_revisions, origin_of

NOT_OURS = "it is not a database of polhode, or has never been migrated"


class BackupError(Exception):
    """A backup cannot be made, or cannot be restored."""


@dataclass(frozen=True, slots=True)
class Contents:
    """The contents of a backup."""

    revision: str
    """Revision of the schema."""
    rows: Mapping[str, int]
    """Numbers of rows by table."""

    @property
    def schema(self) -> str:
        """The schema in words, with a warning if this version cannot restore it."""
        if self.revision in known_revisions():
            return f"schema {self.revision}"
        return f"schema {self.revision}, which this version cannot restore: {origin_of(self.revision)}"


def refuse_jobs(jobs: int) -> None:
    """Refuse a database that has jobs, so that none is overwritten by mistake."""
    raise BackupError(f"the database has {jobs} jobs, which the backup would replace; --force does so")
