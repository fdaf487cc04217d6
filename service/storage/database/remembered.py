"""Keeps what was read of the database as long as nobody has committed anything since.

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
from service.storage.database.database import Database
from service.storage.database.sqlite_file import DatabaseFile, DatabaseFileError

MOST = 4096
"""Things that are kept: those asked for last, a few hundred bytes each."""

Thing = TypeVar("Thing")
Read = Callable[[Database, str], Thing]
"""Reads a thing by its id in one transaction; a function of a module, which names what is read."""


class Remembered:
    """Reads things, and gives them again. Thread-safe."""

    def __init__(self, database: Database, most: int = MOST) -> None:
        self._database = database
        self._commits = None if database.file is None else _Commits(database.file)
        self._kept: Cache[tuple[object, str], _Kept[object]] = Cache(most)

    def at_hand(self, read: Read[Thing], thing_id: str) -> Thing | None:
        """Return a thing if it is known that it is still so; this waits for no disk, and needs no thread."""
        kept: _Kept[Thing] | None = self._kept.get((read, thing_id))  # type: ignore[assignment]
        if kept is None or kept.commits != self._number():
            return None
        return kept.thing

    def get(self, read: Read[Thing], thing_id: str) -> Thing:
        """Return a thing as it is now, or raise what ``read`` raises."""
        known = self.at_hand(read, thing_id)
        if known is not None:
            return known
        # Before it is read: a commit in between makes it look older than it is, never newer.
        commits = self._number()
        thing = read(self._database, thing_id)
        if commits is not None:
            self._kept.put((read, thing_id), _Kept(thing, commits))
        return thing

    def close(self) -> None:
        """Close the connection that counts."""
        if self._commits is not None:
            self._commits.close()

    def _number(self) -> int | None:
        return None if self._commits is None else self._commits.number()


class _Kept(Generic[Thing]):
    """A thing, and the number of commits before it was read."""

    __slots__ = ("commits", "thing")

    def __init__(self, thing: Thing, commits: int) -> None:
        self.thing, self.commits = thing, commits


class _Commits:
    """Asks SQLite for the number of commits, by a connection of its own, which never writes. Thread-safe."""

    def __init__(self, file: DatabaseFile) -> None:
        self._file = file
        self._lock = threading.Lock()
        self._connection: sqlite3.Connection | None = None

    def number(self) -> int | None:
        """Return the number; None if it cannot be told now: whoever reads the database learns why."""
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
