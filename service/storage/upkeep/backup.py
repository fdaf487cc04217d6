"""Backs up a database in use, and restores it; a backup is checked before it gets its name.

SQLite is copied by its own backup interface, Postgres by pg_dump and
pg_restore, so that no backup format of our own has to be trusted.
"""

import contextlib
import os
import re
import shutil
import sqlite3
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from psycopg.conninfo import make_conninfo
from sqlalchemy import Connection, Engine, Table, inspect, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, SQLAlchemyError
from sqlalchemy.schema import AddConstraint, DropConstraint

from service.storage.database.availability import is_away
from service.storage.database.database import make_engine
from service.storage.database.migration import migrate
from service.storage.database.revisions import known_revisions, origin_of
from service.storage.database.sqlite_file import create_private
from service.storage.tables.schema import METADATA
from service.storage.upkeep.presence import GONE_SECONDS, forget_everybody, who_is_present

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
        is_postgres = _is_postgres(url)
        contents = _dump_postgres(url, part) if is_postgres else _copy_sqlite(_database_file(url), part)
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
    revision = _postgres_revision(file) if _is_postgres(url) else _sqlite_revision(file)
    if revision not in known_revisions():
        raise BackupError(
            f"{file} has the schema {revision}, which this version does not know: {origin_of(revision)}"
        )
    _require_alone(url)
    if _is_postgres(url):
        contents = _load_postgres(url, file, force=force)
    else:
        contents = _load_sqlite(_database_file(url), file, force=force)
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


BUSY_SECONDS = 30.0
"""How long a restore waits for a lock on the database."""

_SQLITE_TABLES = (
    "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%' ORDER BY name"
)


def _copy_sqlite(database: Path, target: Path) -> Contents:
    """Copy a database as it is at one instant to one file, and check the copy."""
    with _opened_sqlite(database) as source, _opened_sqlite(target, create=True) as copied:
        # In one step, hence one read transaction: later writes do not restart the copy.
        source.execute("BEGIN")
        contents = _sqlite_contents(source, database)
        source.backup(copied)
        copied.execute("PRAGMA journal_mode = DELETE")
        _check_sqlite(copied, target)
        if _sqlite_contents(copied, target) != contents:
            raise BackupError(f"{target}: the copy has other numbers of rows than the database")
    return contents


def _sqlite_revision(file: Path) -> str:
    """Return the schema of a backup, after an integrity check."""
    with _opened_sqlite(file) as backup:
        _check_sqlite(backup, file)
        return _stored_revision(backup, file)


def _load_sqlite(database: Path, file: Path, *, force: bool) -> Contents:
    """Make ``database`` a copy of ``file`` in one transaction; see :func:`restore`."""
    with _opened_sqlite(file) as backup, _opened_sqlite(database, create=True) as target:
        tables = [name for (name,) in target.execute(_SQLITE_TABLES)]
        if not force:
            if tables and "alembic_version" not in tables:
                raise BackupError(f"{database}: {NOT_OURS}; --force replaces it")
            if "jobs" in tables and (jobs := _sqlite_count(target, "jobs")):
                refuse_jobs(jobs)
        contents = _sqlite_contents(backup, file)
        until = time.monotonic() + BUSY_SECONDS

        def give_up(status: int, remaining: int, total: int) -> None:
            if status != sqlite3.SQLITE_DONE and time.monotonic() > until:
                raise BackupError(f"{database}: others use it; stop the service and its workers first")

        backup.backup(target, progress=give_up)
    return contents


@contextmanager
def _opened_sqlite(file: Path, *, create: bool = False) -> Iterator[sqlite3.Connection]:
    try:
        if create:
            create_private(file)
        uri = f"{file.absolute().as_uri()}?mode=rw"
        with closing(sqlite3.connect(uri, uri=True, timeout=BUSY_SECONDS, isolation_level=None)) as opened:
            yield opened
    except sqlite3.Error as fault:
        raise BackupError(f"{file}: {fault}") from fault


def _check_sqlite(database: sqlite3.Connection, file: Path) -> None:
    said = [line for (line,) in database.execute("PRAGMA integrity_check")]
    if said != ["ok"]:
        raise BackupError(f"{file} is damaged: {said[0]}")
    dangling = database.execute("PRAGMA foreign_key_check").fetchone()
    if dangling is not None:
        raise BackupError(
            f"{file} is damaged: a row of {dangling[0]} refers to one of {dangling[2]} that is missing"
        )


def _sqlite_contents(database: sqlite3.Connection, file: Path) -> Contents:
    names = [name for (name,) in database.execute(_SQLITE_TABLES)]
    return Contents(_stored_revision(database, file), {name: _sqlite_count(database, name) for name in names})


def _stored_revision(database: sqlite3.Connection, file: Path) -> str:
    try:
        row = database.execute("SELECT version_num FROM alembic_version").fetchone()
    except sqlite3.OperationalError as fault:
        raise BackupError(f"{file}: {NOT_OURS}") from fault
    if row is None:
        raise BackupError(f"{file}: {NOT_OURS}")
    return str(row[0])


