"""Backs up a database in use, and restores it; a backup is checked before it gets its name.

SQLite is copied by its own backup interface, Postgres by pg_dump and pg_restore, so that no backup format of
our own has to be trusted. What both do is written once, and what each does its own way is a class.
"""

import contextlib
import os
import re
import shutil
import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from sqlalchemy import Connection, Engine, Table, inspect, make_url, text
from sqlalchemy.exc import ArgumentError, DBAPIError, SQLAlchemyError
from sqlalchemy.schema import AddConstraint, DropConstraint

from service.storage.database.availability import create_private, is_away
from service.storage.database.database import make_engine
from service.storage.database.migration import known_revisions, migrate, origin_of
from service.storage.tables.operations import METADATA
from service.storage.upkeep.presence import GONE_SECONDS, forget_everybody, who_is_present

BUSY_SECONDS = 30.0
"""How long a restore of SQLite waits for a lock on the database."""
NOT_OURS = "it is not a database of polhode, or has never been migrated"

_SQLITE_TABLES = (
    "SELECT name FROM sqlite_master WHERE type = 'table' AND name NOT LIKE 'sqlite_%' ORDER BY name"
)
_POSTGRES_TABLES = "SELECT tablename FROM pg_tables WHERE schemaname = current_schema() ORDER BY tablename"
_DUMPED_TABLE = re.compile(r"; \d+ \d+ TABLE \S+ (\S+) ")
_VERSION = re.compile(r"(\d+)(?:\.\d+)*")
_PLAIN = ("--no-owner", "--no-privileges")
"""Owners and rights are left to the server that the tables are restored on."""

Ask = Callable[[str], Sequence[Sequence[object]]]
"""Sends an SQL query to a database and returns the rows."""


class BackupError(Exception):
    """A backup cannot be made, or cannot be restored."""


@dataclass(frozen=True, slots=True)
class Contents:
    """The contents of a backup."""

    revision: str
    """Revision of the schema."""
    rows: Mapping[str, int]
    """Numbers of rows by table."""
    made_by: str = field(default="", compare=False)
    """The program that has made it, and the server, with their versions; empty for SQLite."""

    @property
    def schema(self) -> str:
        """The schema in words, with a warning if this version cannot restore it."""
        if self.revision in known_revisions():
            return f"schema {self.revision}"
        return f"schema {self.revision}, which this version cannot restore: {origin_of(self.revision)}"


def back_up(url: str, file: Path, *, force: bool = False) -> Contents:
    """Write a backup of the database to ``file``, and return its contents.

    The file appears under its name when it is complete and has been read back.

    Raises
    ------
    BackupError
        The reason why there is none; an older file of that name is untouched.
    """
    if file.is_dir():
        raise BackupError(f"{file}: it is a directory")
    if file.exists() and not force:
        raise BackupError(f"{file} exists already; another name, or --force")
    with _part_of(file) as part:
        contents = _database_of(url).copy(part)
        _sync(part)
        part.replace(file)
        _sync(file.parent)
    return contents


def restore(url: str, file: Path, *, force: bool = False) -> Contents:
    """Replace the database by the backup ``file``, and migrate it; return its contents.

    Raises
    ------
    BackupError
        The file is no backup or of a later version, a service or a worker uses the database, or it has jobs
        and ``force`` is not given. The database is as it was.
    """
    if file.is_dir():
        raise BackupError(f"{file}: it is a directory")
    if not file.is_file():
        raise BackupError(f"{file}: there is no such file")
    database = _database_of(url)
    revision = database.revision(file)
    if revision not in known_revisions():
        raise BackupError(
            f"{file} has the schema {revision}, which this version does not know: {origin_of(revision)}"
        )
    if database.exists:
        _require_alone(url)
    contents = database.load(file, force=force)
    migrate(url)
    engine = make_engine(url)
    with engine.begin() as connection:
        forget_everybody(connection)
    engine.dispose()
    return contents


def _require_alone(url: str) -> None:
    """Refuse to replace a database in use: later writes would be lost, or mixed with the backup."""
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


