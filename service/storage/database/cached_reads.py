"""Caches what was read from the database as long as nobody has committed anything since.

SQLite counts the commits of all other connections, those of other processes too, and tells
the number from memory that all of them share (``PRAGMA data_version``): it reads no page
and waits for nobody. So what has been deleted or changed, by whomever, is never taken from
here. Postgres has no such number: there everything is read each time.
"""

import sqlite3
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from service.cache import Cache
from service.storage.database.availability import DatabaseFile, DatabaseFileError
from service.storage.database.database import Database

MOST = 4096
"""Cached values: those asked for last, a few hundred bytes each."""

Value = TypeVar("Value")
Read = Callable[[Database, str], Value]
"""Reads a value by the id of its resource in one transaction; a function of a module: it names the value."""


class CachedReads:
    """Reads values, and returns them again while they are current. Thread-safe."""

    def __init__(self, database: Database, most: int = MOST) -> None:
        self._database = database
        self._commits = None if database.file is None else _Commits(database.file)
        self._cache: Cache[tuple[object, str], _Entry[object]] = Cache(most)

    def cached(self, read: Read[Value], resource_id: str) -> Value | None:
        """Return a cached value if it is current, else None; this waits for no disk, and needs no thread."""
        entry: _Entry[Value] | None = self._cache.get((read, resource_id))  # type: ignore[assignment]
        if entry is None or entry.commits != self._number():
            return None
        return entry.value

    def get(self, read: Read[Value], resource_id: str) -> Value:
        """Return a value as it is now, or raise what ``read`` raises."""
        value = self.cached(read, resource_id)
        if value is not None:
            return value
        # Before it is read: a commit in between makes it look older than it is, never newer.
        commits = self._number()
        value = read(self._database, resource_id)
        if commits is not None:
            self._cache.put((read, resource_id), _Entry(value, commits))
        return value

    def close(self) -> None:
        """Close the connection that counts."""
        if self._commits is not None:
            self._commits.close()

    def _number(self) -> int | None:
        return None if self._commits is None else self._commits.number()


class _Entry(Generic[Value]):
    """A value, and the number of commits before it was read."""

    __slots__ = ("commits", "value")

    def __init__(self, value: Value, commits: int) -> None:
        self.value, self.commits = value, commits


class _Commits:
    """Asks SQLite for the number of commits, by a connection of its own, which never writes. Thread-safe."""

    def __init__(self, file: DatabaseFile) -> None:
        self._file = file
        self._lock = threading.Lock()
        self._connection: sqlite3.Connection | None = None

    def number(self) -> int | None:
        """Return the number; None if it cannot be read now: whoever reads the database learns why."""
        try:
            # The connection would go on counting in a file that was deleted or replaced.
            self._file.require_same()
            with self._lock:
                if self._connection is None:
                    self._connection = self._opened()
                return int(self._connection.execute("PRAGMA data_version").fetchone()[0])
        except sqlite3.Error:
            return None

    def close(self) -> None:
        """Close the connection."""
        with self._lock:
            if self._connection is not None:
                self._connection.close()

    def _opened(self) -> sqlite3.Connection:
        """Return the connection. There is never a second one: its numbers would be others."""
        connection = sqlite3.connect(
            f"{self._file.path.as_uri()}?mode=rw",
            uri=True,
            timeout=0.0,
            isolation_level=None,
            check_same_thread=False,
        )
        try:
            self._file.require_same()
        except DatabaseFileError:
            connection.close()
            raise
        return connection
