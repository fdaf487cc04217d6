"""The queue of jobs: the table itself, which has an index in the order of claims, on both databases.

Workers poll the table. Where they are on several machines, the transaction that queues jobs also
announces them: Postgres passes this on to workers that listen, once it is committed. A job whose
announcement nobody heard is found by the next poll. So there is one order, fair between keys, and
nothing beside the table that could be lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any  # the columns of a row

from sqlalchemy import (
    ColumnElement,
    Connection,
    Integer,
    Row,
    Select,
    SmallInteger,
    bindparam,
    literal_column,
    select,
    text,
)

from service.jobs.queue import Lane
from service.jobs.records import JobKind, JobState
from service.schemas.reading.documents import Document
from service.storage.database.database import Database
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import JobRow

CHANNEL = "polhode_jobs"
"""The channel on which Postgres announces queued jobs."""

_NOTIFY = text(f"NOTIFY {CHANNEL}")
_JOBS = table_of(JobRow)
_PROBLEM: ColumnElement[str] = literal_column(f"'{JobKind.SOLVE}'")


def announce(database: Database, connection: Connection) -> None:
    """Announce to workers of other machines that this transaction has queued jobs."""
    if database.announces_jobs:
        connection.execute(_NOTIFY)


def first_jobs(
    connection: Connection, count: int, starved: Sequence[Lane] = (), together: int = 1
) -> list[str] | None:
    """Lock the first jobs of the queue that are ready, and return their ids in order; None without any.

    The order is: first one job of each of the ``starved`` lanes; then by larger priority, earlier
    lane, smaller turn, older job of a key. Where these at most ``count`` jobs are problems,
    ``together`` of them may take the place of one: the next ones of the same priority, and of the
    same lane, if that is owed one.
    """
    chosen = _Chosen(connection)
    for_lanes = sum(chosen.add(1, 1, lane, together) for lane in starved[:count])
    if for_lanes < count:
        chosen.add(count - for_lanes, count, None, together)
    return chosen.ids or None


@dataclass(frozen=True, slots=True)
class _Which:
    """The choice of jobs in the queue that a statement is about."""

    of_lane: bool = False
    """True for the jobs of ``lane`` only."""
    problems: bool = False
    """Problems of ``priority`` that may share a call: no chunks, no atlases, none to be computed alone."""


def _statement(which: _Which) -> Select[*tuple[Any, ...]]:
    """Return the statement that locks the first ``count`` jobs."""
    # A literal, not a parameter, so that the databases can use the partial index of queued jobs.
    is_queued = _JOBS.c.state == literal_column(f"'{JobState.QUEUED}'")
    conditions = [is_queued, _JOBS.c.ready_at <= DatabaseNow()]
    if which.of_lane:
        conditions.append(_JOBS.c.lane == bindparam("lane", type_=SmallInteger))
    if which.problems:
        of_priority = _JOBS.c.priority == bindparam("of_priority", type_=Integer)
        conditions += [of_priority, _JOBS.c.kind == _PROBLEM, _JOBS.c.alone.is_(False)]
    # Keys of the same turn come in a fixed order: two of them then alternate strictly.
    order = _JOBS.c.priority.desc(), *(() if which.of_lane else (_JOBS.c.lane,)), _JOBS.c.turn
    return (
        select(_JOBS.c.id, _JOBS.c.kind, _JOBS.c.alone, _JOBS.c.priority, _JOBS.c.digest)
        .where(*conditions)
        .order_by(*order, _JOBS.c.key_id, _JOBS.c.id)
        .limit(bindparam("count", type_=Integer))
        # On Postgres workers skip rows that others have locked. SQLite has one writer and ignores it.
        .with_for_update(skip_locked=True)
    )


_STATEMENTS = {
    which: _statement(which)
    for which in (_Which(of_lane, problems) for of_lane in (False, True) for problems in (False, True))
}


class _Chosen:
    """The jobs that one claim chooses, within the caller's transaction."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self.ids: list[str] = []
        self._digests: set[str] = set()

    def add(self, number: int, among: int, lane: Lane | None, together: int) -> bool:
        """Choose ``number`` jobs, or batches of problems instead of single ones; say whether there is any."""
        values: dict[str, object] = {"count": among} if lane is None else {"count": among, "lane": int(lane)}
        which = _Which(of_lane=lane is not None)
        # The statements find the rows that this transaction has locked already once more.
        head = [row for row in self._rows(which, values) if row.id not in self.ids][:number]
        for row in head:
            self._take(row)
        if together > 1 and len({row.priority for row in head}) == 1 and all(map(_may_share, head)):
            values |= {"of_priority": head[0].priority, "count": number * together}
            for row in self._rows(replace(which, problems=True), values):
                # Problems that equal a chosen one are passed over: they share its solution when it is solved.
                if row.id not in self.ids and row.digest not in self._digests:
                    self._take(row)
        return bool(head)

    def _rows(self, which: _Which, values: Document) -> Sequence[Row[*tuple[Any, ...]]]:
        return self._connection.execute(_STATEMENTS[which], values).all()

    def _take(self, row: Row[*tuple[Any, ...]]) -> None:
        self.ids.append(row.id)
        self._digests.add(row.digest)


def _may_share(row: Row[*tuple[Any, ...]]) -> bool:
    return row.kind == JobKind.SOLVE.value and not row.alone
