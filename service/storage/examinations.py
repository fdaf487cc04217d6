"""The store of verdicts and windows that were found before; one method is one transaction.

Rows have keys by what a result depends on, and checksums. A verdict depends on the moments of inertia and on
the potential; windows depend on the curve too. Both are found once, and never change for equal versions of
what computes them. A row that was damaged is noticed by its checksum, and found anew.
"""

import hashlib
import json
import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

from sqlalchemy import Connection, bindparam, delete, func, or_, select
from sqlalchemy.dialects import postgresql, sqlite

from service.dynamics.numerics import NUMERICS
from service.schemas.reading.documents import Document, Part
from service.storage.database.database import Database, is_postgres
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.operations import ExaminationRow
from service.versions import version_of


def checksum_of(key: str, content: bytes) -> str:
    """Return the checksum, in hexadecimal, of a row; it covers the key: rows cannot be swapped."""
    return hashlib.sha256(key.encode() + b"\n" + content).hexdigest()


def is_sound(key: str, content: bytes, checksum: str) -> bool:
    """Tell whether a row is as it was written."""
    return checksum_of(key, content) == checksum


EXAMINATION_CODE = 3
"""Grows whenever a problem may get another verdict, proof, counterexample or window, in any form."""

_OF_CURVE = ("type", "lambda", "nu", "g1_sign", "g3_sign")
"""Members of a canonical motion that say on which curve it lies: not its window, and not its start."""


@dataclass(frozen=True, slots=True)
class CacheRow:
    """A verdict or the windows of a curve, as JSON text, under its key."""

    key: str
    """SHA-256, in hexadecimal, of what the content depends on."""
    content: str


@dataclass(frozen=True, slots=True)
class Examination:
    """The data about the examination of a problem that are stored with its job."""

    windows: str
    """Key of the windows of its curve."""
    seconds: float
    """Seconds that it took before the job was queued; next to nothing where its result was cached."""


@dataclass(frozen=True, slots=True)
class ExaminationKeys:
    """The keys of what is cached of one problem."""

    verdict: str
    windows: str
    answer: str
    """Key of the whole answer, which depends on the window, the start and the kind of times too."""


@cache
def examination_version() -> str:
    """Return the versions of all that computes verdicts and windows: rows of another one are not used."""
    parts = (version_of("polhode"), NUMERICS, EXAMINATION_CODE, version_of("python-flint"))
    return "/".join(map(str, parts))


def keys_of(canonical: Part) -> ExaminationKeys:
    """Return the keys of a canonical problem with a planar motion."""
    setting, motion = _setting(canonical), canonical["motion"]
    curve = {name: motion[name] for name in _OF_CURVE if name in motion}
    ways = [canonical["method"] == "integration", "periods" in canonical["time"], canonical.get("accept")]
    return ExaminationKeys(
        verdict=_key("verdict", *setting),
        windows=_key("windows", *setting, curve),
        answer=_key("answer", *setting, motion, ways),
    )


def _setting(canonical: Part) -> tuple[object, ...]:
    """Return the moments and the potential; B only where a formula may name it: it plays no other part."""
    body, potential = canonical["body"], canonical["potential"]
    names_B = "B" in json.dumps(potential)
    return body["A"], body["C"], body["B"] if names_B else None, potential


def _key(kind: str, *parts: object) -> str:
    content = json.dumps([kind, examination_version(), *parts], sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(content.encode()).hexdigest()


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
