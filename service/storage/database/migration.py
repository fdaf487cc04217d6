"""Finds which schema a database has; makes the tables of a new one, and migrates older ones to this version.

New tables are made from the models, all at once: Alembic, and the migrations one after the other, would take
a tenth of the time in which a service starts.
"""

import functools
import re
import sqlite3
import time
from pathlib import Path

from sqlalchemy import Connection, Engine, inspect, text
from sqlalchemy.exc import SQLAlchemyError

from service.storage.database.availability import is_postgres_error
from service.storage.database.database import is_postgres, make_engine
from service.storage.tables.operations import METADATA
from service.storage.tables.solutions import triggers
from service.versions import version_of

_REVISION = re.compile(r'^revision = "(\w+)"\ndown_revision = (?:None|"(\w+)")$', re.MULTILINE)


_EARLIER = frozenset(f"{number:04}" for number in range(1, 15))
"""Schemas from before the first one of ``migrations``."""
_LAST_THAT_UPGRADES = "d38f90f"
"""The revision of the project that brings them to the first schema of ``migrations``."""


class UnknownRevisionError(Exception):
    """The database has a schema that this version can neither use nor upgrade."""

    def __init__(self, stored: str) -> None:
        super().__init__(f"the database has the schema {stored}, {origin_of(stored)}")
        self.stored = stored


def migrations_folder() -> Path:
    """Return the folder of the migrations: in the package if installed, else at the top of the checkout."""
    packaged = Path(__file__).parents[1] / "_migrations"
    return packaged if packaged.is_dir() else Path(__file__).parents[3] / "migrations"


@functools.cache
def known_revisions() -> frozenset[str]:
    """Return the schemas that this version can upgrade to its own."""
    return frozenset(_written_before())


@functools.cache
def newest_revision() -> str:
    """Return the schema that this version works with."""
    (head,) = known_revisions() - set(_written_before().values())
    return head


@functools.cache
def _written_before() -> dict[str, str | None]:
    """Return all revisions, each with the one before it, as the migrations state them.

    Alembic would load all its dialects, and every migration, to tell the same.
    """
    texts = [file.read_text(encoding="utf-8") for file in (migrations_folder() / "versions").glob("*.py")]
    return dict(_REVISION.search(text).groups() for text in texts)  # type: ignore[union-attr,misc]


def origin_of(stored: str) -> str:
    """Return which version made a schema that this one does not know, and the remedy."""
    this = f"this is version {version_of('polhode')} with the schema {newest_revision()}"
    if stored in _EARLIER:
        return (
            f"made by an early version; {this}. `polhode migrate` of the project's revision "
            f"{_LAST_THAT_UPGRADES} upgrades it first, then that of this version"
        )
    remedy = "Use the later version, or restore a backup from before the upgrade"
    return f"made by a later version; {this}. {remedy}"


def stored_revision(connection: Connection) -> str | None:
    """Return the schema of a database; None if it has no tables of ours."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    found = connection.scalar(text("SELECT version_num FROM alembic_version"))
    return None if found is None else str(found)


def refuse_unknown(engine: Engine) -> str | None:
    """Return the schema of a database; raise :class:`UnknownRevisionError` if it is not known here."""
    with engine.connect() as connection:
        stored = stored_revision(connection)
    if stored is not None and stored not in known_revisions():
        raise UnknownRevisionError(stored)
    return stored


def fault_of(stored: str | None) -> str | None:
    """Return why this version cannot work with a schema, and the remedy; None if it can."""
    wanted = newest_revision()
    if stored == wanted:
        return None
    if stored is None:
        return f"it has no tables of polhode, needed is the schema {wanted}; polhode migrate makes them"
    if stored in known_revisions():
        return f"schema {stored}, needed is {wanted}; polhode migrate brings it there"
    return str(UnknownRevisionError(stored))


_EXPECTED = (
    SQLAlchemyError,
    sqlite3.Error,  # its file cannot be opened
    ImportError,  # the database's driver is not installed
    OSError,
)
"""Errors that a migration may end with and that are no bugs, beside those of the driver of Postgres."""
_STAMP = (
    "CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL, "
    "CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num))"
)
"""Alembic's own table, as it makes it."""
_LOCK = 0x706F6C67
"""Postgres' advisory lock of processes that migrate: the second one finds nothing left to do."""
_PATIENCE_SECONDS, _PAUSE_SECONDS = 30.0, 0.05


