"""Which errors say that the database is away for a while, and which are mistakes of ours.

What is away comes back: the API asks its client to try again, a worker keeps
its result and tries again itself. A mistake only repeats itself. Both judge by
:func:`is_away`, hence by the codes of the database and not by words.
"""

import sqlite3

import psycopg
from sqlalchemy import exc

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
    "25P03",  # this process slept in the middle of a transaction
    "40",  # rolled back for the sake of another transaction
    "53",  # disk, memory or connections are used up
    "55P03",  # a lock was not had in time
    "57",  # cancelled, shut down, not started yet
    "58",  # the system below: input and output
)
"""How the SQLSTATE of what passes begins."""


def is_away(error: BaseException) -> bool:
    """Tell whether what failed may be expected to work again, unchanged, once the database is back."""
    match error:
        case exc.DBAPIError():
            return error.connection_invalidated or (error.orig is not None and is_away(error.orig))
        # A pool without a free connection; a session whose connection broke before.
        case exc.TimeoutError() | exc.DisconnectionError() | exc.PendingRollbackError():
            return True
        case sqlite3.Error():
            return _sqlite_is_away(error)
        case psycopg.Error():
            return _postgres_is_away(error)
    return False


def _sqlite_is_away(error: sqlite3.Error) -> bool:
    # The upper bits say more exactly what the lowest eight say.
    code = getattr(error, "sqlite_errorcode", None)
    return code is not None and code & 0xFF in _SQLITE_AWAY


def _postgres_is_away(error: psycopg.Error) -> bool:
    if error.sqlstate is not None:
        return error.sqlstate.startswith(_POSTGRES_AWAY)
    # Before there is a server to give a code, or after it has gone.
    return isinstance(error, psycopg.OperationalError)