def _contents(ask: Ask, tables: Sequence[str], where: object) -> Contents:
    found = ask("SELECT version_num FROM alembic_version") if "alembic_version" in tables else []
    if not found:
        raise BackupError(f"{where}: {NOT_OURS}")
    return Contents(str(found[0][0]), {name: _count(ask, name) for name in tables})


def _count(ask: Ask, table: str) -> int:
    return int(str(ask(f'SELECT count(*) FROM "{table}"')[0][0]))


def _require_no_jobs(ask: Ask, tables: Sequence[str]) -> None:
    """Refuse a database that has jobs, so that none is overwritten by mistake."""
    if "jobs" in tables and (jobs := _count(ask, "jobs")):
        raise BackupError(f"the database has {jobs} jobs, which the backup would replace; --force does so")


def _database_of(url: str) -> "_Sqlite | _Postgres":
    """Return a database by what its kind does its own way.

    ``copy`` writes it as it is at one instant to a file, and reads that back; ``load`` puts a backup in its
    place, all or nothing, with jobs only by ``force``; ``revision`` is the schema of a backup.
    """
    try:
        parsed = make_url(url)
    except ArgumentError as fault:
        raise BackupError(str(fault)) from fault
    if parsed.get_backend_name() == "postgresql":
        return _Postgres(url)
    if parsed.database is None or parsed.database == ":memory:":
        raise BackupError("a database in memory has no backup")
    return _Sqlite(Path(parsed.database))


class _Sqlite:
    """A file of SQLite, which is copied by SQLite's backup interface, while others read and write."""

    def __init__(self, database: Path) -> None:
        self._database, self.exists = database, database.exists()

    def copy(self, target: Path) -> Contents:
        with _opened(self._database) as source, _opened(target, create=True) as copied:
            # In one step, hence one read transaction: later writes do not restart the copy.
            source.execute("BEGIN")
            contents = _contents_of(source, self._database)
            source.backup(copied)
            copied.execute("PRAGMA journal_mode = DELETE")
            _check(copied, target)
            if _contents_of(copied, target) != contents:
                raise BackupError(f"{target}: the copy has other numbers of rows than the database")
        return contents

    def revision(self, file: Path) -> str:
        with _opened(file) as backup:
            _check(backup, file)
            return _contents_of(backup, file).revision

    def load(self, file: Path, *, force: bool) -> Contents:
        with _opened(file) as backup, _opened(self._database, create=True) as target:
            tables = _tables_of(target)
            if not force:
                if tables and "alembic_version" not in tables:
                    raise BackupError(f"{self._database}: {NOT_OURS}; --force replaces it")
                _require_no_jobs(_asking(target), tables)
            contents = _contents_of(backup, file)
            until = time.monotonic() + BUSY_SECONDS

            def give_up(status: int, remaining: int, total: int) -> None:
                if status != sqlite3.SQLITE_DONE and time.monotonic() > until:
                    said = "others use it; stop the service and its workers first"
                    raise BackupError(f"{self._database}: {said}")

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


def _asking(database: sqlite3.Connection) -> Ask:
    return lambda query: database.execute(query).fetchall()


def _tables_of(database: sqlite3.Connection) -> list[str]:
    return [str(name) for (name,) in database.execute(_SQLITE_TABLES)]


def _contents_of(database: sqlite3.Connection, file: Path) -> Contents:
    return _contents(_asking(database), _tables_of(database), file)


def _check(database: sqlite3.Connection, file: Path) -> None:
    said = [line for (line,) in database.execute("PRAGMA integrity_check")]
    if said != ["ok"]:
        raise BackupError(f"{file} is damaged: {said[0]}")
    dangling = database.execute("PRAGMA foreign_key_check").fetchone()
    if dangling is not None:
        raise BackupError(
            f"{file} is damaged: a row of {dangling[0]} refers to one of {dangling[2]} that is missing"
        )


