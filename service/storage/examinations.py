"""The store of verdicts and windows that were found before; one method is one transaction."""

import logging
from collections.abc import Iterable, Sequence

from sqlalchemy import Connection, bindparam, delete, func, or_, select
from sqlalchemy.dialects import postgresql, sqlite

from service.schemas.reading.documents import Document
from service.storage.database.database import Database, is_postgres
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.operations import ExaminationRow
from service.verdicts.cache_rows import CacheRow, checksum_of, examination_version, is_sound

logger = logging.getLogger(__name__)

_ROWS = table_of(ExaminationRow)
_FIND = select(_ROWS.c.key, _ROWS.c.content, _ROWS.c.seal).where(
    _ROWS.c.key.in_(bindparam("keys", expanding=True))
)
_DAY_SECONDS = 86400.0
_FIND_FRESH = _FIND.where(_ROWS.c.used_at > DatabaseNow() - _DAY_SECONDS)
_VALUES = {
    "key": bindparam("key"),
    "version": bindparam("version"),
    "content": bindparam("content"),
    "seal": bindparam("seal"),
    "used_at": DatabaseNow(),
}
_KEYS = 500
"""Keys looked up by one statement: databases limit its parameters."""


def _upsert(insert: sqlite.Insert | postgresql.Insert) -> sqlite.Insert | postgresql.Insert:
    """Return the statement that writes rows, or replaces those that are there."""
    new = insert.excluded
    return insert.on_conflict_do_update(
        index_elements=[_ROWS.c.key],
        set_={name: new[name] for name in ("version", "content", "seal", "used_at")},
    )


_STORE_SQLITE = _upsert(sqlite.insert(_ROWS).values(_VALUES))
_STORE_POSTGRES = _upsert(postgresql.insert(_ROWS).values(_VALUES))


def find_rows(connection: Connection, keys: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Return the contents of those keys that are cached, and the keys of the rows that are damaged."""
    found: dict[str, str] = {}
    damaged: list[str] = []
    for start in range(0, len(keys), _KEYS):
        for key, bytes_, seal in connection.execute(_FIND, {"keys": keys[start : start + _KEYS]}):
            content = sound_content(key, bytes_, seal)
            if content is None:
                damaged.append(key)
            else:
                found[key] = content
    return found, damaged


def sound_content(key: str, content: bytes, seal: str) -> str | None:
    """Return the content of a row; None if it is damaged."""
    if not is_sound(key, content, seal):
        logger.warning("the kept examination %s is damaged: it is found again", key)
        return None
    return content.decode()


def store_rows(connection: Connection, entries: Iterable[CacheRow]) -> None:
    """Write entries that are not there yet; equal keys have equal contents."""
    # In the order of their keys: two processes that write the same ones must not wait for each other.
    rows = [_row(entry) for entry in sorted(_missing(connection, entries), key=lambda entry: entry.key)]
    if rows:
        connection.execute(_STORE_POSTGRES if is_postgres(connection) else _STORE_SQLITE, rows)


def _missing(connection: Connection, entries: Iterable[CacheRow]) -> list[CacheRow]:
    """Return the entries that are not there, or damaged, or were not used for a day.

    Looking first spares the lock that Postgres takes on every row it tries to write: all who submit problems
    in one potential would wait for each other.
    """
    wanted = {entry.key: entry for entry in entries}
    keys = list(wanted)
    for start in range(0, len(keys), _KEYS):
        for key, content, seal in connection.execute(_FIND_FRESH, {"keys": keys[start : start + _KEYS]}):
            if content == wanted[key].content.encode() and is_sound(key, content, seal):
                del wanted[key]
    return list(wanted.values())


def _row(entry: CacheRow) -> Document:
    content = entry.content.encode()
    return {
        "key": entry.key,
        "version": examination_version(),
        "content": content,
        "seal": checksum_of(entry.key, content),
    }


MOST_ENTRIES = 50_000
"""Entries that remain after trimming: of one or two kB each, some 50 to 100 MB."""
_BATCH = 1000
"""Entries that are deleted by one transaction."""


class ExaminationStore:
    """Keeps entries for all processes of an installation."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, keys: Sequence[str]) -> dict[str, str]:
        """Return the contents of those keys that are cached; delete the entries that are damaged."""
        with self._database.read() as session:
            found, damaged = find_rows(session.connection(), keys)
        if damaged:
            with self._database.write_rows() as connection:
                connection.execute(delete(_ROWS).where(_ROWS.c.key.in_(damaged)))
        return found

    def add(self, entries: Sequence[CacheRow]) -> None:
        """Store entries, unless they are stored already."""
        with self._database.write_rows() as connection:
            store_rows(connection, entries)

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
