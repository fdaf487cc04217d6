"""Tells database errors that pass (an outage) from errors in this program.

After an outage a retry succeeds: the API asks its client to try again, and a worker
keeps its result and retries. A programming error would only repeat itself. Both call
:func:`is_away`, which reads the error codes of the database, not its messages.
"""

import sqlite3
import sys
from typing import TYPE_CHECKING, TypeGuard

from sqlalchemy import exc

if TYPE_CHECKING:
    import psycopg


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
