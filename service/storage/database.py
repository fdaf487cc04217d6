"""Connections and transactions.

SQLite needs care to serve several processes at once. A writer begins with
BEGIN IMMEDIATE: a transaction that reads first and wants to write later cannot
wait for another writer, it fails at once with "database is locked". Readers
begin plainly and, under WAL, neither wait nor make anybody wait.

``synchronous`` stays FULL. NORMAL would not lose consistency, but under WAL it
forgets the last commits when the power fails, and a job that was acknowledged
would be gone; FULL costs one fsync a commit (0.3 ms on the disk it was measured on).
"""

import json
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from sqlite3 import Connection as SqliteConnection

from psycopg import Connection as PostgresConnection
from sqlalchemy import Connection, Engine, create_engine, event, exc, make_url
from sqlalchemy.orm import Session
from sqlalchemy.pool import ConnectionPoolEntry

from service.storage.database_file import DatabaseFile, DatabaseFileError, file_of
from service.storage.faults import chosen_fault

_BEGIN = "sqlite_begin"

BUSY_SECONDS = 30.0
"""How long one waits for another writer of SQLite; ``?timeout=…`` in the URL says otherwise."""
CONNECT_SECONDS = 10
"""How long a server of Postgres may take to answer; ``?connect_timeout=…`` in the URL says otherwise."""
IDLE_SECONDS = 60
"""After this long without a word in the middle of a transaction Postgres gives its locks back."""


class Database:
    """An engine with a way to read and a way to write. Safe to share between threads, not across a fork.

    The database must exist: :func:`service.storage.migration.migrate` makes it.
    """

    def __init__(self, url: str) -> None:
        self.file = file_of(make_url(url))
        self.engine = make_engine(url, file=self.file)
        self._writer = self.engine.execution_options(**{_BEGIN: "BEGIN IMMEDIATE"})
        self._fault = chosen_fault()

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Open a transaction that sees one state of the database and changes nothing."""
        with Session(self.engine) as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        """Open a transaction that is committed at the end, or rolled back by any exception."""
        with Session(self._writer, expire_on_commit=False) as session, self._committed(session.begin()):
            yield session

    @contextmanager
    def write_rows(self, *, is_work: bool = True) -> Iterator[Connection]:
        """Open a transaction as :meth:`write` does, for statements on tables: nobody keeps track of rows.

        Where ``is_work`` is false, tests that choose a commit to die at do not count it.
        """
        with self._writer.connect() as connection, self._committed(connection.begin(), is_work=is_work):
            yield connection

    @contextmanager
    def _committed(
        self, transaction: AbstractContextManager[object], *, is_work: bool = True
    ) -> Iterator[None]:
        fault = self._fault if is_work else None
        with transaction:
            yield
            if fault is not None:
                fault.reach("before")
        if fault is not None:
            fault.reach("after")
        if self.file is not None:
            # What was committed to a file without a name is lost: nobody may be told that it is kept.
            try:
                self.file.require_same()
            except DatabaseFileError as lost:
                raise exc.OperationalError("COMMIT", {}, lost) from lost

    def close(self) -> None:
        """Close every pooled connection."""
        self.engine.dispose()


def is_postgres(connection: Connection) -> bool:
    """Say whether a connection's database is Postgres; else it is SQLite."""
    return connection.dialect.name == "postgresql"


def make_engine(url: str, *, file: DatabaseFile | None = None) -> Engine:
    """Return an engine for ``url`` (SQLite or Postgres) with this project's settings.

    ``file`` is that of SQLite if it must exist; else it is created, for its owner alone.
    """
    engine = create_engine(url, json_serializer=_strict_json, connect_args=_arguments(url))
    if engine.dialect.name == "sqlite":
        _watch(engine, file or file_of(engine.url), create=file is None)
        event.listen(engine, "connect", _configure_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    else:
        event.listen(engine, "connect", _configure_postgres)
    return engine


def _watch(engine: Engine, file: DatabaseFile | None, *, create: bool) -> None:
    """Let every transaction begin with a look at whether the file is the one that was opened first."""
    if file is None:
        return

    def prepare(*_: object) -> None:
        file.prepare(create=create)

    def opened(*_: object) -> None:
        file.opened()

    def check(*_: object) -> None:
        file.require_same()

    event.listen(engine, "do_connect", prepare)
    event.listen(engine, "connect", opened)
    event.listen(engine, "checkout", check)


def _arguments(url: str) -> dict[str, object]:
    """Return the time limits and the encoding of a new connection, but for those that the URL has itself."""
    asked = make_url(url)
    arguments: dict[str, dict[str, object]] = {
        "sqlite": {"timeout": BUSY_SECONDS},
        # Without an encoding of its own, a connection to a database of none gives bytes for texts.
        "postgresql": {"connect_timeout": CONNECT_SECONDS, "client_encoding": "utf8"},
    }
    ours = arguments.get(asked.get_backend_name(), {})
    return {name: value for name, value in ours.items() if name not in asked.query}


def _strict_json(document: object) -> str:
    """Refuse NaN and infinities: they are not JSON, and Postgres would refuse them later."""
    return json.dumps(document, allow_nan=False)


def _configure_sqlite(connection: SqliteConnection, _: ConnectionPoolEntry) -> None:
    # sqlite3 must not begin transactions by itself: it would do so too late.
    connection.isolation_level = None
    connection.execute("PRAGMA foreign_keys = ON")
    connection.execute("PRAGMA synchronous = FULL")


def _configure_postgres(connection: PostgresConnection, _: ConnectionPoolEntry) -> None:
    # A worker whose host sleeps or is cut off in the middle of a transaction must not keep a job's row
    # locked: nobody could take the job over. Not by a parameter of the connection, which poolers refuse.
    with connection.cursor() as cursor:
        cursor.execute(f"SET idle_in_transaction_session_timeout = '{IDLE_SECONDS}s'")
    connection.commit()


def _begin_sqlite(connection: Connection) -> None:
    statement: str = connection.get_execution_options().get(_BEGIN, "BEGIN")
    connection.exec_driver_sql(statement)
