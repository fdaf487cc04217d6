"""How Alembic reaches the database; run by service.storage.migration."""

from alembic import context
from sqlalchemy import Engine

from service.storage.tables import Base


def set_write_ahead_log(engine: Engine) -> None:
    """Switch a SQLite file to WAL. It is a property of the file, and cannot change inside a transaction."""
    connection = engine.raw_connection()
    try:
        connection.cursor().execute("PRAGMA journal_mode = WAL")
    finally:
        connection.close()


def run_migrations(engine: Engine) -> None:
    """Upgrade within one transaction, so that a failed migration leaves the old schema."""
    if engine.dialect.name == "sqlite":
        set_write_ahead_log(engine)
    # The writer's BEGIN: of two processes that migrate at once, the second finds nothing left to do.
    with engine.execution_options(sqlite_begin="BEGIN IMMEDIATE").connect() as connection:
        context.configure(
            connection=connection,
            target_metadata=Base.metadata,
            transactional_ddl=True,
            render_as_batch=engine.dialect.name == "sqlite",
        )
        with context.begin_transaction():
            context.run_migrations()


run_migrations(context.config.attributes["engine"])
