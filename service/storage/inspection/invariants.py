"""The invariants of jobs, attempts, solutions and API keys, which hold at any instant even after a kill.

Each invariant comes with a query for the rows that violate it. A query is one
statement, so it sees one state of the database even while others write; it
counts and compares inside the database, whatever its size.

A repair loses nothing. It is given the query for the violating rows and runs it again inside its own
transaction, so that rows which are valid by then are left alone.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any  # the row type does not matter for a count

from sqlalchemy import (
    CheckConstraint,
    ColumnElement,
    Delete,
    Select,
    Table,
    TextClause,
    Update,
    and_,
    case,
    delete,
    exists,
    func,
    not_,
    or_,
    select,
    text,
    update,
)
from sqlalchemy.orm import Session, aliased

from service.jobs.records import FINISHED, AttemptOutcome, JobKind, JobState
from service.storage.database.database import Database
from service.storage.jobs.rows import end_attempt, move
from service.storage.tables.base import DatabaseNow, Word
from service.storage.tables.jobs import AttemptRow, AuditRow, JobRow, ResultRow
from service.storage.tables.operations import METADATA, TABLES, ApiKeyRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow, SweepChunkRow, SweepRow

Broken = Select[str]
"""Selects the ids of the rows that violate an invariant."""
Repair = Callable[[Database, Broken], int]
"""Repairs them; returns how many."""

_OUTCOME = {
    JobState.SUCCEEDED: AttemptOutcome.SUCCEEDED,
    JobState.FAILED: AttemptOutcome.FAILED,
    JobState.CANCELLED: AttemptOutcome.CANCELLED,
}
"""The outcome of the last attempt, by the state of a finished job."""


def delete_orphans(table: Table, reference: ColumnElement[str]) -> Repair:
    """Return a repair that deletes the rows whose ``reference`` points to a missing row."""

    def repair(database: Database, broken: Broken) -> int:
        with database.write() as session:
            return _changed(session, delete(table).where(reference.in_(broken)))

    return repair


def compute_again(database: Database, broken: Broken) -> int:
    """Requeue the jobs that have succeeded but whose solutions are missing."""
    return _queue(database, JobRow.solution_id.in_(broken), solution_id=None, reused=False)


def make_again(database: Database, broken: Broken) -> int:
    """Requeue the jobs that have succeeded but whose atlases, or answers, are missing."""
    return _queue(database, JobRow.id.in_(broken))


def _queue(database: Database, condition: ColumnElement[bool], **values: object) -> int:
    anew = {"state": JobState.QUEUED.value, "progress": 0.0, "finished_at": None}
    with database.write() as session:
        return _changed(session, update(JobRow).where(condition).values(**anew, **values))


def date_ends(database: Database, broken: Broken) -> int:
    """Set the end of finished jobs to that of their last attempt, and clear it for the others."""
    last = select(func.max(AttemptRow.ended_at)).where(AttemptRow.job_id == JobRow.id).scalar_subquery()
    ended = case((JobRow.finished_at.is_(None), func.coalesce(last, DatabaseNow())), else_=None)
    with database.write() as session:
        return _changed(session, update(JobRow).where(JobRow.id.in_(broken)).values(finished_at=ended))


def open_attempts() -> ColumnElement[bool]:
    """Return the condition that an attempt has no end and is not the current one of its job."""
    is_present = and_(
        JobRow.id == AttemptRow.job_id,
        JobRow.state == JobState.RUNNING.value,
        JobRow.attempt == AttemptRow.number,
    )
    return and_(AttemptRow.ended_at.is_(None), not_(exists().where(is_present)))


def end_attempts(database: Database, broken: Broken) -> int:
    """End abandoned attempts: the last one of a job with the job's outcome, the others as returned."""
    outcome = case(
        *(
            (exists().where(_is_last(), JobRow.state == state.value), outcome.value)
            for state, outcome in _OUTCOME.items()
        ),
        # Nobody knows whether it had begun.
        else_=AttemptOutcome.RETURNED.value,
    )
    values = {"ended_at": DatabaseNow(), "outcome": outcome}
    statement = update(AttemptRow).where(AttemptRow.job_id.in_(broken), open_attempts()).values(**values)
    with database.write() as session:
        return _changed(session, statement)


