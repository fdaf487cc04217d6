"""Procrastinate's own tables: made, and brought to the installed version, with ours.

Which of its migrations the database has seen is kept as the comment on its
table of jobs; Procrastinate itself keeps it nowhere.
"""

from pathlib import Path

import psycopg
from procrastinate.schema import SchemaManager
from sqlalchemy import Engine

_LOCK = 0x706F6C68
"""Of those who migrate: the second finds nothing left to do."""
_VERSION = "SELECT obj_description(to_regclass('procrastinate_jobs'), 'pg_class')"


class UnknownSchemaError(Exception):
    """There are tables of Procrastinate's of a version that nobody knows."""

    def __init__(self) -> None:
        super().__init__(
            "the database has tables of Procrastinate's that were not made by polhode; "
            "it needs a database, or a schema in the search path, without them"
        )


def install(engine: Engine) -> None:
    """Create or upgrade the tables in one transaction; harmless if nothing is left to do.

    Raises
    ------
    UnknownSchemaError
        Somebody else has made tables of the same names.
    """
    with engine.begin() as ours:
        connection = ours.connection.driver_connection
        assert isinstance(connection, psycopg.Connection)
        connection.execute("SELECT pg_advisory_xact_lock(%s)", [_LOCK])
        files = sorted(Path(SchemaManager.get_migrations_path()).glob("*.sql"))
        newest = files[-1].stem
        seen = _scalar(connection, _VERSION)
        if seen is not None:
            for file in files:
                if file.stem > seen:
                    connection.execute(file.read_bytes())
        elif _scalar(connection, "SELECT to_regclass('procrastinate_jobs')::text") is None:
            connection.execute(SchemaManager.get_schema())
        else:
            raise UnknownSchemaError
        connection.execute(f"COMMENT ON TABLE procrastinate_jobs IS '{newest}'".encode())


def _scalar(connection: psycopg.Connection, query: str) -> str | None:
    row = connection.execute(query.encode()).fetchone()
    return None if row is None or row[0] is None else str(row[0])
