"""Delivers jobs through Procrastinate, whose tables are in the same Postgres database.

A delivery is a row of Procrastinate's queue. The transaction that queues a job inserts
it, and the transaction that claims the job finishes it, so neither happens without
the other. Hence no delivery is ever in progress, and a worker that dies leaves none
behind.

Procrastinate orders its queue by priority and age; ours is also fair between keys. So
a delivery only says that there is work: the next job is read from the jobs table, in
the order that all engines use, and the delivery of that job is finished.
"""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Any, cast  # Any: of rows that the statements describe

from procrastinate import SyncPsycopgConnector
from procrastinate.exceptions import AlreadyEnqueued
from procrastinate.jobs import Job
from procrastinate.manager import JobManager, get_channel_for_queues
from psycopg import Connection as PostgresConnection
from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Connection,
    Integer,
    Select,
    String,
    Uuid,
    bindparam,
    column,
    delete,
    exists,
    func,
    literal_column,
    select,
    table,
    text,
)
from sqlalchemy import cast as sql_cast

from service.jobs.queue import Lane
from service.jobs.store import Delivery
from service.storage.jobs.table_dispatcher import (
    EACH,
    SHOWN,
    Chosen,
    Which,
    first_jobs,
    in_order,
    is_ready,
)
from service.storage.tables.base import table_of
from service.storage.tables.jobs import JobRow

QUEUE, TASK = "polhode", "claim"
(CHANNEL,) = get_channel_for_queues([QUEUE])
"""The channel on which Postgres tells listeners that something was put into the queue."""

_REPAIRED = 100
"""Jobs at the head of the queue whose deliveries are looked for; later jobs are not due yet."""
_EXAMINED = 1000
"""Deliveries that are checked at a time for being out of date."""
_JOBS = table_of(JobRow)
_DELIVERIES = table(
    "procrastinate_jobs",
    column("id", BigInteger),
    column("queue_name", String),
    column("queueing_lock", String),
)
# The index of locks has the waiting ones only; their state is an enumeration, unlike any bound value.
_WAITS = text("procrastinate_jobs.status = 'todo'")
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class ProcrastinateDispatcher:
    """The :class:`~service.jobs.store.Dispatcher` of the engine for many machines."""

    def __init__(self) -> None:
        # It never connects: every query is given the transaction's connection.
        self._manager = JobManager(SyncPsycopgConnector())
        self._examined = 0
        """The last delivery that was examined."""

    def dispatch(self, connection: Connection, deliveries: Sequence[Delivery]) -> None:
        """Put rows into Procrastinate's queue; its trigger notifies listeners after the commit."""
        if deliveries:
            self._manager.batch_defer_jobs(
                [_queued(delivery) for delivery in deliveries], connection=_driver(connection)
            )

    def take(
        self, connection: Connection, count: int, owed: Sequence[Lane] = (), together: int = 1
    ) -> Sequence[str] | None:
        """Return the first jobs of the queue that are ready, and finish their deliveries."""
        chosen = Chosen(connection, _TAKE)
        chosen.choose(count, owed, together)
        # Their deliveries were finished with the others.
        self.dispatch(connection, chosen.passed_over)
        return chosen.ids or None

    def repair(self, connection: Connection) -> int:
        """Deliver the jobs at the head of our queue that Procrastinate's queue lacks.

        Out-of-date deliveries, such as those of cancelled jobs, are removed a few
        at a time.
        """
        self._remove_useless(connection)
        lost = connection.execute(_without_delivery()).all()
        if not lost:
            return 0
        deliveries = [Delivery(row.id, row.attempt, row.priority, row.ready_at) for row in lost]
        try:
            with connection.begin_nested():
                self.dispatch(connection, deliveries)
        except AlreadyEnqueued:
            return 0  # another worker has just done it
        return len(deliveries)

    def _remove_useless(self, connection: Connection) -> None:
        next_ones = {"after": self._examined, "count": _EXAMINED}
        last, number = connection.execute(_NEXT, next_ones).one()
        if number:
            connection.execute(_REMOVE, {"after": self._examined, "last": last})
        self._examined = last if number == _EXAMINED else 0