def forget_comparisons(database: Database, broken: Broken) -> int:
    """Remove the comparisons of audits."""
    with database.write() as session:
        return _changed(session, update(AuditRow).where(AuditRow.job_id.in_(broken)).values(comparison=None))


def forget_results(database: Database, broken: Broken) -> int:
    """Remove atlases and answers of studies."""
    with database.write() as session:
        return _changed(session, delete(ResultRow).where(ResultRow.job_id.in_(broken)))


def release_leases(database: Database, broken: Broken) -> int:
    """Requeue the jobs whose workers are gone."""
    with database.read() as session:
        found = session.execute(select(JobRow.id, JobRow.attempt).where(JobRow.id.in_(broken))).all()
    released = 0
    for job_id, attempt in found:
        still = JobRow.id == job_id, JobRow.attempt == attempt, JobRow.id.in_(broken)
        with database.write() as session:
            if move(session, JobState.QUEUED, *still, alone=True):
                why = "its lease was released by hand"
                end_attempt(session, job_id, attempt, AttemptOutcome.RETURNED, why)
                released += 1
    return released


def _is_last() -> ColumnElement[bool]:
    return and_(JobRow.id == AttemptRow.job_id, JobRow.attempt == AttemptRow.number)


def _changed(session: Session, statement: Update | Delete) -> int:
    result: Any = session.execute(statement.execution_options(synchronize_session=False))
    return int(result.rowcount)


SILENT_SECONDS = 60.0
"""If a lease ended so long ago, no worker is alive: any would have taken the job over."""


@dataclass(frozen=True, slots=True)
class Remedy:
    """The repair of a violated invariant, which loses nothing."""

    says: str
    """The effect on a row, in words."""
    apply: Repair


@dataclass(frozen=True, slots=True)
class Invariant:
    """One invariant of the database, with the query for its violations."""

    code: str
    says: str
    broken: Broken
    remedy: Remedy | None = None
    is_warning: bool = False
    """A violation means that work has stalled, not that data are wrong."""


def invariants_of_jobs() -> Iterator[Invariant]:
    """Yield the invariants of all tables, then those of jobs, attempts and solutions."""
    yield from _checks()
    yield from _references()
    yield from _lives()
    yield from _attempts()
    yield from _solutions()
    yield from _audits()
    yield from _atlases()


def differ(left: ColumnElement[bool], right: ColumnElement[bool]) -> ColumnElement[bool]:
    """Return the condition that exactly one of two conditions holds, neither of which is ever null."""
    return or_(and_(left, not_(right)), and_(not_(left), right))


def _checks() -> Iterator[Invariant]:
    """Yield what every row must hold by itself: a damaged or patched file may violate it.

    That are the check constraints of its table, and that the words in it are known ones.
    """
    for name in (row.__tablename__ for row in TABLES):
        table = METADATA.tables[name]
        checks = [check.sqltext for check in table.constraints if isinstance(check, CheckConstraint)]
        broken: list[ColumnElement[bool] | TextClause] = [text(f"NOT ({condition})") for condition in checks]
        for column in table.columns:
            if isinstance(column.type, Word):
                broken.append(column.not_in(sorted(column.type.words)))
        if broken:
            key, *_ = table.primary_key.columns
            yield Invariant(
                f"{name}_checks", f"every row of {name} is legal by itself", select(key).where(or_(*broken))
            )


def _references() -> Iterator[Invariant]:
    """Yield one invariant for every reference: the row referred to exists."""
    for name in (row.__tablename__ for row in TABLES):
        table = METADATA.tables[name]
        for constraint in table.foreign_key_constraints:
            (own,), (key,) = constraint.columns, constraint.elements
            target = key.column.table.alias("target")
            there = exists().where(target.c[key.column.name] == own)
            if constraint.ondelete == "CASCADE":
                remedy = Remedy("it is removed: it belongs to nothing", delete_orphans(table, own))
            else:
                remedy = Remedy("the job is queued again", compute_again)
            yield Invariant(
                f"{name}_{own.name}",
                f"every {own.name} of {name} is there",
                select(own).where(own.is_not(None), not_(there)),
                remedy,
            )


