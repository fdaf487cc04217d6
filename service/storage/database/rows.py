"""Ids, instants, and the rows of a page of a long list: common to all tables.

Ids are UUIDs, version 7 of RFC 9562: they grow with time. Instants are read from the
database's clock, in seconds since 1970. Leases are granted and checked by one clock, so
that workers on machines whose clocks differ agree on when a lease has ended.

A page is read in two steps: first its ids, from an index alone, then its rows. A database
skips the entries of an offset one by one; rows hold whole documents, so skipping rows
would read the table, and skipping ids reads one narrow index.
"""

import secrets
import threading
import time
import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TypeVar

from sqlalchemy import select
from sqlalchemy.orm import Session
from sqlalchemy.orm.interfaces import ORMOption

from service.storage.tables.base import DatabaseNow
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SolutionRow, SweepRow

_TICKS_PER_MILLISECOND = 4096


class IdSource:
    """Ids that grow strictly within this process, and with the clock between processes.

    The 48 bits of milliseconds are followed by 12 bits of their fraction; two
    ids within one such tick of 0.24 µs, or after a clock was set back, take the
    next tick.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last = 0

    def __call__(self) -> str:
        """Return a new id in the canonical text form."""
        with self._lock:
            tick = max(time.time_ns() * _TICKS_PER_MILLISECOND // 1_000_000, self._last + 1)
            self._last = tick
        milliseconds, fraction = divmod(tick, _TICKS_PER_MILLISECOND)
        value = milliseconds << 80 | 0x7 << 76 | fraction << 64 | 0b10 << 62 | secrets.randbits(62)
        return str(uuid.UUID(int=value))


new_id = IdSource()


def first_id(at: float) -> str:
    """Return the least id that could be made at an instant, in seconds since 1970, or later."""
    return str(uuid.UUID(int=int(at * 1000.0) << 80))


def is_id(text: str) -> bool:
    """Tell whether ``text`` is a UUID: a database with a UUID type fails on a query for any other text."""
    try:
        return str(uuid.UUID(text)) == text.lower()
    except ValueError:
        return False


def database_now(session: Session) -> float:
    """Return the time of the database's clock."""
    return session.scalars(select(DatabaseNow())).one()


def instant(seconds: float) -> datetime:
    """Return the UTC instant of a stored number of seconds."""
    return datetime.fromtimestamp(seconds, UTC)


def optional_instant(seconds: float | None) -> datetime | None:
    """Return :func:`instant` of a number of seconds, None if there is none."""
    return None if seconds is None else instant(seconds)


Row = TypeVar("Row", JobRow, SolutionRow, SweepRow)


def rows_of_page(session: Session, row: type[Row], ids: Sequence[str], *options: ORMOption) -> list[Row]:
    """Return the rows with these ids, in their order."""
    if not ids:
        return []
    rows = session.scalars(select(row).where(row.id.in_(ids)).options(*options))
    by_id = {each.id: each for each in rows}
    # On Postgres a row may be deleted between the two statements.
    return [by_id[each] for each in ids if each in by_id]
