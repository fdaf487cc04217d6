"""Stores solutions and marks their jobs succeeded, within the caller's transaction.

On Postgres each statement costs a round trip, so several changes of state are joined into
one. SQLite has no INSERT or UPDATE inside a WITH, and no round trips: there one statement
runs after the other.
"""

from collections import Counter
from collections.abc import Mapping, Sequence

from sqlalchemy import (
    Column,
    Connection,
    FromClause,
    Insert,
    Select,
    Update,
    bindparam,
    insert,
    select,
    true,
    update,
)
from sqlalchemy.orm import Session
from sqlalchemy.sql import ColumnElement

from service.jobs.records import AttemptOutcome, Claim, JobResult, JobState, Solved
from service.schemas.reading.documents import Part
from service.storage.annotations import LABELS_OF_JOB, copy_labels
from service.storage.codecs.summary import summary_columns
from service.storage.database.database import is_postgres
from service.storage.database.rows import new_id
from service.storage.jobs.rows import end_attempt, fence, may_become, move
from service.storage.keys import charge
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import AttemptRow, AuditRow, JobRow, ResultRow, SolutionLabelRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow

_ATTEMPTS, _SOLUTIONS = table_of(AttemptRow), table_of(SolutionRow)
_JOBS, _LABELS = table_of(JobRow), table_of(SolutionLabelRow)
_DENSE, _SAMPLES = table_of(DenseOutputRow), table_of(SamplesRow)

OF_JOB = "problem", "digest", "facts"
"""Columns that a solution has from its job."""
NEW = "new_"
"""Prefix of parameter names: without it SQLAlchemy would set the columns of that name in every table."""


def insert_solution(source: FromClause, *conditions: ColumnElement[bool]) -> Insert:
    """Return the statement that inserts a solution if ``source``, which has columns of jobs, has a row.

    What the job has too is copied: its note of this moment, which may have been changed since it was taken,
    and :data:`OF_JOB`, which need not be written as JSON once more. The parameters are the other columns of a
    solution with NEW before their names.
    """
    made_here = "created_at", "note", *OF_JOB
    given = [column for column in _SOLUTIONS.c if column.name not in made_here]
    note = select(_JOBS.c.note).where(_JOBS.c.id == _bound(_SOLUTIONS.c.job_id)).scalar_subquery()
    copied = [source.c[name] for name in OF_JOB]
    values = select(*map(_bound, given), DatabaseNow(), note, *copied).select_from(source).where(*conditions)
    return insert(_SOLUTIONS).from_select([*(column.name for column in given), *made_here], values)


def store_and_succeed(succeed: Update, end_attempt: Update) -> Select[str]:
    """Return the statement that stores a solution with arrays and labels, if ``succeed`` changes its job.

    Its parameters are those of both updates and of :func:`insert_solution`,
    ``dense`` and ``samples``; its row is the job's id.
    """
    moved = succeed.returning(*(_JOBS.c[name] for name in OF_JOB)).cte("moved")
    arrays = [
        insert(table).from_select(
            ["solution_id", "data"],
            select(_bound(_SOLUTIONS.c.id), _bound(table.c.data, name)).select_from(moved),
        )
        for table, name in ((_DENSE, "dense"), (_SAMPLES, "samples"))
    ]
    ended = end_attempt.where(_ATTEMPTS.c.job_id.in_(select(moved.c.id)))
    stored = insert_solution(moved).returning(_SOLUTIONS.c.id, _SOLUTIONS.c.created_at).cte("stored")
    labels = LABELS_OF_JOB.subquery()
    labelled = insert(_LABELS).from_select(
        ["solution_id", "created_at", "key", "value"],
        select(stored.c.id, stored.c.created_at, labels.c.key, labels.c.value).join_from(
            stored, labels, true()
        ),
    )
    parts = [*arrays, ended, labelled]
    return select(moved.c.id).add_cte(*(part.cte(f"part_{k}") for k, part in enumerate(parts)))


def _bound(column: Column[object], name: str | None = None) -> ColumnElement[object]:
    return bindparam(name or NEW + column.name, type_=column.type)