def _lives() -> Iterator[Invariant]:
    ended = JobRow.state.in_([state.value for state in FINISHED])
    is_dated = JobRow.finished_at.is_not(None)
    yield Invariant(
        "finished_at",
        "a job has the instant of its end exactly if it has ended",
        select(JobRow.id).where(differ(ended, is_dated)),
        Remedy("it gets the instant at which its last attempt ended, or loses it", date_ends),
    )
    failed, has_error = JobRow.state == JobState.FAILED.value, JobRow.error.is_not(None)
    yield Invariant(
        "error",
        "a job has an error exactly if it has failed",
        select(JobRow.id).where(differ(failed, has_error)),
    )
    yield Invariant(
        "stale_lease",
        f"no lease ended {SILENT_SECONDS:g} s ago without a worker that takes the job over",
        select(JobRow.id).where(
            JobRow.state == JobState.RUNNING.value, JobRow.lease_until < DatabaseNow() - SILENT_SECONDS
        ),
        Remedy("the lease is released, the job queued again", release_leases),
        is_warning=True,
    )


def _attempts() -> Iterator[Invariant]:
    made = (
        select(
            AttemptRow.job_id,
            func.count().label("made"),
            func.min(AttemptRow.number).label("first"),
            func.max(AttemptRow.number).label("last"),
        )
        .group_by(AttemptRow.job_id)
        .subquery()
    )
    yield Invariant(
        "attempts",
        "the attempts at a job are numbered 1, 2, … up to the one that it is at",
        select(JobRow.id)
        .outerjoin(made, made.c.job_id == JobRow.id)
        .where(
            or_(
                JobRow.attempt != func.coalesce(made.c.made, 0),
                JobRow.attempt != func.coalesce(made.c.last, 0),
                func.coalesce(made.c.first, 1) != 1,
            )
        ),
    )
    yield Invariant(
        "open_attempts",
        "an attempt without an end is the one that a running job is at",
        select(AttemptRow.job_id).where(open_attempts()),
        Remedy("the attempt ends, as its job has or as lost", end_attempts),
    )
    present = exists().where(
        AttemptRow.job_id == JobRow.id, AttemptRow.number == JobRow.attempt, AttemptRow.ended_at.is_(None)
    )
    yield Invariant(
        "running_attempts",
        "a running job has an attempt without an end",
        select(JobRow.id).where(JobRow.state == JobState.RUNNING.value, not_(present)),
    )


def _solutions() -> Iterator[Invariant]:
    yield Invariant(
        "solved_once",
        "no job has two solutions of its own",
        select(SolutionRow.job_id).group_by(SolutionRow.job_id).having(func.count() > 1),
    )
    has_succeeded = and_(
        JobRow.state == JobState.SUCCEEDED.value,
        JobRow.kind == JobKind.SOLVE.value,
        JobRow.solution_id == SolutionRow.id,
        not_(JobRow.reused),
    )
    yield Invariant(
        "solutions_of_successes",
        "the job that a solution comes from, if it is still there, has succeeded with it",
        select(SolutionRow.id).join(JobRow, JobRow.id == SolutionRow.job_id).where(not_(has_succeeded)),
    )
    found = aliased(SolutionRow)
    is_another = and_(found.job_id != JobRow.id, not_(JobRow.reused))
    yield Invariant(
        "own_solutions",
        "a job has the solution that it computed, or reuses that of an equal problem",
        select(JobRow.id)
        .join(found, found.id == JobRow.solution_id)
        .where(or_(found.digest != JobRow.digest, is_another)),
    )
    has_function = exists().where(DenseOutputRow.solution_id == SolutionRow.id)
    yield Invariant(
        "functions_of_time",
        "every solution has its function of time",
        select(SolutionRow.id).where(not_(has_function)),
    )


