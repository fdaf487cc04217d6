"""Nobody delivers: workers look at the jobs table, which has an index in the order of claims."""

from collections.abc import Sequence

from sqlalchemy import Connection, Integer, bindparam, select

from service.jobs.dispatch import Delivery
from service.jobs.states import JobState
from service.storage.base import table_of
from service.storage.clock import DatabaseNow
from service.storage.tables import JobRow

_JOBS = table_of(JobRow)
_FIRST = (
    select(_JOBS.c.id)
    .where(_JOBS.c.state == JobState.QUEUED.value, _JOBS.c.ready_at <= DatabaseNow())
    .order_by(_JOBS.c.priority.desc(), _JOBS.c.id)
    .limit(bindparam("count", type_=Integer))
    # Postgres: workers step over each other's rows. SQLite has one writer at a time and ignores it.
    .with_for_update(skip_locked=True)
)


class TableDispatcher:
    """The :class:`~service.jobs.dispatch.Dispatcher` of the local engine: the table itself."""

    def dispatch(self, connection: Connection, deliveries: Sequence[Delivery]) -> None:
        """Do nothing: the row of a queued job is its delivery."""

    def take(self, connection: Connection, count: int) -> Sequence[str] | None:
        """Return the first jobs of the queue that are ready."""
        return list(connection.scalars(_FIRST, {"count": count})) or None

    def repair(self, connection: Connection) -> int:
        """Do nothing: what is in the table is delivered."""
        return 0