_AUDITS = table_of(AuditRow)

_INSERT_DENSE = insert(table_of(DenseOutputRow))
_INSERT_SAMPLES = insert(table_of(SamplesRow))
_FENCE = (
    _JOBS.c.id == bindparam("job"),
    may_become(JobState.SUCCEEDED),
    _JOBS.c.owner == bindparam("claimant"),
    _JOBS.c.attempt == bindparam("try"),
)
_INSERT_EACH = insert_solution(_JOBS, *_FENCE)
_SUCCEED_VALUES = {
    "state": JobState.SUCCEEDED.value,
    "solution_id": bindparam("solution"),
    "reused": bindparam("is_reused"),
    "progress": 1.0,
    "owner": None,
    "lease_until": None,
    "finished_at": DatabaseNow(),
}
_END_ATTEMPT = (
    update(_ATTEMPTS)
    .where(_ATTEMPTS.c.job_id == bindparam("job"), _ATTEMPTS.c.number == bindparam("try"))
    .values(ended_at=DatabaseNow(), outcome=AttemptOutcome.SUCCEEDED.value, detail=None)
)
_SUCCEED_EACH = update(_JOBS).where(*_FENCE).values(_SUCCEED_VALUES)
"""For many rows, which cannot tell whether they were changed."""
_SUCCEED = _SUCCEED_EACH.returning(_JOBS.c.id)
_COMPARE = (
    update(_AUDITS)
    .where(_AUDITS.c.job_id == bindparam("job"))
    .values(comparison=bindparam("compared", type_=_AUDITS.c.comparison.type))
)
_STORE_AND_SUCCEED = store_and_succeed(_SUCCEED, _END_ATTEMPT)
_SOLVED = (
    select(_SOLUTIONS.c.digest, _SOLUTIONS.c.id)
    .where(_SOLUTIONS.c.digest.in_(bindparam("digests", expanding=True)))
    .order_by(_SOLUTIONS.c.id.desc())
)
_HELD = _SOLVED.with_for_update(read=True, key_share=True)
"""The same, and nobody can delete them before this transaction has ended. SQLite has one writer anyway."""
_STILL_HELD = select(_JOBS.c.id, _JOBS.c.attempt).where(
    _JOBS.c.id.in_(bindparam("ids", expanding=True)),
    may_become(JobState.SUCCEEDED),
    _JOBS.c.owner == bindparam("claimant"),
)
_DIGESTS = 500
"""Digests looked up by one statement: databases limit its parameters."""


def store_and_charge(connection: Connection, ended: Sequence[tuple[Claim, Solved]]) -> set[str]:
    """Store the solutions of one worker's jobs on the accounts of their keys, each with arrays and labels.

    Returns the ids of the jobs whose claims hold: these have succeeded, the others change nothing.
    """
    if is_postgres(connection):
        held = [pair for pair in ended if _store_joined(connection, *pair)]
    else:
        held = _store_each(connection, ended)
    sizes: Counter[str] = Counter()
    for claim, outcome in held:
        if claim.key_id is not None:
            sizes[claim.key_id] += len(outcome.dense) + len(outcome.samples)
    # In one order for all workers: two that charge the same keys must not wait for each other.
    for key_id, size in sorted(sizes.items()):
        charge(connection, key_id, size)
    return {claim.job_id for claim, _ in held}


def _store_joined(connection: Connection, claim: Claim, outcome: Solved) -> bool:
    """Store a solution on Postgres, if the claim holds: by one statement, but for a comparison."""
    summary = _with_examination(outcome.summary, claim.examined_seconds)
    arrays = {"dense": outcome.dense, "samples": outcome.samples}
    if connection.scalar(_STORE_AND_SUCCEED, {**_row(claim, new_id(), summary), **arrays}) is None:
        return False
    if outcome.comparison is not None:
        connection.execute(_COMPARE, {"job": claim.job_id, "compared": outcome.comparison})
    return True