def _audits() -> Iterator[Invariant]:
    has_succeeded = JobRow.state == JobState.SUCCEEDED.value
    jobs = select(AuditRow.job_id).join(JobRow, JobRow.id == AuditRow.job_id)
    yield Invariant(
        "comparisons",
        "an audit whose job has succeeded has its comparison",
        jobs.where(has_succeeded, AuditRow.comparison.is_(None)),
    )
    yield Invariant(
        "early_comparisons",
        "an audit whose job has not succeeded has no comparison",
        jobs.where(not_(has_succeeded), AuditRow.comparison.is_not(None)),
        Remedy("the comparison is removed: the job makes it anew", forget_comparisons),
    )


_MAKERS = (JobKind.ATLAS.value, JobKind.STUDY.value)
"""Kinds of jobs that make a document."""


def _atlases() -> Iterator[Invariant]:
    has_succeeded = and_(JobRow.state == JobState.SUCCEEDED.value, JobRow.kind.in_(_MAKERS))
    has_atlas = exists().where(ResultRow.job_id == JobRow.id)
    yield Invariant(
        "missing_atlases",
        "a job that has succeeded in drawing an atlas, or in a study, has what it made",
        select(JobRow.id).where(has_succeeded, not_(has_atlas)),
        Remedy("the job is queued again", make_again),
    )
    yield Invariant(
        "early_atlases",
        "a job that has an atlas, or the answer of a study, has succeeded",
        select(JobRow.id).where(not_(has_succeeded), has_atlas),
        Remedy("it is removed: the job makes it anew", forget_results),
    )


def invariants_of_keys() -> Iterator[Invariant]:
    """Yield the invariants of keys."""
    yield Invariant(
        "stored_bytes",
        "a key is charged for the arrays of its results, its atlases and its studies that are stored",
        select(ApiKeyRow.id).where(ApiKeyRow.stored_bytes != _stored()),
        Remedy("the bytes are counted again", _recharge),
    )


def _recharge(database: Database, broken: Broken) -> int:
    with database.read() as session:
        found = session.scalars(broken).all()
    for key_id in found:
        with database.write() as session:
            # Lock the key first: a transaction that stores for it charges the key last, so it waits here
            # or was committed before the count.
            session.scalar(select(ApiKeyRow.id).where(ApiKeyRow.id == key_id).with_for_update())
            statement = update(ApiKeyRow).where(ApiKeyRow.id == key_id).values(stored_bytes=_stored())
            session.execute(statement.execution_options(synchronize_session=False))
    return len(found)


def _stored() -> ColumnElement[int]:
    """Return the number of bytes that are stored for a key."""
    total: ColumnElement[int] = _of_chunks() + _of_atlases()
    for table in (DenseOutputRow, SamplesRow):
        total = total + _of_solutions(table)
    return total


def _of_solutions(table: type[DenseOutputRow] | type[SamplesRow]) -> ColumnElement[int]:
    return (
        select(func.coalesce(func.sum(func.length(table.data)), 0))
        .join(SolutionRow, SolutionRow.id == table.solution_id)
        .join(JobRow, JobRow.id == SolutionRow.job_id)
        .where(JobRow.key_id == ApiKeyRow.id)
        .correlate(ApiKeyRow)
        .scalar_subquery()
    )


def _of_atlases() -> ColumnElement[int]:
    return (
        select(func.coalesce(func.sum(func.length(ResultRow.data)), 0))
        .join(JobRow, JobRow.id == ResultRow.job_id)
        .where(JobRow.key_id == ApiKeyRow.id)
        .correlate(ApiKeyRow)
        .scalar_subquery()
    )


def _of_chunks() -> ColumnElement[int]:
    return (
        select(func.coalesce(func.sum(func.length(SweepChunkRow.data)), 0))
        .join(SweepRow, SweepRow.id == SweepChunkRow.sweep_id)
        .where(SweepRow.key_id == ApiKeyRow.id)
        .correlate(ApiKeyRow)
        .scalar_subquery()
    )
