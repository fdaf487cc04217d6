"""Reads the database's clock, in seconds since 1970.

Leases are granted and checked by one clock, so that workers on machines whose
clocks differ agree on when a lease has ended.
"""

from datetime import UTC, datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.storage.tables.now import DatabaseNow

__all__ = ["DatabaseNow", "database_now", "instant", "optional_instant"]


def database_now(session: Session) -> float:
    """Return the time of the database's clock."""
    return session.scalars(select(DatabaseNow())).one()


def instant(seconds: float) -> datetime:
    """Return the UTC instant of a stored number of seconds."""
    return datetime.fromtimestamp(seconds, UTC)


def optional_instant(seconds: float | None) -> datetime | None:
    """Return :func:`instant` of a number of seconds, None if there is none."""
    return None if seconds is None else instant(seconds)