def _lock_of(jobs: Any) -> ColumnElement[str]:  # noqa: ANN401
    """Return by which lock the delivery of a job is found, from the columns ``jobs``."""
    return sql_cast(jobs.id, String) + "#" + sql_cast(jobs.attempt, String)


def _with_deliveries(which: Which) -> Select[*tuple[Any, ...]]:
    """Return the statement that locks jobs and finishes their deliveries, by Procrastinate's own function."""
    columns = _JOBS.c.lane, _JOBS.c.turn, _JOBS.c.key_id
    chosen = first_jobs(*columns, which=which).cte("chosen")
    # Locked first: of a delivery that somebody else removes meanwhile the function would make an error.
    there = (
        select(_DELIVERIES.c.id)
        .where(_DELIVERIES.c.queueing_lock == _lock_of(chosen.c), _WAITS)
        .with_for_update()
        .correlate(chosen)
        .lateral("there")
    )
    finish = func.procrastinate_finish_job_v1(there.c.id, text("'succeeded'"), text("true"))
    finished = select(sql_cast(finish, String)).select_from(there).correlate(chosen)
    shown = [chosen.c[name] for name in SHOWN]
    return select(*shown, finished.scalar_subquery()).order_by(*in_order(chosen.c))


_TAKE = {which: _with_deliveries(which) for which in EACH}


def _next() -> Select[int, int]:
    """Return the statement for the id of the last of the next deliveries, and their number."""
    found = (
        select(_DELIVERIES.c.id)
        .where(_DELIVERIES.c.queue_name == QUEUE, _WAITS, _DELIVERIES.c.id > bindparam("after"))
        .order_by(_DELIVERIES.c.id)
        .limit(bindparam("count", type_=Integer))
        .subquery()
    )
    return select(func.max(found.c.id), func.count())


_NEXT = _next()
_JOB_ID, _ATTEMPT = (func.split_part(_DELIVERIES.c.queueing_lock, "#", part) for part in (1, 2))
_USEFUL = exists().where(
    _JOBS.c.id == sql_cast(_JOB_ID, Uuid(as_uuid=False)),
    _JOBS.c.attempt == sql_cast(_ATTEMPT, Integer),
    _JOBS.c.state == literal_column("'queued'"),
)
_REMOVE = delete(_DELIVERIES).where(
    _DELIVERIES.c.id.in_(
        select(_DELIVERIES.c.id)
        .where(_DELIVERIES.c.queue_name == QUEUE, _WAITS)
        .where(_DELIVERIES.c.id > bindparam("after"), _DELIVERIES.c.id <= bindparam("last"), ~_USEFUL)
        # A locked delivery is being finished or removed by another worker.
        .with_for_update(skip_locked=True)
        .scalar_subquery()
    )
)


def _without_delivery() -> Select[str, int, int, float]:
    due = (
        select(_JOBS.c.id, _JOBS.c.attempt, _JOBS.c.priority, _JOBS.c.ready_at)
        .where(*is_ready())
        .order_by(*in_order(_JOBS.c))
        .limit(_REPAIRED)
        .subquery()
    )
    delivered = exists().where(_DELIVERIES.c.queueing_lock == _lock_of(due.c), _WAITS)
    return select(due.c.id, due.c.attempt, due.c.priority, due.c.ready_at).where(~delivered)


def _queued(delivery: Delivery) -> Job:
    # Rounded up to the microsecond: not delivered before it can be claimed.
    ready_at = _EPOCH + timedelta(microseconds=int(delivery.ready_at * 1e6) + 1)
    return Job(
        id=None,
        queue=QUEUE,
        task_name=TASK,
        priority=delivery.priority,
        lock=None,
        queueing_lock=f"{delivery.job_id}#{delivery.attempt}",
        task_kwargs={"job": delivery.job_id},
        scheduled_at=ready_at if delivery.ready_at > 0.0 else None,
    )


def _driver(connection: Connection) -> PostgresConnection:
    """Return the driver's connection, in the midst of the transaction."""
    return cast(PostgresConnection, connection.connection.driver_connection)
