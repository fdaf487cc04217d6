"""Bring a database to the schema of this version."""

import sqlite3

import psycopg
from alembic import command
from alembic.config import Config
from sqlalchemy.exc import SQLAlchemyError

from service.storage.database import make_engine
from service.storage.jobs import procrastinate_schema
from service.storage.revisions import NewerSchemaError, migrations_folder, refuse_newer


class MigrationError(Exception):
    """The database cannot be brought to this version; the message is one line for a person."""


def migrate(url: str, *, engine_name: str = "local") -> None:
    """Create or upgrade the tables; harmless if nothing is left to do, or if several do it at once.

    ``engine_name`` is that of the settings: some engines have tables of their own.

    Raises
    ------
    NewerSchemaError
        A later version has made the database; it is as it was.
    """
    config = Config()
    # Alembic's options interpolate %, which a folder's name may contain.
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    engine = make_engine(url)
    config.attributes["engine"] = engine
    try:
        refuse_newer(engine)
        command.upgrade(config, "head")
        if engine_name == "procrastinate":
            procrastinate_schema.install(engine)
    finally:
        engine.dispose()


def migrate_or_explain(url: str, *, engine_name: str = "local") -> None:
    """Do as :func:`migrate` does, for a command.

    Raises
    ------
    MigrationError
        It cannot be done, for a reason that is no mistake of the program.
    """
    try:
        migrate(url, engine_name=engine_name)
    except NewerSchemaError as fault:
        raise MigrationError(str(fault)) from fault
    except (
        SQLAlchemyError,
        sqlite3.Error,  # its file cannot be opened
        psycopg.Error,
        ImportError,  # the database's driver is not installed
        OSError,
        procrastinate_schema.UnknownSchemaError,
    ) as fault:
        reason = str(getattr(fault, "orig", None) or fault).splitlines()[0]
        raise MigrationError(f"cannot migrate the database: {reason}") from fault