class MigrationError(Exception):
    """The database cannot be brought to this version; the message is one line for a person."""


class EncodingError(Exception):
    """A database that cannot hold every text."""

    def __init__(self, encoding: str) -> None:
        super().__init__(
            f"the database has the encoding {encoding}, needed is UTF8: "
            "CREATE DATABASE polhode ENCODING 'UTF8' TEMPLATE template0"
        )


def migrate(url: str) -> None:
    """Create or upgrade the tables; safe to repeat, and safe for several processes at once.

    Raises
    ------
    UnknownRevisionError
        A later version has made the database; it is left unchanged.
    EncodingError
        A database of Postgres has another encoding than UTF8.
    """
    engine = make_engine(url)
    try:
        _require_utf8(engine)
        stored = refuse_unknown(engine)
        if engine.dialect.name == "sqlite" and not _has_its_log(engine):
            _set_write_ahead_log(engine)
        if stored is None:
            _make_tables(engine)
        elif stored != newest_revision():
            _upgrade(engine)
    finally:
        engine.dispose()


def _make_tables(engine: Engine) -> None:
    """Make all tables or, if one cannot be made, none; of several processes one makes them."""
    # The writer's BEGIN: whoever comes second finds the tables.
    with engine.execution_options(sqlite_begin="BEGIN IMMEDIATE").begin() as connection:
        as_one_writer(connection)
        if stored_revision(connection) is not None:
            return
        METADATA.create_all(connection, checkfirst=False)
        for statement in triggers(engine.dialect.name):
            connection.exec_driver_sql(statement)
        connection.execute(text(_STAMP))
        connection.execute(text("INSERT INTO alembic_version VALUES (:it)"), {"it": newest_revision()})


def as_one_writer(connection: Connection) -> None:
    """Let no other process migrate until this transaction ends; BEGIN IMMEDIATE does so on SQLite."""
    if is_postgres(connection):
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": _LOCK})


def _set_write_ahead_log(engine: Engine) -> None:
    """Switch a SQLite file to WAL. It is a property of the file, and cannot change inside a transaction.

    Of two processes that switch a new file at once SQLite refuses one without waiting, since each would
    wait for the other.
    """
    deadline = time.monotonic() + _PATIENCE_SECONDS
    connection = engine.raw_connection()
    try:
        while True:
            try:
                connection.cursor().execute("PRAGMA journal_mode = WAL")
            except sqlite3.OperationalError as refused:
                if "locked" not in str(refused) or time.monotonic() > deadline:
                    raise
                time.sleep(_PAUSE_SECONDS)
            else:
                return
    finally:
        connection.close()


def _upgrade(engine: Engine) -> None:
    # Here and not at the top: a database that has been migrated needs no Alembic.
    from alembic import command  # noqa: PLC0415
    from alembic.config import Config  # noqa: PLC0415

    config = Config()
    # Alembic's options interpolate %, which a folder's name may contain.
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    config.attributes["engine"] = engine
    command.upgrade(config, "head")


def _has_its_log(engine: Engine) -> bool:
    """Whether a file of SQLite has its write-ahead log, which a new or restored one has not."""
    with engine.connect() as connection:
        return str(connection.scalar(text("PRAGMA journal_mode"))) == "wal"


def _require_utf8(engine: Engine) -> None:
    with engine.connect() as connection:
        if is_postgres(connection):
            encoding = connection.scalar(text("SHOW server_encoding"))
            if encoding != "UTF8":
                raise EncodingError(str(encoding))


def migrate_or_explain(url: str) -> None:
    """Call :func:`migrate` for a command, and turn expected failures into one error.

    Raises
    ------
    MigrationError
        The database cannot be migrated, and not because of a bug.
    """
    try:
        migrate(url)
    except (UnknownRevisionError, EncodingError) as fault:
        raise MigrationError(str(fault)) from fault
    except Exception as fault:
        if not isinstance(fault, _EXPECTED) and not is_postgres_error(fault):
            raise
        reason = str(getattr(fault, "orig", None) or fault).splitlines()[0]
        raise MigrationError(f"cannot migrate the database: {reason}") from fault
