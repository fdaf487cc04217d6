"""The store of verdicts and windows in SQL; one method is one transaction."""

from collections.abc import Sequence

from sqlalchemy import delete, func, or_, select

from service.storage.database.database import Database
from service.storage.examinations.kept_rows import find_rows, keep_rows
from service.storage.tables.base import table_of
from service.storage.tables.examinations import ExaminationRow
from service.verdicts.cache_rows import Entry, examination_version

MOST_ENTRIES = 50_000
"""Entries that remain after trimming: of one or two kB each, some 50 to 100 MB."""
_BATCH = 1000
"""Entries that are deleted by one transaction."""

_ROWS = table_of(ExaminationRow)


class ExaminationStore:
    """Keeps entries for all processes of an installation."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, keys: Sequence[str]) -> dict[str, str]:
        """Return the contents of those keys that are kept; delete the entries that are damaged."""
        with self._database.read() as session:
            found, damaged = find_rows(session.connection(), keys)
        if damaged:
            with self._database.write_rows() as connection:
                connection.execute(delete(_ROWS).where(_ROWS.c.key.in_(damaged)))
        return found

    def add(self, entries: Sequence[Entry]) -> None:
        """Keep entries, unless they are kept already."""
        with self._database.write_rows() as connection:
            keep_rows(connection, entries)

    def trim(self, *, most: int = MOST_ENTRIES, dry_run: bool = False) -> int:
        """Delete what other versions found, and what was not used for longest; return how many.

        ``most`` entries remain.

        Several processes may do it at once; each deletion is counted once.
        """
        with self._database.read() as session:
            newest = select(_ROWS.c.used_at).order_by(_ROWS.c.used_at.desc())
            last = session.scalar(newest.offset(most - 1).limit(1)) if most else float("inf")
            foreign = _ROWS.c.version != examination_version()
            condition = foreign if last is None else or_(foreign, _ROWS.c.used_at < last)
            count = session.scalar(select(func.count()).select_from(_ROWS).where(condition)) or 0
        if dry_run or not count:
            return count
        total = 0
        some = select(_ROWS.c.key).where(condition).limit(_BATCH)
        while True:
            with self._database.write_rows() as connection:
                deleted = connection.execute(delete(_ROWS).where(_ROWS.c.key.in_(some))).rowcount
            if not deleted:
                return total
            total += deleted
