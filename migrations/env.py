"""Connects Alembic to the database; run by service.storage.database.migration."""

from alembic import context
from sqlalchemy import Connection, Engine

from service.storage.database.migration import as_one_writer
from service.storage.tables.operations import METADATA


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
            as_one_writer(connection)
            context.run_migrations()
            if engine.dialect.name == "sqlite":
                require_references(connection)


run_migrations(context.config.attributes["engine"])
