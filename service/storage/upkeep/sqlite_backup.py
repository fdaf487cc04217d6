"""Backs up SQLite by its backup interface, while others read and write, and restores."""

import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from service.storage.database.sqlite_file import create_private
from service.storage.upkeep.backup_checks import NOT_OURS, BackupError, Contents, refuse_jobs

BUSY_SECONDS = 30.0
"""How long a restore waits for a lock on the database."""

_ROWS = "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%' ORDER BY name"


def copy(database: Path, target: Path) -> Contents:
    """Copy a database as it is at one instant to one file, and check the copy."""
    with _opened(database) as source, _opened(target, create=True) as copied:
        # In one step, hence one read transaction: later writes do not restart the copy.
        source.execute("BEGIN")
        contents = _contents(source, database)
        source.backup(copied)
        copied.execute("PRAGMA journal_mode = DELETE")
        _check(copied, target)
        if _contents(copied, target) != contents:
            raise BackupError(f"{target}: the copy has other numbers of rows than the database")
    return contents


def revision(file: Path) -> str:
    """Return the schema of a backup, after an integrity check."""
    with _opened(file) as backup:
        _check(backup, file)
        return _revision(backup, file)


def load(database: Path, file: Path, *, force: bool) -> Contents:
    """Make ``database`` a copy of ``file`` in one transaction; see ``backup.restore``."""
    with _opened(file) as backup, _opened(database, create=True) as target:
        tables = [name for (name,) in target.execute(_ROWS)]
        if not force:
            if tables and "alembic_version" not in tables:
                raise BackupError(f"{database}: {NOT_OURS}; --force replaces it")
            if "jobs" in tables and (jobs := _count(target, "jobs")):
                refuse_jobs(jobs)
        contents = _contents(backup, file)
        until = time.monotonic() + BUSY_SECONDS

        def give_up(status: int, remaining: int, total: int) -> None:
            if status != sqlite3.SQLITE_DONE and time.monotonic() > until:
                raise BackupError(f"{database}: others use it; stop the service and its workers first")

        backup.backup(target, progress=give_up)
    return contents


@contextmanager
def _opened(file: Path, *, create: bool = False) -> Iterator[sqlite3.Connection]:
    try:
        if create:
            create_private(file)
        uri = f"{file.absolute().as_uri()}?mode=rw"
        with closing(sqlite3.connect(uri, uri=True, timeout=BUSY_SECONDS, isolation_level=None)) as opened:
            yield opened
    except sqlite3.Error as fault:
        raise BackupError(f"{file}: {fault}") from fault


def _check(database: sqlite3.Connection, file: Path) -> None:
    said = [line for (line,) in database.execute("PRAGMA integrity_check")]
    if said != ["ok"]:
        raise BackupError(f"{file} is damaged: {said[0]}")
    dangling = database.execute("PRAGMA foreign_key_check").fetchone()
    if dangling is not None:
        raise BackupError(
            f"{file} is damaged: a row of {dangling[0]} refers to one of {dangling[2]} that is missing"
        )


def _contents(database: sqlite3.Connection, file: Path) -> Contents:
    names = [name for (name,) in database.execute(_ROWS)]
    return Contents(_revision(database, file), {name: _count(database, name) for name in names})


def _revision(database: sqlite3.Connection, file: Path) -> str:
    try:
        row = database.execute("SELECT version_num FROM alembic_version").fetchone()
    except sqlite3.OperationalError as fault:
        raise BackupError(f"{file}: {NOT_OURS}") from fault
    if row is None:
        raise BackupError(f"{file}: {NOT_OURS}")
    return str(row[0])


def _count(database: sqlite3.Connection, table: str) -> int:
    return int(database.execute(f'SELECT count(*) FROM "{table}"').fetchone()[0])
