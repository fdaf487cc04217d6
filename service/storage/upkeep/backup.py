"""Backs up a database in use, and restores it; a backup is checked before it gets its name.

SQLite is copied by its own backup interface, Postgres by pg_dump and
pg_restore, so that no backup format of our own has to be trusted.
"""

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import make_url
from sqlalchemy.exc import ArgumentError, DBAPIError

from service.storage.database.availability import is_away
from service.storage.database.database import make_engine
from service.storage.database.migration import migrate
from service.storage.database.revisions import known_revisions, origin_of
from service.storage.upkeep import postgres_backup, sqlite_backup
from service.storage.upkeep.backup_checks import BackupError, Contents
from service.storage.upkeep.presence import GONE_SECONDS, forget_everybody, who_is_present


def back_up(url: str, file: Path, *, replace: bool = False) -> Contents:
    """Write a backup of the database to ``file``, and return its contents.

    The file appears under its name when it is complete and has been read back.

    Raises
    ------
    BackupError
        The reason why there is none; an older file of that name is untouched.
    """
    if file.is_dir():
        raise BackupError(f"{file}: it is a directory")
    if file.exists() and not replace:
        raise BackupError(f"{file} exists already; another name, or --force")
    with _part_of(file) as part:
        if _is_postgres(url):
            contents = postgres_backup.dump(url, part)
        else:
            contents = sqlite_backup.copy(_database_file(url), part)
        _sync(part)
        part.replace(file)
        _sync(file.parent)
    return contents


def restore(url: str, file: Path, *, force: bool = False) -> Contents:
    """Replace the database by the backup ``file``, and migrate it; return its contents.

    Raises
    ------
    BackupError
        The file is no backup or of a later version, a service or a worker uses
        the database, or it has jobs and ``force`` is not given. The database is
        as it was.
    """
    if file.is_dir():
        raise BackupError(f"{file}: it is a directory")
    if not file.is_file():
        raise BackupError(f"{file}: there is no such file")
    revision = postgres_backup.revision(file) if _is_postgres(url) else sqlite_backup.revision(file)
    if revision not in known_revisions():
        raise BackupError(
            f"{file} has the schema {revision}, which this version does not know: {origin_of(revision)}"
        )
    _require_alone(url)
    if _is_postgres(url):
        contents = postgres_backup.load(url, file, force=force)
    else:
        contents = sqlite_backup.load(_database_file(url), file, force=force)
    migrate(url)
    engine = make_engine(url)
    with engine.begin() as connection:
        forget_everybody(connection)
    engine.dispose()
    return contents


def _require_alone(url: str) -> None:
    """Refuse to replace a database in use: later writes would be lost, or mixed with the backup."""
    if not _is_postgres(url) and not _database_file(url).exists():
        return
    engine = make_engine(url)
    try:
        with engine.connect() as connection:
            present = who_is_present(connection)
    except DBAPIError as fault:
        if is_away(fault):
            raise BackupError(str(fault.orig).splitlines()[0]) from fault
        return  # damaged, or of another program: no service or worker can be using it
    finally:
        engine.dispose()
    if present:
        raise BackupError(
            f"{' and '.join(present)} uses the database; stop the service and its workers first. Those that "
            f"were killed are forgotten {GONE_SECONDS:.0f} s later"
        )


def _is_postgres(url: str) -> bool:
    try:
        return make_url(url).get_backend_name() == "postgresql"
    except ArgumentError as fault:
        raise BackupError(str(fault)) from fault


def _database_file(url: str) -> Path:
    name = make_url(url).database
    if name is None or name == ":memory:":
        raise BackupError("a database in memory has no backup")
    return Path(name)


@contextmanager
def _part_of(file: Path) -> Iterator[Path]:
    """Yield a temporary name beside ``file``; a file left under it at the end is removed."""
    part = file.with_name(f"{file.name}.part")
    try:
        part.unlink(missing_ok=True)
        # Reports an unwritable folder here, with the system's own message.
        part.touch(mode=0o600, exist_ok=False)
        yield part
    except OSError as fault:
        raise BackupError(f"{file}: {fault.strerror or fault}") from fault
    finally:
        with contextlib.suppress(OSError):
            part.unlink()


def _sync(path: Path) -> None:
    """Flush the file and its folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
