"""Migrates a database to the schema of this version."""

import sqlite3

from sqlalchemy import Engine, text
from sqlalchemy.exc import SQLAlchemyError

from service.storage.database import procrastinate_schema
from service.storage.database.database import is_postgres, make_engine
from service.storage.database.new_file import make_tables
from service.storage.database.postgres_errors import is_postgres_error
from service.storage.database.revisions import (
    NewerSchemaError,
    migrations_folder,
    newest_revision,
    refuse_newer,
)

_EXPECTED = (
    SQLAlchemyError,
    sqlite3.Error,  # its file cannot be opened
    ImportError,  # the database's driver is not installed
    OSError,
    procrastinate_schema.UnknownSchemaError,
)
"""Errors that a migration may end with and that are no bugs, beside those of the driver of Postgres."""


class MigrationError(Exception):
    """The database cannot be brought to this version; the message is one line for a person."""


class EncodingError(Exception):
    """A database that cannot hold every text."""

    def __init__(self, encoding: str) -> None:
        super().__init__(
            f"the database has the encoding {encoding}, needed is UTF8: "
            "CREATE DATABASE polhode ENCODING 'UTF8' TEMPLATE template0"
        )


def migrate(url: str, *, engine_name: str = "local") -> None:
    """Create or upgrade the tables; safe to repeat, and safe for several processes at once.

    ``engine_name`` is the engine of the settings: Procrastinate has tables of its own.

    Raises
    ------
    NewerSchemaError
        A later version has made the database; it is left unchanged.
    EncodingError
        A database of Postgres has another encoding than UTF8.
    """
    engine = make_engine(url)
    try:
        _require_utf8(engine)
        stored = refuse_newer(engine)
        if stored is None and engine.dialect.name == "sqlite" and make_tables(engine):
            return
        if stored != newest_revision() or not _has_its_log(engine):
            _upgrade(engine)
        if engine_name == "procrastinate":
            procrastinate_schema.install(engine)
    finally:
        engine.dispose()


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
    """Whether a file of SQLite has its write-ahead log, which a restored one has not."""
    with engine.connect() as connection:
        return is_postgres(connection) or connection.scalar(text("PRAGMA journal_mode")) == "wal"


def _require_utf8(engine: Engine) -> None:
    with engine.connect() as connection:
        if is_postgres(connection):
            encoding = connection.scalar(text("SHOW server_encoding"))
            if encoding != "UTF8":
                raise EncodingError(str(encoding))


def migrate_or_explain(url: str, *, engine_name: str = "local") -> None:
    """Call :func:`migrate` for a command, and turn expected failures into one error.

    Raises
    ------
    MigrationError
        The database cannot be migrated, and not because of a bug.
    """
    try:
        migrate(url, engine_name=engine_name)
    except (NewerSchemaError, EncodingError) as fault:
        raise MigrationError(str(fault)) from fault
    except Exception as fault:
        if not isinstance(fault, _EXPECTED) and not is_postgres_error(fault):
            raise
        reason = str(getattr(fault, "orig", None) or fault).splitlines()[0]
        raise MigrationError(f"cannot migrate the database: {reason}") from fault
