"""Finds which schema a database has, and whether this version can use or upgrade it."""

import functools
import re
from pathlib import Path

from sqlalchemy import Connection, Engine, inspect, text

from service.versions import version_of

_REVISION = re.compile(r'^revision = "(\w+)"\ndown_revision = (?:None|"(\w+)")$', re.MULTILINE)


_EARLIER = frozenset(f"{number:04}" for number in range(1, 15))
"""Schemas from before the first one of ``migrations``."""
_LAST_THAT_UPGRADES = "d38f90f"
"""The revision of the project that brings them to the first schema of ``migrations``."""


class UnknownRevisionError(Exception):
    """The database has a schema that this version can neither use nor upgrade."""

    def __init__(self, stored: str) -> None:
        super().__init__(f"the database has the schema {stored}, {origin_of(stored)}")
        self.stored = stored


def migrations_folder() -> Path:
    """Return the folder of the migrations: in the package if installed, else at the top of the checkout."""
    packaged = Path(__file__).parents[1] / "_migrations"
    return packaged if packaged.is_dir() else Path(__file__).parents[3] / "migrations"


@functools.cache
def known_revisions() -> frozenset[str]:
    """Return the schemas that this version can upgrade to its own."""
    return frozenset(_written_before())


@functools.cache
def newest_revision() -> str:
    """Return the schema that this version works with."""
    (head,) = known_revisions() - set(_written_before().values())
    return head


@functools.cache
def _written_before() -> dict[str, str | None]:
    """Return all revisions, each with the one before it, as the migrations state them.

    Alembic would load all its dialects, and every migration, to tell the same.
    """
    texts = [file.read_text(encoding="utf-8") for file in (migrations_folder() / "versions").glob("*.py")]
    return dict(_REVISION.search(text).groups() for text in texts)  # type: ignore[union-attr,misc]


def origin_of(stored: str) -> str:
    """Return which version made a schema that this one does not know, and the remedy."""
    this = f"this is version {version_of('polhode')} with the schema {newest_revision()}"
    if stored in _EARLIER:
        return (
            f"made by an early version; {this}. `polhode migrate` of the project's revision "
            f"{_LAST_THAT_UPGRADES} upgrades it first, then that of this version"
        )
    remedy = "Use the later version, or restore a backup from before the upgrade"
    return f"made by a later version; {this}. {remedy}"


def stored_revision(connection: Connection) -> str | None:
    """Return the schema of a database; None if it has no tables of ours."""
    if not inspect(connection).has_table("alembic_version"):
        return None
    found = connection.scalar(text("SELECT version_num FROM alembic_version"))
    return None if found is None else str(found)


def refuse_unknown(engine: Engine) -> str | None:
    """Return the schema of a database; raise :class:`UnknownRevisionError` if it is not known here."""
    with engine.connect() as connection:
        stored = stored_revision(connection)
    if stored is not None and stored not in known_revisions():
        raise UnknownRevisionError(stored)
    return stored


def fault_of(stored: str | None) -> str | None:
    """Return why this version cannot work with a schema, and the remedy; None if it can."""
    wanted = newest_revision()
    if stored == wanted:
        return None
    if stored is None:
        return f"it has no tables of polhode, needed is the schema {wanted}; polhode migrate makes them"
    if stored in known_revisions():
        return f"schema {stored}, needed is {wanted}; polhode migrate brings it there"
    return str(UnknownRevisionError(stored))
