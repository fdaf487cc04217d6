"""API keys in SQL: created, listed, revoked, with their stored bytes; and answers under an Idempotency-Key.

These answers are kept for a day; receipts are of requests that may come twice.
"""

import hashlib
import secrets
import string
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Generic, TypeVar

from sqlalchemy import Connection, bindparam, delete, func, or_, select, update
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.sql.dml import ReturningInsert

from service.jobs.keys import ApiKey, KeyNotFoundError, Role, key_hash, key_prefix
from service.jobs.queue import Lane
from service.jobs.records import FINISHED, POINTS_PER_JOB, JobState
from service.schemas.reading.documents import Document
from service.storage.database.database import Database, is_postgres
from service.storage.database.rows import instant, new_id, optional_instant
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import JobRow
from service.storage.tables.operations import ApiKeyRow, IdempotencyKeyRow
from service.storage.tables.solutions import SweepRow

_KEYS = table_of(ApiKeyRow)
_ALPHABET = string.digits + string.ascii_uppercase + string.ascii_lowercase
_LIVE = [state.value for state in JobState if state not in FINISHED]
_PUBLIC_CHARACTERS = 8
_SECRET_CHARACTERS = 43
"""62^43 > 2^256."""
USED_SECONDS = 60.0
"""How much the recorded last use of a key may lag behind."""


@dataclass(frozen=True, slots=True)
class KeyLimits:
    """The limits of a key; None means that of the installation's settings."""

    requests_per_second: float | None = None
    queued_jobs: int | None = None
    stored_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class KeyList:
    """All keys, and the time of the database's clock when they were read."""

    keys: tuple[ApiKey, ...]
    now: datetime


