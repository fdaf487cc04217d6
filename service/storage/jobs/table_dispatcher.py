"""The local engine's dispatcher: workers poll the jobs table, which has an index in the order of claims."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any  # the columns of some table of jobs

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
)

from service.jobs.queue import Lane
from service.jobs.records import JobKind, JobState
from service.jobs.store import Delivery
from service.storage.tables.base import DatabaseNow, table_of
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
    """The choice of jobs in the queue that a statement is about."""

    of_lane: bool = False
    """True for the jobs of ``lane`` only."""
    problems: bool = False
    """Problems of ``priority`` that may share a call: no chunks, no atlases, none to be computed alone."""


SHOWN = "id", "kind", "alone", "priority", "digest", "attempt", "ready_at"
EACH = tuple(Which(of_lane, problems) for of_lane in (False, True) for problems in (False, True))


def first_jobs(*columns: ColumnElement[Any], which: Which) -> Select[*tuple[Any, ...]]:
    """Return the statement that locks the first ``count`` jobs; its rows have :data:`SHOWN`."""
    ready, order = is_ready(), in_order(_JOBS.c)
    if which.of_lane:
        ready = *ready, _JOBS.c.lane == bindparam("lane", type_=SmallInteger)
        order = tuple(each for each in order if each is not _JOBS.c.lane)
    if which.problems:
        shares_a_call = _JOBS.c.kind == _PROBLEM, _JOBS.c.alone.is_(False)
        ready = *ready, _JOBS.c.priority == bindparam("of_priority", type_=Integer), *shares_a_call
    return (
        select(*(_JOBS.c[name] for name in SHOWN), *columns)
        .where(*ready)
        .order_by(*order)
        .limit(bindparam("count", type_=Integer))
        # On Postgres workers skip rows that others have locked. SQLite has one writer and ignores it.
        .with_for_update(skip_locked=True)
    )


class Chosen:
    """The jobs that one claim chooses by its statements, within the caller's transaction."""

    def __init__(self, connection: Connection, statements: Mapping[Which, Select[Any]]) -> None:
        self._connection, self._statements = connection, statements
        self.ids: list[str] = []
        self.passed_over: list[Delivery] = []
        """Problems that equal a chosen one: when that is solved, they share its solution."""
        self._digests: set[str] = set()

    def choose(self, count: int, owed: Sequence[Lane], together: int) -> None:
        """Lock first a job of each lane that is owed one, then the head of the queue."""
        chosen = sum(self._add(1, 1, lane, together) for lane in owed[:count])
        if chosen < count:
            self._add(count - chosen, count, None, together)

    def _add(self, number: int, among: int, lane: Lane | None, together: int) -> bool:
        """Choose ``number`` jobs, or batches of problems instead of single ones; say whether there is any."""
        given: dict[str, object] = {"count": among} if lane is None else {"count": among, "lane": int(lane)}
        which = Which(of_lane=lane is not None)
        # The statements find the rows that this transaction has locked already once more.
        head = [row for row in self._rows(which, given) if row.id not in self.ids][:number]
        for row in head:
            self._take(row)
        if together > 1 and len({row.priority for row in head}) == 1 and all(map(_may_share, head)):
            given |= {"of_priority": head[0].priority, "count": number * together}
            for row in self._rows(replace(which, problems=True), given):
                if row.digest in self._digests and row.id not in self.ids:
                    self.passed_over.append(Delivery(row.id, row.attempt, row.priority, row.ready_at))
                elif row.id not in self.ids:
                    self._take(row)
        return bool(head)

    def _rows(self, which: Which, given: Mapping[str, object]) -> Sequence[Row[*tuple[Any, ...]]]:
        return self._connection.execute(self._statements[which], given).all()

    def _take(self, row: Row[*tuple[Any, ...]]) -> None:
        self.ids.append(row.id)
        self._digests.add(row.digest)


def _may_share(row: Row[*tuple[Any, ...]]) -> bool:
    return row.kind == JobKind.SOLVE.value and not row.alone


_STATEMENTS = {which: first_jobs(which=which) for which in EACH}


class TableDispatcher:
    """The :class:`~service.jobs.store.Dispatcher` of the local engine: the table itself."""

    def dispatch(self, connection: Connection, deliveries: Sequence[Delivery]) -> None:
        """Do nothing: the row of a queued job is its delivery."""

    def take(
        self, connection: Connection, count: int, owed: Sequence[Lane] = (), together: int = 1
    ) -> Sequence[str] | None:
        """Return the first jobs of the queue that are ready."""
        chosen = Chosen(connection, _STATEMENTS)
        chosen.choose(count, owed, together)
        return chosen.ids or None

    def repair(self, connection: Connection) -> int:
        """Do nothing: what is in the table is delivered."""
        return 0
