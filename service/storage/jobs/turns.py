"""Assigns turns (places in the fair queue) to new jobs from the turns that the index holds."""

from collections.abc import Sequence
from typing import Any  # of a row that the statement describes

from sqlalchemy import Connection, Select, Text, bindparam, cast, func, literal_column, select

from service.jobs.queue import Lane, gap_for, turns
from service.jobs.records import JobState
from service.storage.database.database import is_postgres
from service.storage.tables.base import table_of
from service.storage.tables.jobs import JobRow

_JOBS = table_of(JobRow)
_TAKEN = JobState.RUNNING, JobState.SUCCEEDED, JobState.FAILED
_HELD = JobState.QUEUED, *_TAKEN
"""States in which a job's turn counts for its key. A cancelled job's does not: its place is free again."""
_IN_LANE = _JOBS.c.lane == bindparam("lane"), _JOBS.c.priority == bindparam("priority")


def _largest(state: JobState, of_key: bool, has_key: bool) -> Select[float]:
    """Return the largest turn among the jobs of one state: one look-up at the end of an index."""
    statement = select(func.max(_JOBS.c.turn)).where(*_IN_LANE, _JOBS.c.state == literal_column(f"'{state}'"))
    if of_key:
        own = _JOBS.c.key_id == bindparam("key_id") if has_key else _JOBS.c.key_id.is_(None)
        statement = statement.where(own)
    return statement


def _last_seconds(has_key: bool) -> Select[float]:
    """Return how long the last succeeded job of a key took."""
    own = _JOBS.c.key_id == bindparam("key_id") if has_key else _JOBS.c.key_id.is_(None)
    succeeded = _JOBS.c.state == literal_column(f"'{JobState.SUCCEEDED}'")
    return (
        select(_JOBS.c.finished_at - _JOBS.c.started_at)
        .where(*_IN_LANE, own, succeeded)
        .order_by(_JOBS.c.turn.desc())
        .limit(1)
    )


def _standing(has_key: bool) -> Select[*tuple[Any, ...]]:
    taken = [_largest(state, False, has_key).scalar_subquery() for state in _TAKEN]
    held = [_largest(state, True, has_key).scalar_subquery() for state in _HELD]
    seconds = _last_seconds(has_key).scalar_subquery()
    return select(*taken, *held, seconds)


_STANDING = {has_key: _standing(has_key) for has_key in (False, True)}
_LOCK = select(func.pg_advisory_xact_lock(func.hashtextextended(cast(bindparam("flow"), Text), 0)))


def next_turns(
    connection: Connection, *, lane: Lane, priority: int, key_id: str | None, seconds: Sequence[float | None]
) -> list[float]:
    """Return the turns of jobs that are to be queued now; the jobs must be inserted by this transaction.

    ``seconds`` is what each of them is expected to take; None: as long as the
    last one of its key in this lane.
    """
    if not seconds:
        return []
    given: dict[str, object] = {"lane": int(lane), "priority": priority}
    if key_id is not None:
        given["key_id"] = key_id
        if is_postgres(connection):
            # Two requests of one key at the same instant must not get the same turns: the key would
            # have several jobs taken for one of the others. SQLite has one writer at a time.
            connection.execute(_LOCK, {"flow": f"polhode {lane:d} {priority} {key_id}"})
    *found, last_seconds = connection.execute(_STANDING[key_id is not None], given).one()
    taken, held = found[: len(_TAKEN)], found[len(_TAKEN) :]
    gaps = [gap_for(last_seconds if each is None else each) for each in seconds]
    return turns(
        max((turn for turn in taken if turn is not None), default=0.0),
        max((turn for turn in held if turn is not None), default=None),
        gaps,
    )
