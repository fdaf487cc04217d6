"""Connects Alembic to the database; run by service.storage.database.migration."""

import sqlite3
import time

from alembic import context
from sqlalchemy import Connection, Engine

from service.storage.tables.schema import METADATA

PATIENCE_SECONDS, PAUSE_SECONDS = 30.0, 0.05


def set_write_ahead_log(engine: Engine) -> None:
    """Switch a SQLite file to WAL. It is a property of the file, and cannot change inside a transaction.

    Of two processes that switch a new file at once SQLite refuses one without waiting, since each would
    wait for the other.
    """
    deadline = time.monotonic() + PATIENCE_SECONDS
    connection = engine.raw_connection()
    try:
        while True:
            try:
                connection.cursor().execute("PRAGMA journal_mode = WAL")
            except sqlite3.OperationalError as refused:
                if "locked" not in str(refused) or time.monotonic() > deadline:
                    raise
                time.sleep(PAUSE_SECONDS)
            else:
                return
    finally:
        connection.close()


def hold_references(connection: Connection) -> None:
    """Let SQLite rebuild a table that others refer to; else dropping the old one would empty the others.

    It cannot be switched within a transaction, and ends with the connection.
    """
    connection.connection.cursor().execute("PRAGMA foreign_keys = OFF")


def require_references(connection: Connection) -> None:
    """Refuse a migration after which something refers to nothing."""
    broken = connection.exec_driver_sql("PRAGMA foreign_key_check").all()
    if broken:
        raise RuntimeError(f"the migration would leave references to nothing: {broken[:5]}")


def run_migrations(engine: Engine) -> None:
    """Upgrade within one transaction, so that a failed migration leaves the old schema."""
    if engine.dialect.name == "sqlite":
        set_write_ahead_log(engine)
    # The writer's BEGIN: of two processes that migrate at once, the second finds nothing left to do.
    with engine.execution_options(sqlite_begin="BEGIN IMMEDIATE").connect() as connection:
        if engine.dialect.name == "sqlite":
            hold_references(connection)
        context.configure(
            connection=connection,
            target_metadata=METADATA,
            transactional_ddl=True,
            render_as_batch=engine.dialect.name == "sqlite",
        )
        with context.begin_transaction():
            context.run_migrations()
            if engine.dialect.name == "sqlite":
                require_references(connection)


run_migrations(context.config.attributes["engine"])
