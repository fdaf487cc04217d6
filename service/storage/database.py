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
from contextlib import contextmanager
from sqlite3 import Connection as SqliteConnection

from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.orm import Session
from sqlalchemy.pool import ConnectionPoolEntry

_BEGIN = "sqlite_begin"


class Database:
    """An engine with a way to read and a way to write. Safe to share between threads, not across a fork."""

    def __init__(self, url: str) -> None:
        self.engine = make_engine(url)
        self._writer = self.engine.execution_options(**{_BEGIN: "BEGIN IMMEDIATE"})

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Open a transaction that sees one state of the database and changes nothing."""
        with Session(self.engine) as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        """Open a transaction that is committed at the end, or rolled back by any exception."""
        with Session(self._writer, expire_on_commit=False) as session, session.begin():
            yield session

    def close(self) -> None:
        """Close every pooled connection."""
        self.engine.dispose()


def make_engine(url: str) -> Engine:
    """Return an engine for ``url`` (SQLite or Postgres) with this project's settings."""
    engine = create_engine(url, json_serializer=_strict_json)
    if engine.dialect.name == "sqlite":
        event.listen(engine, "connect", _configure_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def _strict_json(document: object) -> str:
    """Refuse NaN and infinities: they are not JSON, and Postgres would refuse them later."""
    return json.dumps(document, allow_nan=False)


def _configure_sqlite(connection: SqliteConnection, _: ConnectionPoolEntry) -> None:
    # sqlite3 must not begin transactions by itself: it would do so too late.
    connection.isolation_level = None
    # First of all, since the pragmas themselves may have to wait for a lock.
    connection.execute("PRAGMA busy_timeout = 30000")
    connection.execute("PRAGMA foreign_keys = ON")
    connection.execute("PRAGMA synchronous = FULL")


def _begin_sqlite(connection: Connection) -> None:
    statement: str = connection.get_execution_options().get(_BEGIN, "BEGIN")
    connection.exec_driver_sql(statement)
