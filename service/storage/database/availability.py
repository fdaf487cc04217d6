"""Tells database errors that pass (an outage) from errors in this program; guards the file of SQLite.

After an outage a retry succeeds: the API asks its client to try again, and a worker
keeps its result and retries. A programming error would only repeat itself. Both call
:func:`is_away`, which reads the error codes of the database, not its messages.

The SQLite file is created with access for its owner only. A process that has a file open can go on writing
to it after the file was deleted or its name was given to another file. Such writes are lost when the last
process closes it. So a transaction begins only if the name still leads to the file that was opened first, and
is acknowledged only if it still does at the end.
"""

import sqlite3
import sys
from typing import TYPE_CHECKING, TypeGuard

from sqlalchemy import exc

if TYPE_CHECKING:
    import psycopg
import contextlib
import os
import stat
from pathlib import Path
from urllib.parse import quote

from sqlalchemy import URL


def is_postgres_error(error: object) -> "TypeGuard[psycopg.Error]":
    """Tell whether an error is one of the driver of Postgres, without loading it."""
    driver = sys.modules.get("psycopg")
    return driver is not None and isinstance(error, driver.Error)


_SQLITE_AWAY = frozenset(
    {
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_IOERR,
        sqlite3.SQLITE_LOCKED,
        sqlite3.SQLITE_NOMEM,
        sqlite3.SQLITE_PROTOCOL,
        sqlite3.SQLITE_READONLY,
    }
)

_POSTGRES_AWAY = (
    "08",  # the connection failed
    "25006",  # read only: another server has taken over
    "25P03",  # this process was suspended in the middle of a transaction
    "40",  # rolled back for the sake of another transaction
    "53",  # disk, memory or connections are used up
    "55P03",  # a lock was not granted in time
    "57",  # cancelled, shut down, not started yet
    "58",  # the system below: input and output
)
"""Prefixes of the SQLSTATE codes of temporary errors."""
_POSTGRES_STOPPED = "57014"


def is_away(error: BaseException) -> bool:
    """Tell whether the failed operation can succeed, unchanged, once the database is available again."""
    match error:
        case exc.DBAPIError():
            return error.connection_invalidated or (error.orig is not None and is_away(error.orig))
        # A pool without a free connection; a session whose connection broke before.
        case exc.TimeoutError() | exc.DisconnectionError() | exc.PendingRollbackError():
            return True
        case sqlite3.Error():
            return _sqlite_is_away(error)
    return is_postgres_error(error) and _postgres_is_away(error)


def is_stopped(error: BaseException) -> bool:
    """Tell whether a statement was stopped because it took long."""
    if isinstance(error, sqlite3.Error):
        return getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_INTERRUPT
    return is_postgres_error(error) and error.sqlstate == _POSTGRES_STOPPED


def _sqlite_is_away(error: sqlite3.Error) -> bool:
    # The lowest eight bits are the primary code; the upper bits only refine it.
    code = getattr(error, "sqlite_errorcode", None)
    return code is not None and code & 0xFF in _SQLITE_AWAY


def _postgres_is_away(error: "psycopg.Error") -> bool:
    if error.sqlstate is not None:
        return error.sqlstate.startswith(_POSTGRES_AWAY)
    # No code: the server was not reached, or the connection to it was lost.
    import psycopg  # noqa: PLC0415  # loaded already, since this is one of its errors

    return isinstance(error, psycopg.OperationalError)


PRIVATE_MODE = 0o600
"""Problems and results are private; SQLite gives the journal files beside a database the same mode."""
LOG_BYTES = 32 * 2**20
"""The write-ahead log is cut down to so much when no reader needs what is in it."""
_LOG_SECONDS = 0.1
"""How long that may wait for readers, and keep writers waiting."""
LEAST_FREE_BYTES = 256 * 1024
"""A disk with less room is as good as full: one transaction may need more."""


