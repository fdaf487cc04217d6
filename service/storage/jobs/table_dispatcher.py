"""The local engine's dispatcher: workers poll the jobs table, which has an index in the order of claims."""

from collections.abc import Sequence
from typing import Any  # the columns of some table of jobs

from sqlalchemy import (
    ColumnElement,
    Connection,
    Integer,
    Select,
    SmallInteger,
    bindparam,
    literal_column,
    select,
)

from service.jobs.dispatch import Delivery
from service.jobs.lanes import Lane
from service.jobs.states import JobState
from service.storage.database.clock import DatabaseNow
from service.storage.tables.base import table_of
from service.storage.tables.jobs import JobRow

_JOBS = table_of(JobRow)


def in_order(jobs: Any) -> tuple[ColumnElement[Any], ...]:  # noqa: ANN401
    """Return the sort order of jobs when no lane is owed one."""
    # Keys of the same turn come in a fixed order: two of them then alternate strictly.
    return jobs.priority.desc(), jobs.lane, jobs.turn, jobs.key_id, jobs.id


def is_ready() -> tuple[ColumnElement[bool], ...]:
    """Return what makes a job claimable."""
    # A literal, not a parameter, so that the databases can use the partial index of queued jobs.
    return _JOBS.c.state == literal_column(f"'{JobState.QUEUED}'"), _JOBS.c.ready_at <= DatabaseNow()


def first_jobs(*columns: ColumnElement[Any], of_lane: bool) -> Select[*tuple[Any, ...]]:
    """Return the statement that locks the first ``count`` jobs, or the first of ``lane``."""
    ready = is_ready()
    if of_lane:
        ready = *ready, _JOBS.c.lane == bindparam("lane", type_=SmallInteger)
    return (
        select(_JOBS.c.id, *columns)
        .where(*ready)
        .order_by(*(each for each in in_order(_JOBS.c) if not (of_lane and each is _JOBS.c.lane)))
        .limit(bindparam("count", type_=Integer))
        # On Postgres workers skip rows that others have locked. SQLite has one writer and ignores it.
        .with_for_update(skip_locked=True)
    )


def take_in_order(
    connection: Connection, first: Select[Any], first_of_lane: Select[Any], count: int, owed: Sequence[Lane]
) -> Sequence[str] | None:
    """Lock jobs by the two statements: one of each lane that is owed one, then the head of the queue."""
    ids = [
        job_id
        for lane in owed
        for job_id in connection.scalars(first_of_lane, {"lane": int(lane), "count": 1})
    ]
    if len(ids) < count:
        # The second statement finds the rows that this transaction has already locked once more.
        head = connection.scalars(first, {"count": count}).all()
        ids += [job_id for job_id in head if job_id not in ids]
    return ids[:count] or None


_FIRST, _FIRST_OF_LANE = first_jobs(of_lane=False), first_jobs(of_lane=True)


class TableDispatcher:
    """The :class:`~service.jobs.dispatch.Dispatcher` of the local engine: the table itself."""

    def dispatch(self, connection: Connection, deliveries: Sequence[Delivery]) -> None:
        """Do nothing: the row of a queued job is its delivery."""

    def take(self, connection: Connection, count: int, owed: Sequence[Lane] = ()) -> Sequence[str] | None:
        """Return the first jobs of the queue that are ready."""
        return take_in_order(connection, _FIRST, _FIRST_OF_LANE, count, owed)

    def repair(self, connection: Connection) -> int:
        """Do nothing: what is in the table is delivered."""
        return 0
