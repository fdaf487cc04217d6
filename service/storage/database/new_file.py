"""Makes the tables of a new SQLite file at once, as all migrations together leave them.

``migrations/new_file.sql`` has the statements, which tests compare with what the migrations make. Alembic,
and the migrations one after the other, would take a tenth of the time in which a service starts.
"""

import sqlite3
import time

from sqlalchemy import Engine

from service.storage.database.revisions import migrations_folder

SCRIPT, END = "new_file.sql", ";\n\n"
"""The file in the folder of the migrations, and how each of its statements ends."""
_PATIENCE_SECONDS, _PAUSE_SECONDS = 30.0, 0.05


def make_tables(engine: Engine) -> bool:
    """Make all tables of a SQLite file that is empty; return False if it is not, and leave it as it is.

    There are all of them or none, and of several processes one makes them.
    """
    set_write_ahead_log(engine)
    # The writer's BEGIN: whoever comes second finds the tables.
    with engine.execution_options(sqlite_begin="BEGIN IMMEDIATE").begin() as connection:
        if connection.exec_driver_sql("SELECT count(*) FROM sqlite_master").scalar():
            return False
        for statement in statements():
            connection.exec_driver_sql(statement)
    return True


def statements() -> list[str]:
    """Return the statements that make the tables."""
    text = (migrations_folder() / SCRIPT).read_text(encoding="utf-8")
    return [statement for statement in text.split(END) if statement.strip()]


def set_write_ahead_log(engine: Engine) -> None:
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