class DatabaseFileError(sqlite3.OperationalError):
    """The file is missing, or is not the one that was opened. It may come back."""

    sqlite_errorcode = sqlite3.SQLITE_CANTOPEN


class DatabaseFile:
    """The database file of one process. Thread-safe."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._opened: tuple[int, int] | None = None

    def prepare(self, *, create: bool) -> None:
        """Make sure that a new connection opens the right file; ``create`` an empty one if there was none.

        Raises
        ------
        DatabaseFileError
            There is none, or another one.
        """
        if create and self._opened is None:
            create_private(self.path)
        self.require_same()

    def opened(self) -> None:
        """Remember the file that was opened, or refuse it if it is not the one that was opened first."""
        if self._opened is None:
            self._opened = self._identity()
        self.require_same()

    def require_same(self) -> None:
        """Raise :class:`DatabaseFileError` unless the name leads to the file that was opened."""
        found = self._identity()
        if self._opened is not None and found != self._opened:
            raise DatabaseFileError(
                "the file of the database was replaced by another one while it was in use; "
                "stop the service and its workers, and start them again"
            )

    def fault(self) -> str | None:
        """Return why the database cannot be written to; None if no reason is known."""
        try:
            self.require_same()
            disk = os.statvfs(self.path)
        except DatabaseFileError as fault:
            return str(fault)
        except OSError as fault:
            return fault.strerror or type(fault).__name__
        blocks = disk.f_bfree if os.geteuid() == 0 else disk.f_bavail
        if disk.f_blocks and blocks * disk.f_frsize < LEAST_FREE_BYTES:
            return "the disk of the database is full"
        return None

    def log_bytes(self) -> int:
        """Return the size of the write-ahead log."""
        try:
            return self._beside("-wal").stat().st_size
        except OSError:
            return 0

    def shrink_log(self) -> None:
        """Empty a log that has grown, into the file, unless a reader needs it; hardly wait for that.

        SQLite itself only begins it anew: a reader that stayed open for long leaves a large one for ever.
        """
        if self.log_bytes() <= LOG_BYTES:
            return
        address = f"file:{quote(str(self.path))}?mode=rw"
        with contextlib.closing(sqlite3.connect(address, uri=True, timeout=_LOG_SECONDS)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")

    def _beside(self, end: str) -> Path:
        return self.path.with_name(self.path.name + end)

    def mode_warning(self) -> str | None:
        """Return which of its files others than the owner may use, and the remedy; None if there is none."""
        for path in (self.path, self._beside("-wal"), self._beside("-shm")):
            with contextlib.suppress(FileNotFoundError):
                mode = stat.S_IMODE(path.stat().st_mode)
                if mode & ~PRIVATE_MODE:
                    return (
                        f"{path} has the mode {mode:04o}, so that others than its owner may use it; "
                        f"`chmod {PRIVATE_MODE:o}` keeps what is in it private"
                    )
        return None

    def _identity(self) -> tuple[int, int]:
        try:
            found = self.path.stat()
        except OSError as fault:
            if self._opened is None:
                reason = f"cannot be opened: {fault.strerror}; polhode migrate makes it"
            else:
                reason = f"was deleted or moved while it was in use: {fault.strerror}"
            raise DatabaseFileError(f"the file of the database {reason}") from fault
        return found.st_dev, found.st_ino


def file_of(url: URL) -> DatabaseFile | None:
    """Return the file of a database; None if the database is in memory or its name is a URI."""
    name = url.database
    if url.get_backend_name() != "sqlite" or not name or name == ":memory:" or name.startswith("file:"):
        return None
    return DatabaseFile(Path(name).absolute())


def create_private(path: Path) -> None:
    """Create an empty file that only its owner may use, if there is none.

    Raises
    ------
    DatabaseFileError
        It cannot be created.
    """
    try:
        os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, PRIVATE_MODE))
    except FileExistsError:
        return
    except OSError as fault:
        raise DatabaseFileError(f"{path} cannot be created: {fault.strerror}") from fault
