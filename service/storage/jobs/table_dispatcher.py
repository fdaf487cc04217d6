"""The local engine's dispatcher: workers poll the jobs table, which has an index in the order of claims."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from service.jobs.states import JobKind, JobState
from service.storage.database.clock import DatabaseNow
from service.storage.tables.base import table_of
from service.storage.tables.jobs import JobRow

_JOBS = table_of(JobRow)
_PROBLEM: ColumnElement[str] = literal_column(f"'{JobKind.SOLVE}'")


def in_order(jobs: Any) -> tuple[ColumnElement[Any], ...]:  # noqa: ANN401
    """Return the sort order of jobs when no lane is owed one."""
    # Keys of the same turn come in a fixed order: two of them then alternate strictly.
    return jobs.priority.desc(), jobs.lane, jobs.turn, jobs.key_id, jobs.id


def is_ready() -> tuple[ColumnElement[bool], ...]:
    """Return what makes a job claimable."""
    # A literal, not a parameter, so that the databases can use the partial index of queued jobs.
    return _JOBS.c.state == literal_column(f"'{JobState.QUEUED}'"), _JOBS.c.ready_at <= DatabaseNow()


@dataclass(frozen=True, slots=True)
class Which:
    """Which jobs of the queue a statement is about."""

    of_lane: bool = False
    """Those of ``lane`` only."""
    problems: bool = False
    """Problems of ``priority`` only: neither chunks of sweeps nor atlases."""


EACH = tuple(Which(of_lane, problems) for of_lane in (False, True) for problems in (False, True))


def first_jobs(*columns: ColumnElement[Any], which: Which) -> Select[*tuple[Any, ...]]:
    """Return the statement that locks the first ``count`` jobs; its rows have id, kind and priority."""
    ready, order = is_ready(), in_order(_JOBS.c)
    if which.of_lane:
        ready = *ready, _JOBS.c.lane == bindparam("lane", type_=SmallInteger)
        order = tuple(each for each in order if each is not _JOBS.c.lane)
    if which.problems:
        ready = *ready, _JOBS.c.priority == bindparam("of_priority", type_=Integer), _JOBS.c.kind == _PROBLEM
    return (
        select(_JOBS.c.id, _JOBS.c.kind, _JOBS.c.priority, *columns)
        .where(*ready)
        .order_by(*order)
        .limit(bindparam("count", type_=Integer))
        # On Postgres workers skip rows that others have locked. SQLite has one writer and ignores it.
        .with_for_update(skip_locked=True)
    )


def take_in_order(
    connection: Connection,
    statements: Mapping[Which, Select[Any]],
    count: int,
    owed: Sequence[Lane],
    together: int,
) -> Sequence[str] | None:
    """Lock jobs by one of the statements: first of each lane that is owed one, then the head of the queue."""
    ids: list[str] = []

    def add(number: int, lane: Lane | None) -> bool:
        """Add ``number`` jobs, or batches of problems in their place; say whether there is any."""
        given: dict[str, object] = {} if lane is None else {"lane": int(lane)}
        which = Which(of_lane=lane is not None)
        # The statements find the rows that this transaction has already locked once more.
        asked = number if lane is not None else count
        head = [
            row
            for row in connection.execute(statements[which], {**given, "count": asked})
            if row.id not in ids
        ]
        head = head[:number]
        ids.extend(row.id for row in head)
        kinds = {(row.kind, row.priority) for row in head}
        if together > 1 and len(kinds) == 1 and head[0].kind == JobKind.SOLVE.value:
            given |= {"of_priority": head[0].priority, "count": number * together}
            more = connection.execute(statements[replace(which, problems=True)], given)
            ids.extend(row.id for row in more if row.id not in ids)
        return bool(head)

    places = sum(add(1, lane) for lane in owed[:count])
    if places < count:
        add(count - places, None)
    return ids or None


_STATEMENTS = {which: first_jobs(which=which) for which in EACH}


class TableDispatcher:
    """The :class:`~service.jobs.dispatch.Dispatcher` of the local engine: the table itself."""

    def dispatch(self, connection: Connection, deliveries: Sequence[Delivery]) -> None:
        """Do nothing: the row of a queued job is its delivery."""

    def take(
        self, connection: Connection, count: int, owed: Sequence[Lane] = (), together: int = 1
    ) -> Sequence[str] | None:
        """Return the first jobs of the queue that are ready."""
        return take_in_order(connection, _STATEMENTS, count, owed, together)

    def repair(self, connection: Connection) -> int:
        """Do nothing: what is in the table is delivered."""
        return 0