def _store_each(connection: Connection, ended: Sequence[tuple[Claim, Solved]]) -> list[tuple[Claim, Solved]]:
    """Store solutions on SQLite, each statement once for all; return those whose claims hold."""
    if not ended:
        return []
    given = {"ids": [claim.job_id for claim, _ in ended], "claimant": ended[0][0].worker}
    # SQLite has one writer at a time: a claim that holds here still holds below.
    holds = {(row.id, row.attempt) for row in connection.execute(_STILL_HELD, given)}
    held = [pair for pair in ended if (pair[0].job_id, pair[0].attempt) in holds]
    if not held:
        return []
    ids = [new_id() for _ in held]
    rows = [
        _row(claim, solution_id, _with_examination(outcome.summary, claim.examined_seconds))
        for solution_id, (claim, outcome) in zip(ids, held, strict=True)
    ]
    outcomes = [outcome for _, outcome in held]
    moves = [
        _moves(claim, solution_id, reused=False) for solution_id, (claim, _) in zip(ids, held, strict=True)
    ]
    made = list(zip(ids, outcomes, strict=True))
    connection.execute(_INSERT_EACH, rows)
    connection.execute(_INSERT_DENSE, [{"solution_id": each, "data": o.dense} for each, o in made])
    connection.execute(_INSERT_SAMPLES, [{"solution_id": each, "data": o.samples} for each, o in made])
    copy_labels(connection, *ids)
    connection.execute(_SUCCEED_EACH, moves)
    connection.execute(_END_ATTEMPT, moves)
    compared = [
        {"job": claim.job_id, "compared": outcome.comparison}
        for claim, outcome in held
        if outcome.comparison is not None
    ]
    if compared:
        connection.execute(_COMPARE, compared)
    return held


def store_result(session: Session, claim: Claim, outcome: JobResult) -> bool:
    """Store the document that a claimed job has made, on the account of its key, if the claim holds."""
    if not move(session, JobState.SUCCEEDED, *fence(claim), progress=1.0):
        return False
    end_attempt(session, claim.job_id, claim.attempt, AttemptOutcome.SUCCEEDED)
    session.execute(insert(ResultRow).values(job_id=claim.job_id, data=outcome.data))
    charge(session.connection(), claim.key_id, len(outcome.data))
    return True


def _with_examination(summary: Part, seconds: float | None) -> Part:
    """Return the summary with what the examination has cost, which was before the job."""
    cost = summary.get("cost")
    if seconds is None or not isinstance(cost, Mapping):
        return summary
    return {**summary, "cost": {**cost, "examination_seconds": seconds}}


def succeed(connection: Connection, claim: Claim, solution_id: str, *, reused: bool) -> bool:
    """Mark the job of ``claim`` succeeded with a stored solution, if the claim holds."""
    moves = _moves(claim, solution_id, reused=reused)
    if connection.scalar(_SUCCEED, moves) is None:
        return False
    connection.execute(_END_ATTEMPT, moves)
    return True


def solved(connection: Connection, digests: Sequence[str], *, hold: bool) -> dict[str, str]:
    """Return the first solution of each digest that has one: then a job of it succeeded.

    ``hold`` them if this transaction is going to refer to them: nobody deletes them before its end.
    """
    statement = _HELD if hold else _SOLVED
    found: dict[str, str] = {}
    for start in range(0, len(digests), _DIGESTS):
        # In descending order, so that the first solution is the one that is kept.
        found.update(
            (row.digest, row.id)
            for row in connection.execute(statement, {"digests": digests[start : start + _DIGESTS]})
        )
    return found


def _row(claim: Claim, solution_id: str, summary: Part) -> Part:
    """Return the parameters of the statements that store a solution."""
    columns = {
        "id": solution_id,
        "job_id": claim.job_id,
        "summary": summary,
        **summary_columns(claim.problem, summary),
    }
    return {
        **_moves(claim, solution_id, reused=False),
        **{NEW + name: value for name, value in columns.items()},
    }


def _moves(claim: Claim, solution_id: str, *, reused: bool) -> Part:
    return {
        "job": claim.job_id,
        "claimant": claim.worker,
        "try": claim.attempt,
        "solution": solution_id,
        "is_reused": reused,
    }
