"""Jobs delivered by Procrastinate, whose tables lie beside ours in the same Postgres.

A delivery is a row of its queue and is written, and used up, by the
transaction that queues, or claims, the job: there is no moment at which one
has happened without the other. Hence no delivery is ever seen at work, and
none is left behind by a worker that died.
"""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import LiteralString, cast

from procrastinate import SyncPsycopgConnector
from procrastinate.exceptions import AlreadyEnqueued
from procrastinate.jobs import Job
from procrastinate.manager import JobManager, get_channel_for_queues
from psycopg import Connection as PostgresConnection
from sqlalchemy import Connection, Select, String, column, exists, select, table, text
from sqlalchemy import cast as sql_cast

from service.jobs.dispatch import Delivery
from service.jobs.states import JobState
from service.storage.base import table_of
from service.storage.clock import DatabaseNow
from service.storage.tables import JobRow

QUEUE, TASK = "polhode", "claim"
(CHANNEL,) = get_channel_for_queues([QUEUE])
"""On which Postgres tells listeners that something was put into the queue."""

_REPAIRED = 100
"""Jobs at the head of the queue whose deliveries are looked for. One behind them is not due yet."""
_TAKE: LiteralString = """
    SELECT job.id, job.args,
        CASE WHEN job.id IS NOT NULL
        THEN procrastinate_finish_job_v1(job.id, 'succeeded', true)::text END AS finished
    FROM procrastinate_fetch_job_v2(ARRAY[%(queue)s]::varchar[], NULL) AS job
"""
"""Fetch a job and delete it: what Procrastinate's worker does by two statements."""
_JOBS = table_of(JobRow)
_DELIVERIES = table("procrastinate_jobs", column("queueing_lock"))
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class ProcrastinateDispatcher:
    """The :class:`~service.jobs.dispatch.Dispatcher` of the engine for many machines."""

    def __init__(self) -> None:
        # It never connects: every query is given the transaction's connection.
        self._connector = SyncPsycopgConnector()
        self._manager = JobManager(self._connector)

    def dispatch(self, connection: Connection, deliveries: Sequence[Delivery]) -> None:
        """Put rows into Procrastinate's queue; its trigger notifies whoever listens after the commit."""
        if deliveries:
            self._manager.batch_defer_jobs(
                [_queued(delivery) for delivery in deliveries], connection=_driver(connection)
            )

    def take(self, connection: Connection, count: int) -> Sequence[str] | None:
        """Take deliveries out of the queue."""
        driver = _driver(connection)
        delivered: list[str] = []
        while len(delivered) < count:
            found = self._connector.execute_query_one_with_connection(driver, query=_TAKE, queue=QUEUE)
            if found["id"] is None:
                break
            delivered.append(str(found["args"]["job"]))
        return delivered or None

    def repair(self, connection: Connection) -> int:
        """Deliver the jobs at the head of our queue that are not in Procrastinate's."""
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


def _without_delivery() -> Select[str, int, int, float]:
    due = (
        select(_JOBS.c.id, _JOBS.c.attempt, _JOBS.c.priority, _JOBS.c.ready_at)
        .where(_JOBS.c.state == JobState.QUEUED.value, _JOBS.c.ready_at <= DatabaseNow())
        .order_by(_JOBS.c.priority.desc(), _JOBS.c.id)
        .limit(_REPAIRED)
        .subquery()
    )
    key = sql_cast(due.c.id, String) + "#" + sql_cast(due.c.attempt, String)
    # Its index has the waiting ones only; their state is an enumeration, unlike any bound value.
    delivered = exists().where(_DELIVERIES.c.queueing_lock == key, text("procrastinate_jobs.status = 'todo'"))
    return select(due.c.id, due.c.attempt, due.c.priority, due.c.ready_at).where(~delivered)


def _queued(delivery: Delivery) -> Job:
    # To the microsecond, upwards: not delivered before it can be claimed.
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
