"""Opens connections and transactions on SQLite and Postgres.

SQLite needs care to serve several processes at once. A writer begins with
BEGIN IMMEDIATE: a transaction that reads first and wants to write later cannot
wait for another writer, it fails at once with "database is locked". Readers
use a plain BEGIN and, under WAL, neither wait nor block others.

``synchronous`` stays FULL. NORMAL would keep the database consistent, but under WAL it
loses the last commits when the power fails, and with them an acknowledged job;
FULL costs one fsync a commit (0.3 ms on the disk it was measured on).

``POLHODE_FAULT=commit:before:3`` is fault injection for tests: it kills the process with SIGKILL
when it is about to commit its third transaction, ``commit:after:3`` as soon as it has. Like a
power cut, this writes and releases nothing; before and after a commit are the two moments that
differ. Outside of tests the variable is not set and nothing happens.
"""

import json
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from sqlite3 import Connection as SqliteConnection
from typing import TYPE_CHECKING, TypeVar

from sqlalchemy import Connection, Engine, create_engine, event, exc, make_url
from sqlalchemy.orm import Session
from sqlalchemy.pool import ConnectionPoolEntry

from service.schemas.reading.documents import Document
from service.storage.database.availability import (
    LOG_BYTES,
    DatabaseFile,
    DatabaseFileError,
    file_of,
    is_stopped,
)

if TYPE_CHECKING:  # SQLAlchemy loads the driver of the database that is used, and no other
    from psycopg import Connection as PostgresConnection
import os
import signal
from typing import Literal, get_args

T = TypeVar("T")

_BEGIN = "sqlite_begin"

BUSY_SECONDS = 30.0
"""How long a writer waits for another writer of SQLite; ``?timeout=…`` in the URL overrides it."""
CONNECT_SECONDS = 10
"""How long a Postgres server may take to answer; ``?connect_timeout=…`` in the URL overrides it."""
SEARCH_SECONDS = 10.0
"""Seconds that a query of a client may take of the database."""
_STEPS = 100_000
"""Steps of SQLite's machine, made in some milliseconds, after which it looks at the clock."""
IDLE_SECONDS = 60
"""Postgres ends a transaction, and releases its locks, that has been idle for so long."""
_INTERRUPT_SECONDS = 5.0
"""How long a Postgres server may take to accept that a statement is to end."""
_AGAIN_SECONDS = 0.5
"""Until a connection that is still used is interrupted once more."""


class NobodyWaitsError(Exception):
    """Whoever wanted what is read has gone."""


class WantedRead:
    """Reads for somebody who may leave: another thread ends them, even in the midst of a statement."""

    def __init__(self) -> None:
        self._left = threading.Condition()
        self._connections: list[object] = []
        """The driver's connections by which it reads at this moment."""
        self._is_over = False

    def run(self, work: Callable[[], T]) -> T:
        """Return ``work()``, of which every :meth:`Database.read` in this thread is meant.

        Raises
        ------
        NobodyWaitsError, sqlalchemy.exc.DBAPIError
            It was ended, between two statements or in one.
        """
        token = _WANTED.set(self)
        try:
            return work()
        finally:
            _WANTED.reset(token)

    def end(self) -> None:
        """End it, and wait until it has ended."""
        # Under the lock: nobody else is given a connection whose statement is about to be interrupted.
        with self._left:
            self._is_over = True
            while self._connections:
                for connection in self._connections:
                    _interrupt(connection)
                # Again, since it may have been between two statements.
                self._left.wait(_AGAIN_SECONDS)

    @contextmanager
    def by(self, connection: Connection) -> Iterator[None]:
        """Read by a connection, unless it is over."""
        driver = connection.connection.driver_connection
        with self._left:
            if self._is_over:
                raise NobodyWaitsError
            self._connections.append(driver)
        try:
            yield
        finally:
            with self._left:
                self._connections.remove(driver)
                self._left.notify_all()


_WANTED: ContextVar[WantedRead | None] = ContextVar("wanted", default=None)


@contextmanager
def _interruptible(connection: Callable[[], Connection]) -> Iterator[None]:
    reading = _WANTED.get()
    if reading is None:
        yield
    else:
        with reading.by(connection()):
            yield


def _interrupt(driver: object) -> None:
    if isinstance(driver, SqliteConnection):
        with suppress(sqlite3.Error):  # it is broken
            driver.interrupt()
        return
    import psycopg  # noqa: PLC0415  # loaded already, since this is one of its connections

    if isinstance(driver, psycopg.Connection):
        with suppress(psycopg.Error):
            driver.cancel_safe(timeout=_INTERRUPT_SECONDS)


class SearchTimeError(Exception):
    """A query takes longer than it may."""

    def __init__(self, seconds: float) -> None:
        super().__init__(f"the database was stopped after {seconds:g} seconds")