class KeyStore:
    """Writes and reads the keys of this installation."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(
        self, role: Role, *, name: str = "", seconds: float | None = None, limits: KeyLimits | None = None
    ) -> tuple[ApiKey, str]:
        """Store a new key that expires after ``seconds``; return it and its text, which is not kept."""
        given = limits or KeyLimits()
        text = _new_text()
        prefix = key_prefix(text)
        assert prefix is not None
        with self._database.write() as session:
            now = session.scalars(select(DatabaseNow())).one()
            row = ApiKeyRow(
                id=new_id(),
                prefix=prefix,
                hash=key_hash(text),
                name=name,
                role=role.value,
                created_at=now,
                expires_at=None if seconds is None else now + seconds,
                requests_per_second=given.requests_per_second,
                max_queued_jobs=given.queued_jobs,
                max_stored_bytes=given.stored_bytes,
                stored_bytes=0,
            )
            session.add(row)
            return _key_of(row), text

    def all(self) -> KeyList:
        """Return all keys, oldest first, also expired and revoked ones."""
        with self._database.read() as session:
            now = session.scalars(select(DatabaseNow())).one()
            rows = session.scalars(select(ApiKeyRow).order_by(ApiKeyRow.id))
            return KeyList(tuple(_key_of(row) for row in rows), instant(now))

    def revoke(self, prefix: str) -> ApiKey:
        """Revoke a key for good; doing it again changes nothing.

        Raises
        ------
        KeyNotFoundError
            There is no key of that prefix.
        """
        with self._database.write() as session:
            row = session.scalar(select(ApiKeyRow).where(ApiKeyRow.prefix == prefix))
            if row is None:
                raise KeyNotFoundError(prefix)
            if row.revoked_at is None:
                row.revoked_at = session.scalars(select(DatabaseNow())).one()
            return _key_of(row)

    def touch(self, key_id: str) -> None:
        """Record the use of a key, unless some process recorded one within the last minute."""
        noted_before = DatabaseNow() - USED_SECONDS
        statement = (
            update(ApiKeyRow)
            .where(
                ApiKeyRow.id == key_id,
                or_(ApiKeyRow.last_used_at.is_(None), ApiKeyRow.last_used_at <= noted_before),
            )
            .values(last_used_at=DatabaseNow())
        )
        with self._database.write() as session:
            session.execute(statement)

    def live_jobs(self, key_id: str | None, *, at_most: int) -> int:
        """Return how many jobs of a key are queued or running, counting no further than ``at_most``.

        A sweep counts by the points that it has left, :data:`POINTS_PER_JOB` of
        them as a job. None counts what was submitted without a key.
        """
        some = (
            select(JobRow.key_id)
            .where(JobRow.key_id == key_id, JobRow.state.in_(_LIVE), JobRow.lane < Lane.SWEEP.value)
            .limit(at_most)
        )
        left = SweepRow.points - SweepRow.done
        of_sweeps = select(func.sum((left + (POINTS_PER_JOB - 1)) // POINTS_PER_JOB)).where(
            SweepRow.key_id == key_id, SweepRow.state.in_(_LIVE)
        )
        with self._database.read() as session:
            jobs = session.scalar(select(func.count()).select_from(some.subquery())) or 0
            return min(jobs + int(session.scalar(of_sweeps) or 0), at_most)


def charge(connection: Connection, key_id: str | None, size: int) -> None:
    """Add the bytes that this transaction stored for a key; a negative number if it removed some.

    Call it last in a transaction: others that store for the same key wait until its end.
    """
    if key_id is not None:
        connection.execute(
            update(_KEYS).where(_KEYS.c.id == key_id).values(stored_bytes=_KEYS.c.stored_bytes + size)
        )


def _new_text() -> str:
    public, secret = (
        "".join(secrets.choice(_ALPHABET) for _ in range(count))
        for count in (_PUBLIC_CHARACTERS, _SECRET_CHARACTERS)
    )
    return f"plh_{public}_{secret}"


def _key_of(row: ApiKeyRow) -> ApiKey:
    return ApiKey(
        id=row.id,
        prefix=row.prefix,
        hash=row.hash,
        name=row.name,
        role=Role(row.role),
        created_at=instant(row.created_at),
        expires_at=optional_instant(row.expires_at),
        revoked_at=optional_instant(row.revoked_at),
        last_used_at=optional_instant(row.last_used_at),
        requests_per_second=row.requests_per_second,
        max_queued_jobs=row.max_queued_jobs,
        max_stored_bytes=row.max_stored_bytes,
        stored_bytes=row.stored_bytes,
    )


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


_ANSWERS = table_of(IdempotencyKeyRow)
_THIS = _ANSWERS.c.principal == bindparam("whose"), _ANSWERS.c.key == bindparam("name")
_IS_OVER = _ANSWERS.c.created_at < DatabaseNow() - KEPT_SECONDS
_FIND = select(_ANSWERS).where(*_THIS, _ANSWERS.c.created_at >= DatabaseNow() - KEPT_SECONDS)
_REPLACE = (
    update(_ANSWERS)
    .where(*_THIS, _ANSWERS.c.fingerprint == bindparam("print"))
    .values(status=bindparam("code"), headers=bindparam("head"), body=bindparam("content"))
)
_WRITTEN = ("principal", "key", "fingerprint", "status", "headers", "body")


def _write(insert: postgresql.Insert | sqlite.Insert) -> ReturningInsert[tuple[str]]:
    """Return the statement that writes a key unless there is one of less than a day ago.

    An older one, which nobody has deleted yet, is as good as none.
    """
    statement = insert.values({name: bindparam(name) for name in _WRITTEN} | {"created_at": DatabaseNow()})
    return statement.on_conflict_do_update(
        index_elements=[_ANSWERS.c.principal, _ANSWERS.c.key],
        set_={name: statement.excluded[name] for name in (*_WRITTEN, "created_at")},
        where=_IS_OVER,
    ).returning(_ANSWERS.c.key)


_WRITE_SQLITE, _WRITE_POSTGRES = _write(sqlite.insert(_ANSWERS)), _write(postgresql.insert(_ANSWERS))
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
        old = select(_ANSWERS.c.principal, _ANSWERS.c.key).where(_IS_OVER).limit(_BATCH)
        while True:
            with self._database.read() as session:
                found = session.execute(old).all()
            for principal, key in found:
                here = _ANSWERS.c.principal == principal, _ANSWERS.c.key == key
                # The condition once more: the key may have been used again in the meantime.
                with self._database.write_rows(is_work=False) as connection:
                    total += connection.execute(delete(_ANSWERS).where(*here, _IS_OVER)).rowcount
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