def _sqlite_count(database: sqlite3.Connection, table: str) -> int:
    return int(database.execute(f'SELECT count(*) FROM "{table}"').fetchone()[0])


_DUMPED_TABLE = re.compile(r"; \d+ \d+ TABLE \S+ (\S+) ")
_PLAIN = ("--no-owner", "--no-privileges")
"""Owners and rights are left to the server that the tables are restored on."""


def _dump_postgres(url: str, target: Path) -> Contents:
    """Dump a database as it is at one instant, and read the archive back."""
    engine = make_engine(url).execution_options(isolation_level="REPEATABLE READ")
    try:
        with engine.connect() as connection:
            # The counts and the dump see the same instant.
            snapshot = connection.scalar(text("SELECT pg_export_snapshot()"))
            contents = _postgres_contents(connection)
            options = [f"--snapshot={snapshot}", f"--file={target}", "--format=custom", *_PLAIN]
            _run("pg_dump", url, *options)
    except SQLAlchemyError as fault:
        raise BackupError(str(getattr(fault, "orig", None) or fault).splitlines()[0]) from fault
    finally:
        engine.dispose()
    _run("pg_restore", None, f"--file={os.devnull}", str(target))
    return contents


def _postgres_revision(file: Path) -> str:
    """Return the schema of a backup."""
    script = _run("pg_restore", None, "--data-only", "--table=alembic_version", "--file=-", str(file))
    _, found, rows = script.partition("COPY public.alembic_version")
    lines = rows.splitlines()
    if not found or len(lines) < 2:
        raise BackupError(f"{file}: {NOT_OURS}")
    return lines[1].strip()


@contextmanager
def _unreferring(engine: Engine, tables: Sequence[Table]) -> Iterator[None]:
    """Take the foreign keys of tables away; they come back if the block fails, since the tables then stay."""
    with engine.begin() as connection:
        there = set(inspect(connection).get_table_names())
        keys = [key for table in tables if table.name in there for key in table.foreign_key_constraints]
        for key in keys:
            connection.execute(DropConstraint(key))
    try:
        yield
    except BaseException:
        with engine.begin() as connection:
            for key in keys:
                connection.execute(AddConstraint(key))
        raise


def _load_postgres(url: str, file: Path, *, force: bool) -> Contents:
    """Replace the tables by those of ``file``; see :func:`restore`."""
    dumped = set(_DUMPED_TABLE.findall(_run("pg_restore", None, "--list", str(file))))
    engine = make_engine(url)
    try:
        with engine.connect() as connection:
            tables = inspect(connection).get_table_names()
            jobs = _postgres_count(connection, "jobs") if "jobs" in tables else 0
        if jobs and not force:
            refuse_jobs(jobs)
        # Tables of a later version would block the migrations, and their foreign keys the restoring.
        later = [table for table in METADATA.sorted_tables if table.name not in dumped]
        with _unreferring(engine, later):
            _run("pg_restore", url, "--clean", "--if-exists", "--single-transaction", *_PLAIN, str(file))
        with engine.begin() as connection:
            METADATA.drop_all(connection, tables=later)
            return _postgres_contents(connection)
    except SQLAlchemyError as fault:
        raise BackupError(str(getattr(fault, "orig", None) or fault).splitlines()[0]) from fault
    finally:
        engine.dispose()


def _postgres_contents(connection: Connection) -> Contents:
    names = sorted(inspect(connection).get_table_names())
    if "alembic_version" not in names:
        raise BackupError(f"the database: {NOT_OURS}")
    revision = connection.scalar(text("SELECT version_num FROM alembic_version"))
    return Contents(str(revision), {name: _postgres_count(connection, name) for name in names})


def _postgres_count(connection: Connection, table: str) -> int:
    return int(connection.scalar(text(f'SELECT count(*) FROM "{table}"')) or 0)


def _run(program: str, url: str | None, *arguments: str) -> str:
    """Run a client program of Postgres; passwords go in the environment, hidden from other users."""
    path = shutil.which(program)
    if path is None:
        raise BackupError(
            f"{program} is not on PATH; it comes with the client programs of Postgres, "
            "at least as new as the server"
        )
    environment = dict(os.environ)
    if url is not None:
        asked = make_url(url)
        _, given = asked.get_dialect()().create_connect_args(asked)
        password = given.pop("password", None)
        if password is not None:
            environment["PGPASSWORD"] = str(password)
        arguments = (f"--dbname={make_conninfo(**given)}", *arguments)
    done = subprocess.run(
        [path, "--no-password", *arguments] if url is not None else [path, *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        reason = done.stderr.strip().splitlines() or [f"it ended with code {done.returncode}"]
        raise BackupError(f"{program}: {reason[0].removeprefix(f'{program}: ')}")
    return done.stdout
