"""Creates and migrates Procrastinate's own tables together with ours.

Procrastinate does not record which of its migrations a database has had; here the
comment on its table of jobs records it.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from sqlalchemy import Engine

if TYPE_CHECKING:
    import psycopg

_LOCK = 0x706F6C68
"""Advisory lock of processes that migrate: the second one finds nothing left to do."""
_VERSION = "SELECT obj_description(to_regclass('procrastinate_jobs'), 'pg_class')"


class UnknownSchemaError(Exception):
    """The database has tables of Procrastinate whose version is not recorded."""

    def __init__(self) -> None:
        super().__init__(
            "the database has tables of Procrastinate's that were not made by polhode; "
            "it needs a database, or a schema in the search path, without them"
        )


def install(engine: Engine) -> None:
    """Create or upgrade the tables in one transaction; safe to repeat.

    Raises
    ------
    UnknownSchemaError
        Another program has made tables of the same names.
    """
    # Here and not at the top: every command that migrates loads this module, few need Procrastinate.
    from procrastinate.schema import SchemaManager  # noqa: PLC0415
    from psycopg import Connection as PostgresConnection  # noqa: PLC0415

    with engine.begin() as ours:
        connection = ours.connection.driver_connection
        assert isinstance(connection, PostgresConnection)
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


def _scalar(connection: "psycopg.Connection", query: str) -> str | None:
    row = connection.execute(query.encode()).fetchone()
    return None if row is None or row[0] is None else str(row[0])
