"""What backups of both kinds of database have in common."""

from collections.abc import Mapping
from dataclasses import dataclass

from service.storage.revisions import known_revisions, newest_revision

NOT_OURS = "it is not a database of polhode, or has never been migrated"


class BackupError(Exception):
    """A backup cannot be made, or cannot be restored."""


@dataclass(frozen=True, slots=True)
class Contents:
    """What a backup holds."""

    revision: str
    """Of the schema."""
    rows: Mapping[str, int]
    """By table."""

    @property
    def schema(self) -> str:
        """The schema in words: a backup of a later version can be made, and is told as such."""
        if self.revision in known_revisions():
            return f"schema {self.revision}"
        return (
            f"schema {self.revision}, of a later version: this one, with {newest_revision()}, "
            "cannot restore it"
        )


def refuse_jobs(jobs: int) -> None:
    """Raise: nobody's jobs are overwritten by mistake."""
    raise BackupError(f"the database has {jobs} jobs, which the backup would replace; --force does so")
