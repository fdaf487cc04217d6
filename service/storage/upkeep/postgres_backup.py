"""Backs up Postgres by pg_dump in its custom format, and restores by pg_restore."""

import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from psycopg.conninfo import make_conninfo
from sqlalchemy import Connection, Engine, Table, inspect, make_url, text
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.schema import AddConstraint, DropConstraint

from service.storage.database.database import make_engine
from service.storage.tables.schema import METADATA
from service.storage.upkeep.backup_checks import NOT_OURS, BackupError, Contents, refuse_jobs

_TABLE = re.compile(r"; \d+ \d+ TABLE \S+ (\S+) ")
_PLAIN = ("--no-owner", "--no-privileges")
"""Owners and rights are left to the server that the tables are restored on."""


def dump(url: str, target: Path) -> Contents:
    """Dump a database as it is at one instant, and read the archive back."""
    engine = make_engine(url).execution_options(isolation_level="REPEATABLE READ")
    try:
        with engine.connect() as connection:
            # The counts and the dump see the same instant.
            snapshot = connection.scalar(text("SELECT pg_export_snapshot()"))
            contents = _contents(connection)
            options = [f"--snapshot={snapshot}", f"--file={target}", "--format=custom", *_PLAIN]
            _run("pg_dump", url, *options)
    except SQLAlchemyError as fault:
        raise BackupError(str(getattr(fault, "orig", None) or fault).splitlines()[0]) from fault
    finally:
        engine.dispose()
    _run("pg_restore", None, f"--file={os.devnull}", str(target))
    return contents


def revision(file: Path) -> str:
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


def load(url: str, file: Path, *, force: bool) -> Contents:
    """Replace the tables by those of ``file``; see :func:`service.storage.upkeep.backup.restore`."""
    dumped = set(_TABLE.findall(_run("pg_restore", None, "--list", str(file))))
    engine = make_engine(url)
    try:
        with engine.connect() as connection:
            tables = inspect(connection).get_table_names()
            jobs = _count(connection, "jobs") if "jobs" in tables else 0
        if jobs and not force:
            refuse_jobs(jobs)
        # Tables of a later version would block the migrations, and their foreign keys the restoring.
        later = [table for table in METADATA.sorted_tables if table.name not in dumped]
        with _unreferring(engine, later):
            _run("pg_restore", url, "--clean", "--if-exists", "--single-transaction", *_PLAIN, str(file))
        with engine.begin() as connection:
            METADATA.drop_all(connection, tables=later)
            return _contents(connection)
    except SQLAlchemyError as fault:
        raise BackupError(str(getattr(fault, "orig", None) or fault).splitlines()[0]) from fault
    finally:
        engine.dispose()


def _contents(connection: Connection) -> Contents:
    names = sorted(inspect(connection).get_table_names())
    if "alembic_version" not in names:
        raise BackupError(f"the database: {NOT_OURS}")
    revision = connection.scalar(text("SELECT version_num FROM alembic_version"))
    return Contents(str(revision), {name: _count(connection, name) for name in names})


def _count(connection: Connection, table: str) -> int:
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