class _Postgres:
    """A database of Postgres, which pg_dump copies in its custom format and pg_restore restores."""

    exists = True

    def __init__(self, url: str) -> None:
        self._url = url

    def copy(self, target: Path) -> Contents:
        repeatable = _connecting(self._url, isolation_level="REPEATABLE READ")
        with repeatable as engine, engine.connect() as connection:
            made_by = _suitable_dump(str(connection.scalar(text("SHOW server_version"))))
            # The counts and the dump see the same instant.
            snapshot = connection.scalar(text("SELECT pg_export_snapshot()"))
            contents = _contents_at(connection)
            options = [f"--snapshot={snapshot}", f"--file={target}", "--format=custom", *_PLAIN]
            _run("pg_dump", self._url, *options)
        _run("pg_restore", None, f"--file={os.devnull}", str(target))
        return replace(contents, made_by=made_by)

    def revision(self, file: Path) -> str:
        script = _run("pg_restore", None, "--data-only", "--table=alembic_version", "--file=-", str(file))
        _, found, rows = script.partition("COPY public.alembic_version")
        lines = rows.splitlines()
        if not found or len(lines) < 2:
            raise BackupError(f"{file}: {NOT_OURS}")
        return lines[1].strip()

    def load(self, file: Path, *, force: bool) -> Contents:
        dumped = set(_DUMPED_TABLE.findall(_run("pg_restore", None, "--list", str(file))))
        with _connecting(self._url) as engine:
            if not force:
                with engine.connect() as connection:
                    ask = _asking_at(connection)
                    _require_no_jobs(ask, [str(name) for (name,) in ask(_POSTGRES_TABLES)])
            # Tables of a later version would block the migrations, and their foreign keys the restoring.
            later = [table for table in METADATA.sorted_tables if table.name not in dumped]
            with _unreferring(engine, later):
                options = ["--clean", "--if-exists", "--single-transaction", *_PLAIN]
                _run("pg_restore", self._url, *options, str(file))
            with engine.begin() as connection:
                METADATA.drop_all(connection, tables=later)
                return _contents_at(connection)


@contextmanager
def _connecting(url: str, **options: str) -> Iterator[Engine]:
    engine = make_engine(url)
    try:
        yield engine.execution_options(**options)
    except SQLAlchemyError as fault:
        raise BackupError(str(getattr(fault, "orig", None) or fault).splitlines()[0]) from fault
    finally:
        engine.dispose()


def _asking_at(connection: Connection) -> Ask:
    return lambda query: connection.execute(text(query)).all()


def _contents_at(connection: Connection) -> Contents:
    ask = _asking_at(connection)
    return _contents(ask, [str(name) for (name,) in ask(_POSTGRES_TABLES)], "the database")


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


def _suitable_dump(server: str) -> str:
    """Return pg_dump and the server with their versions; an older pg_dump than the server is refused."""
    ours, theirs = (_VERSION.search(each) for each in (_run("pg_dump", None, "--version"), server))
    if ours is None or theirs is None:
        return "pg_dump"
    if int(ours[1]) < int(theirs[1]):
        raise BackupError(
            f"pg_dump {ours[0]} cannot copy a server of version {theirs[0]}: put one of version {theirs[1]} "
            f"or later first on PATH (Debian: postgresql-client-{theirs[1]})"
        )
    return f"pg_dump {ours[0]} of a server {theirs[0]}"


def _run(program: str, url: str | None, *arguments: str) -> str:
    """Run a client program of Postgres; passwords go in the environment, hidden from other users."""
    path = shutil.which(program)
    if path is None:
        raise BackupError(
            f"{program} is not on PATH; it comes with the client programs of Postgres, "
            "at least as new as the server"
        )
    environment, options = dict(os.environ), list[str]()
    if url is not None:
        # Not at the top: it loads the driver.
        from psycopg.conninfo import make_conninfo  # noqa: PLC0415

        asked = make_url(url)
        _, given = asked.get_dialect()().create_connect_args(asked)
        password = given.pop("password", None)
        if password is not None:
            environment["PGPASSWORD"] = str(password)
        options = ["--no-password", f"--dbname={make_conninfo(**given)}"]
    done = subprocess.run(
        [path, *options, *arguments],
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        reason = done.stderr.strip().splitlines() or [f"it ended with code {done.returncode}"]
        said = reason[0].removeprefix(f"{program}: ")
        if "unsupported version" in said:
            version = _VERSION.search(_run(program, None, "--version"))
            said += f": a pg_dump later than this {program} {version and version[0]} has made the file"
        raise BackupError(f"{program}: {said}")
    return done.stdout
