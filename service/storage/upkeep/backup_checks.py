"""What backups of both kinds of database have in common."""

from collections.abc import Mapping
from dataclasses import dataclass

from alembic.script import ScriptDirectory

from service.storage.migration import migrations_folder

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


def known_revisions() -> frozenset[str]:
    """Return the schemas that this version can bring to its own."""
    scripts = ScriptDirectory(str(migrations_folder()))
    return frozenset(script.revision for script in scripts.walk_revisions())


def refuse_jobs(jobs: int) -> None:
    """Raise: nobody's jobs are overwritten by mistake."""
    raise BackupError(f"the database has {jobs} jobs, which the backup would replace; --force does so")
