"""The base of all tables: names of constraints, how Python types are stored, and the database's clock.

Instants are seconds since 1970, UTC, as doubles by the database's clock. A
double keeps microseconds, is the same type in SQLite and Postgres, and leases
can be compared and prolonged with plain arithmetic in either.
"""

from enum import StrEnum
from typing import ClassVar, cast

from sqlalchemy import JSON, Dialect, Double, LargeBinary, MetaData, String, Table, TypeDecorator
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.orm import DeclarativeBase
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement

from service.schemas.reading.documents import Document

ASKED_DOCUMENT = JSON(none_as_null=True).with_variant(JSONB(none_as_null=True), "postgresql")
"""A small flat document whose values conditions compare: on Postgres parsed once, when it is written."""


class Base(DeclarativeBase):
    """Constraints are named by rule, so that every migration can address them."""

    metadata = MetaData(
        naming_convention={
            "pk": "pk_%(table_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s",
            "uq": "uq_%(table_name)s_%(column_0_name)s",
            "ix": "ix_%(table_name)s_%(column_0_name)s",
            "ck": "ck_%(table_name)s_%(constraint_name)s",
        }
    )
    type_annotation_map: ClassVar[dict[object, object]] = {
        str: String(64),
        float: Double(),
        bytes: LargeBinary(),
        Document: JSON(),
    }


def table_of(row: type[Base]) -> Table:
    """Return the table of a mapped class.

    Statements that every job runs are built once, on tables: this takes a tenth of
    the time of building them anew on mapped classes.
    """
    return cast(Table, row.__table__)


class Word(TypeDecorator[str]):
    """One word of an enumeration; another one is refused when it is written or compared with.

    The table itself has no check of it, so that a word that is added needs no migration: ``polhode doctor``
    finds what another program has written.
    """

    impl = String
    cache_ok = True

    def __init__(self, words: type[StrEnum]) -> None:
        super().__init__(16)
        self.words = frozenset(word.value for word in words)

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Return the word as it is stored.

        Raises
        ------
        ValueError
            The enumeration has no such word.
        """
        if value is not None and value not in self.words:
            raise ValueError(f"{value!r} is none of {', '.join(sorted(self.words))}")
        return value


class DatabaseNow(FunctionElement[float]):
    """The instant at which the statement runs."""

    type = Double()
    inherit_cache = True


@compiles(DatabaseNow, "sqlite")
def _sqlite(element: DatabaseNow, compiler: SQLCompiler, **_: object) -> str:
    # unixepoch('subsec') would need SQLite 3.42; Julian days resolve 0.04 ms.
    return "((julianday('now') - 2440587.5) * 86400.0)"


@compiles(DatabaseNow, "postgresql")
def _postgresql(element: DatabaseNow, compiler: SQLCompiler, **_: object) -> str:
    # Not now(), which is the start of the transaction.
    return "CAST(EXTRACT(EPOCH FROM clock_timestamp()) AS double precision)"
