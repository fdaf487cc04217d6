"""Answers to requests with an Idempotency-Key, kept for a day; receipts of requests that may come twice."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from sqlalchemy import Connection, bindparam, delete, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.sql.dml import ReturningInsert

from service.schemas.reading.documents import Document
from service.storage.database.database import Database, is_postgres
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.operations import IdempotencyKeyRow

KEPT_SECONDS = 86400.0
"""How long an answer is given again."""

Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class GivenKey:
    """The Idempotency-Key of a request."""

    principal: str
    """Id of the API key that sent it, empty if there are no keys: nobody can use another's keys."""
    key: str
    fingerprint: str
    """Hash of method, path, query and body: the same key with another request is a mistake."""


@dataclass(frozen=True, slots=True)
class GivenAnswer:
    """An answer as it was sent."""

    status: int
    headers: Mapping[str, str]
    body: bytes


@dataclass(frozen=True, slots=True)
class Receipt(Generic[Made]):
    """The key and the answer, which a store writes in the transaction that makes something."""

    given: GivenKey
    answer: Callable[[Made], GivenAnswer]


class KeyTakenError(Exception):
    """Another request with the same key was committed first; nothing was stored for this one."""


def fingerprint(*parts: bytes) -> str:
    """Return the fingerprint of a request by its parts."""
    digest = hashlib.sha256()
    for part in parts:
        digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()


_KEYS = table_of(IdempotencyKeyRow)
_THIS = _KEYS.c.principal == bindparam("whose"), _KEYS.c.key == bindparam("name")
_IS_OVER = _KEYS.c.created_at < DatabaseNow() - KEPT_SECONDS
_FIND = select(_KEYS).where(*_THIS, _KEYS.c.created_at >= DatabaseNow() - KEPT_SECONDS)
_REPLACE = (
    update(_KEYS)
    .where(*_THIS, _KEYS.c.fingerprint == bindparam("print"))
    .values(status=bindparam("code"), headers=bindparam("head"), body=bindparam("content"))
)
_WRITTEN = ("principal", "key", "fingerprint", "status", "headers", "body")


def _write(insert: postgresql.Insert | sqlite.Insert) -> ReturningInsert[tuple[str]]:
    """Return the statement that writes a key unless there is one of less than a day ago.

    An older one, which nobody has deleted yet, is as good as none.
    """
    statement = insert.values({name: bindparam(name) for name in _WRITTEN} | {"created_at": DatabaseNow()})
    return statement.on_conflict_do_update(
        index_elements=[_KEYS.c.principal, _KEYS.c.key],
        set_={name: statement.excluded[name] for name in (*_WRITTEN, "created_at")},
        where=_IS_OVER,
    ).returning(_KEYS.c.key)


_WRITE_SQLITE, _WRITE_POSTGRES = _write(sqlite.insert(_KEYS)), _write(postgresql.insert(_KEYS))
_BATCH = 1000
"""Answers that one transaction deletes: it holds the write lock for milliseconds."""


class IdempotencyStore:
    """Finds, replaces and forgets answers."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def find(self, given: GivenKey) -> tuple[str, GivenAnswer] | None:
        """Return the answer to the first request with a key, and that request's fingerprint."""
        with self._database.read_rows() as connection:
            row = connection.execute(_FIND, _place(given)).one_or_none()
        if row is None:
            return None
        return row.fingerprint, GivenAnswer(row.status, row.headers, bytes(row.body))

    def replace(self, given: GivenKey, answer: GivenAnswer) -> None:
        """Keep a later answer to the same request: the client waited, and was sent this one."""
        values = {
            **_place(given),
            "print": given.fingerprint,
            "code": answer.status,
            "head": dict(answer.headers),
            "content": answer.body,
        }
        with self._database.write_rows() as connection:
            connection.execute(_REPLACE, values)

    def forget_old(self) -> int:
        """Delete the answers that are no longer given again; return how many there were."""
        total = 0
        old = select(_KEYS.c.principal, _KEYS.c.key).where(_IS_OVER).limit(_BATCH)
        while True:
            with self._database.read() as session:
                found = session.execute(old).all()
            for principal, key in found:
                here = _KEYS.c.principal == principal, _KEYS.c.key == key
                # The condition once more: the key may have been used again in the meantime.
                with self._database.write_rows(is_work=False) as connection:
                    total += connection.execute(delete(_KEYS).where(*here, _IS_OVER)).rowcount
            if len(found) < _BATCH:
                return total


def write_key(connection: Connection, given: GivenKey, answer: GivenAnswer) -> None:
    """Write a key and its answer in the transaction of what the request made.

    Raises
    ------
    KeyTakenError
        Another request with the key was committed first; roll the transaction back.
    """
    values = {
        "principal": given.principal,
        "key": given.key,
        "fingerprint": given.fingerprint,
        "status": answer.status,
        "headers": dict(answer.headers),
        "body": answer.body,
    }
    if connection.scalar(_WRITE_POSTGRES if is_postgres(connection) else _WRITE_SQLITE, values) is None:
        raise KeyTakenError


def _place(given: GivenKey) -> Document:
    return {"whose": given.principal, "name": given.key}