class Database:
    """An engine with a way to read and a way to write. Safe to share between threads, not across a fork.

    The database must exist: :func:`service.storage.database.migration.migrate` makes it.

    Parameters
    ----------
    announces_jobs
        Whether Postgres tells workers of other machines of queued jobs.
    """

    def __init__(self, url: str, *, announces_jobs: bool = False) -> None:
        self.announces_jobs = announces_jobs
        self.file = file_of(make_url(url))
        self.engine = make_engine(url, file=self.file)
        self._writer = self.engine.execution_options(**{_BEGIN: "BEGIN IMMEDIATE"})
        self._fault = chosen_fault()

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Open a transaction that sees one state of the database and changes nothing."""
        with Session(self.engine) as session, _interruptible(session.connection):
            yield session

    @contextmanager
    def search(self, seconds: float = SEARCH_SECONDS) -> Iterator[Session]:
        """Open a transaction as :meth:`read` does, whose statements are stopped where they take long.

        Raises
        ------
        SearchTimeError
            A statement was stopped after ``seconds``: on SQLite after all so far have taken as long.
        """
        with self.read() as session:
            try:
                with _stopped_after(session, seconds):
                    yield session
            except exc.DBAPIError as fault:
                if fault.orig is not None and is_stopped(fault.orig):
                    raise SearchTimeError(seconds) from fault
                raise

    @contextmanager
    def read_rows(self) -> Iterator[Connection]:
        """Open a transaction as :meth:`read` does, for statements on tables, without the ORM."""
        with self.engine.connect() as connection, _interruptible(lambda: connection):
            yield connection

    @contextmanager
    def write(self) -> Iterator[Session]:
        """Open a transaction that is committed at the end, or rolled back by any exception."""
        with Session(self._writer, expire_on_commit=False) as session, self._committed(session.begin()):
            yield session

    @contextmanager
    def write_rows(self, *, is_work: bool = True) -> Iterator[Connection]:
        """Open a transaction as :meth:`write` does, for statements on tables, without the ORM.

        Fault injection, which kills the process at a chosen commit, counts it only if ``is_work``.
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
            # A commit to a file that was deleted or replaced is lost: it must not be acknowledged.
            try:
                self.file.require_same()
            except DatabaseFileError as lost:
                raise exc.OperationalError("COMMIT", {}, lost) from lost

    def close(self) -> None:
        """Close every pooled connection."""
        self.engine.dispose()


@contextmanager
def _stopped_after(session: Session, seconds: float) -> Iterator[None]:
    connection = session.connection()
    if is_postgres(connection):
        # Until the end of the transaction.
        connection.exec_driver_sql(f"SET LOCAL statement_timeout = {round(1000 * seconds)}")
        yield
        return
    driver, end = connection.connection.driver_connection, time.monotonic() + seconds
    assert isinstance(driver, SqliteConnection)  # what SQLAlchemy does not tell of a connection of its own
    driver.set_progress_handler(lambda: time.monotonic() > end, _STEPS)
    try:
        yield
    finally:
        driver.set_progress_handler(None, 0)


def is_postgres(connection: Connection) -> bool:
    """Tell whether a connection's database is Postgres; else it is SQLite."""
    return connection.dialect.name == "postgresql"


def make_engine(url: str, *, file: DatabaseFile | None = None) -> Engine:
    """Return an engine for ``url`` (SQLite or Postgres) with this project's settings.

    ``file`` is the SQLite file if it must exist; else it is created with access for its owner only.
    """
    # NaN and infinities are refused: they are not JSON, and Postgres would refuse them later.
    strict_json = partial(json.dumps, allow_nan=False)
    engine = create_engine(url, json_serializer=strict_json, connect_args=_arguments(url))
    if engine.dialect.name == "sqlite":
        _watch(engine, file or file_of(engine.url), create=file is None)
        event.listen(engine, "connect", _configure_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
    else:
        event.listen(engine, "connect", _configure_postgres)
    return engine


def _watch(engine: Engine, file: DatabaseFile | None, *, create: bool) -> None:
    """Make every transaction check first that the file is the one that was opened first."""
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


def _arguments(url: str) -> Document:
    """Return the time limits and the encoding of a new connection, except those given in the URL."""
    asked = make_url(url)
    arguments: dict[str, dict[str, object]] = {
        "sqlite": {"timeout": BUSY_SECONDS},
        # In a database without an encoding (SQL_ASCII), texts are returned as bytes unless one is set here.
        "postgresql": {"connect_timeout": CONNECT_SECONDS, "client_encoding": "utf8"},
    }
    ours = arguments.get(asked.get_backend_name(), {})
    return {name: value for name, value in ours.items() if name not in asked.query}


def _configure_sqlite(connection: SqliteConnection, _: ConnectionPoolEntry) -> None:
    # sqlite3 must not begin transactions by itself: it does so only at the first write.
    connection.isolation_level = None
    connection.execute("PRAGMA foreign_keys = ON")
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute(f"PRAGMA journal_size_limit = {LOG_BYTES}")


def _configure_postgres(connection: "PostgresConnection", _: ConnectionPoolEntry) -> None:
    # A worker whose host is suspended or cut off in the middle of a transaction must not keep a job's row
    # locked: no other could take the job. Set by SQL, since poolers refuse it as a connection parameter.
    with connection.cursor() as cursor:
        cursor.execute(f"SET idle_in_transaction_session_timeout = '{IDLE_SECONDS}s'")
    connection.commit()


def _begin_sqlite(connection: Connection) -> None:
    statement: str = connection.get_execution_options().get(_BEGIN, "BEGIN")
    connection.exec_driver_sql(statement)


VARIABLE = "POLHODE_FAULT"

Moment = Literal["before", "after"]


class PlannedKill:
    """Kills this process at the ``number``-th time that ``moment`` comes."""

    def __init__(self, moment: Moment, number: int) -> None:
        self._moment = moment
        self._left = number

    def reach(self, moment: Moment) -> None:
        """Count a moment, and kill the process at the chosen one."""
        if moment == self._moment:
            self._left -= 1
            if self._left == 0:
                os.kill(os.getpid(), signal.SIGKILL)


def chosen_fault() -> PlannedKill | None:
    """Return the fault that the environment asks for.

    Raises
    ------
    ValueError
        The variable has another value: a test that relied on it would prove nothing.
    """
    wish = os.environ.get(VARIABLE)
    if wish is None:
        return None
    for moment in get_args(Moment):
        prefix = f"commit:{moment}:"
        if wish.startswith(prefix):
            return PlannedKill(moment, int(wish.removeprefix(prefix)))
    raise ValueError(f"{VARIABLE}={wish}: accepted are commit:before:N and commit:after:N")
