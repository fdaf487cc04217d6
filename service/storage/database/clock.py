"""Reads the database's clock, in seconds since 1970.

Leases are granted and checked by one clock, so that workers on machines whose
clocks differ agree on when a lease has ended.
"""

from datetime import UTC, datetime

from sqlalchemy import Double, select
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.orm import Session
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement


class DatabaseNow(FunctionElement[float]):
    """The instant at which the statement runs."""

    type = Double()
    inherit_cache = True


def database_now(session: Session) -> float:
    """Return the time of the database's clock."""
    return session.scalars(select(DatabaseNow())).one()


def instant(seconds: float) -> datetime:
    """Return the UTC instant of a stored number of seconds."""
    return datetime.fromtimestamp(seconds, UTC)


def optional_instant(seconds: float | None) -> datetime | None:
    """Return :func:`instant` of a number of seconds, None if there is none."""
    return None if seconds is None else instant(seconds)


@compiles(DatabaseNow, "sqlite")
def _sqlite(element: DatabaseNow, compiler: SQLCompiler, **_: object) -> str:
    # unixepoch('subsec') would need SQLite 3.42; Julian days resolve 0.04 ms.
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(DatabaseNow, "postgresql")
def _postgresql(element: DatabaseNow, compiler: SQLCompiler, **_: object) -> str:
    # Not now(), which is the start of the transaction.
    return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) AS double precision)"
