"""The queue of jobs: the table itself, which has an index in the order of claims, on both databases.

New jobs are inserted within the caller's transaction, each with a turn: its position in the fair queue.

Workers poll the table. Where they are on several machines, the transaction that queues jobs also
announces them: Postgres passes this on to workers that listen, once it is committed. A job whose
announcement nobody heard is found by the next poll. So there is one order, fair between keys, and
nothing beside the table that could be lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any  # the columns of a row that a statement describes

from sqlalchemy import (
    ColumnElement,
    Connection,
    Integer,
    Row,
    Select,
    SmallInteger,
    Text,
    bindparam,
    cast,
    func,
    insert,
    literal_column,
    select,
    text,
)
from sqlalchemy.orm import Session

from service.jobs.queue import Lane, gap_for, turns
from service.jobs.records import JobKind, JobState
from service.schemas.query.terms import facts_of
from service.schemas.reading.documents import Annotation, Document, Part
from service.storage.annotations import insert_labels
from service.storage.database.database import Database, is_postgres
from service.storage.database.rows import database_now, new_id
from service.storage.examinations import Examination
from service.storage.jobs.finishing import solved
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import AuditRow, JobRow

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
        if (
            together > 1
            and len({row.priority for row in head}) == 1
            and all(row.kind == JobKind.SOLVE.value and not row.alone for row in head)
        ):
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


_TAKEN = JobState.RUNNING, JobState.SUCCEEDED, JobState.FAILED
_HELD = JobState.QUEUED, *_TAKEN
"""States in which a job's turn counts for its key. A cancelled job's does not: its turn is free again."""
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


_INSERT, _INSERT_AUDITS = insert(table_of(JobRow)), insert(table_of(AuditRow))


def insert_jobs(
    session: Session,
    problems: Sequence[tuple[Part, str]],
    *,
    lane: Lane,
    priority: int,
    key_id: str | None,
    examinations: Sequence[Examination | None] = (),
    annotations: Sequence[Annotation] = (),
    audited: str | None = None,
    kind: JobKind = JobKind.SOLVE,
) -> list[JobRow]:
    """Insert a job for each problem and its digest; it has succeeded already if an equal one was solved.

    If they are audits of the solution ``audited``, which this transaction has locked, or of another ``kind``,
    nothing is reused.
    The returned rows are detached from the session.
    """
    now = database_now(session)
    connection = session.connection()
    solutions: dict[str, str] = {}
    if audited is None and kind is JobKind.SOLVE:
        solutions = solved(connection, sorted({digest for _, digest in problems}), hold=True)
    waiting = [digest for _, digest in problems if digest not in solutions]
    given = next_turns(connection, lane=lane, priority=priority, key_id=key_id, seconds=[None] * len(waiting))
    turns = iter(given)
    values: list[dict[str, object]] = []
    for (problem, digest), examination, annotation in zip_longest(problems, examinations, annotations):
        solution_id = solutions.get(digest)
        reused = solution_id is not None
        values.append(
            {
                "id": new_id(),
                "kind": kind.value,
                "state": (JobState.SUCCEEDED if reused else JobState.QUEUED).value,
                "priority": priority,
                "lane": int(lane),
                "turn": 0.0 if reused else next(turns),
                "ready_at": 0.0,
                "attempt": 0,
                "progress": 1.0 if reused else 0.0,
                "reused": reused,
                "solution_id": solution_id,
                "key_id": key_id,
                "problem": problem,
                "examination": None if examination is None else examination.windows,
                "examined_seconds": None if examination is None else examination.seconds,
                "facts": facts_of(problem),
                "digest": digest,
                "created_at": now,
                "finished_at": now if reused else None,
                "note": None if annotation is None else annotation.note,
            }
        )
    if values:
        session.execute(_INSERT, values)
    if audited is not None:
        audits = [{"job_id": each["id"], "solution_id": audited} for each in values]
        session.execute(_INSERT_AUDITS, audits)
    made = zip(values, annotations, strict=False)
    insert_labels(session, JobRow, [(str(each["id"]), now, annotation) for each, annotation in made])
    return [JobRow(**each) for each in values]
