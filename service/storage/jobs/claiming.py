"""Gives queued jobs to a worker, within the caller's transaction."""

from collections.abc import Iterable, Sequence
from typing import Any  # of a row that the statement describes

from sqlalchemy import (
    ColumnElement,
    Connection,
    Row,
    Select,
    Update,
    bindparam,
    insert,
    literal_column,
    select,
    update,
)

from service.jobs.queue import Lane
from service.jobs.records import Claim, ClaimedJobs, JobKind, JobState, StoredSolution
from service.storage.database.database import is_postgres
from service.storage.examinations import examination_version, sound_content
from service.storage.jobs import chunks
from service.storage.jobs.finishing import solved, succeed
from service.storage.jobs.queue import first_jobs
from service.storage.jobs.rows import may_become
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.jobs import AttemptRow, AuditRow, JobRow
from service.storage.tables.operations import ExaminationRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow

_SOLUTIONS, _DENSE, _SAMPLES = table_of(SolutionRow), table_of(DenseOutputRow), table_of(SamplesRow)
_STORED = (
    select(_SOLUTIONS.c.id, _SOLUTIONS.c.problem, _SOLUTIONS.c.summary, _DENSE.c.data, _SAMPLES.c.data)
    .outerjoin(_DENSE, _DENSE.c.solution_id == _SOLUTIONS.c.id)
    .outerjoin(_SAMPLES, _SAMPLES.c.solution_id == _SOLUTIONS.c.id)
    .where(_SOLUTIONS.c.id.in_(bindparam("ids", expanding=True)))
)


def stored_solutions(connection: Connection, solution_ids: Sequence[str]) -> dict[str, StoredSolution]:
    """Return those of the solutions that there are, by their ids."""
    rows = connection.execute(_STORED, {"ids": solution_ids})
    return {
        str(solution_id): StoredSolution(problem, summary, dense or b"", samples)
        for solution_id, problem, summary, dense, samples in rows
    }


_JOBS, _EXAMINATIONS, _AUDITS = table_of(JobRow), table_of(ExaminationRow), table_of(AuditRow)


def _cached(name: str) -> ColumnElement[object]:
    """Return a column of the cached windows that a job names, null if this version has found none."""
    found = select(_EXAMINATIONS.c[name]).where(
        _EXAMINATIONS.c.key == _JOBS.c.examination, _EXAMINATIONS.c.version == bindparam("examined_by")
    )
    return found.correlate(_JOBS).scalar_subquery().label(name)


_CLAIMABLE = (
    select(_JOBS.c.id)
    .where(
        _JOBS.c.id.in_(bindparam("ids", expanding=True)),
        may_become(JobState.RUNNING),
        _JOBS.c.ready_at <= DatabaseNow(),
    )
    # Skip locked rows: their holder is finishing the job, and waiting on several could deadlock.
    .with_for_update(skip_locked=True)
)
_CLAIM = (
    update(_JOBS)
    .where(_JOBS.c.id.in_(_CLAIMABLE))
    .values(
        state=JobState.RUNNING.value,
        owner=bindparam("claimant"),
        attempt=_JOBS.c.attempt + 1,
        started_at=DatabaseNow(),
        lease_until=DatabaseNow() + bindparam("lease_seconds"),
    )
    .returning(
        _JOBS.c.id,
        _JOBS.c.kind,
        _JOBS.c.attempt,
        _JOBS.c.alone,
        _JOBS.c.lane,
        _JOBS.c.problem,
        _JOBS.c.digest,
        _JOBS.c.key_id,
        _JOBS.c.sweep_id,
        _JOBS.c.started_at,
        _cached("content"),
        _cached("seal"),
        _JOBS.c.examination,
        _JOBS.c.examined_seconds,
        select(_AUDITS.c.solution_id)
        .where(_AUDITS.c.job_id == _JOBS.c.id)
        .correlate(_JOBS)
        .scalar_subquery()
        .label("audited"),
    )
)


def _claim_and_begin(claim: Update) -> Select[*tuple[object, ...]]:
    """Return the statement that begins the attempts of the jobs that ``claim`` returns.

    Its rows have in ``solved`` the first solution of an equal problem, if there is one.
    """
    claimed = claim.cte("claimed")
    begun = insert(table_of(AttemptRow)).from_select(
        ["job_id", "number", "worker", "started_at"],
        select(claimed.c.id, claimed.c.attempt, bindparam("claimant"), claimed.c.started_at),
    )
    solved = (
        select(_SOLUTIONS.c.id)
        .where(_SOLUTIONS.c.digest == claimed.c.digest)
        .order_by(_SOLUTIONS.c.id)
        .limit(literal_column("1"))
        .scalar_subquery()
    )
    columns: Iterable[ColumnElement[object]] = (*claimed.c, solved.label("solved"))
    return select(*columns).add_cte(begun.cte("begun"))


_CLAIM_AND_BEGIN = _claim_and_begin(_CLAIM)
_BEGIN = insert(table_of(AttemptRow))


def take_jobs(
    connection: Connection,
    worker: str,
    count: int,
    lease_seconds: float,
    starved: Sequence[Lane] = (),
    together: int = 1,
) -> ClaimedJobs | None:
    """Claim the next jobs; finish at once those whose problem has a stored solution by now.

    None if none is ready. The claims may be empty: each of them may have been reused.
    """
    ids = first_jobs(connection, count, starved, together) if count else None
    if ids is None:
        return None
    claims, solutions = _claim(connection, ids, worker, lease_seconds)
    reused = [
        claim
        for claim in claims
        # An audit computes what is stored already.
        if claim.digest in solutions
        and claim.audited is None
        and succeed(connection, claim, solutions[claim.digest], reused=True)
    ]
    return ClaimedJobs(
        tuple(claim for claim in claims if claim not in reused), tuple(claim.job_id for claim in reused)
    )


def _claim(
    connection: Connection, ids: Sequence[str], worker: str, lease_seconds: float
) -> tuple[list[Claim], dict[str, str]]:
    """Claim those of the jobs that are queued, in one compare-and-set, in the order of ``ids``.

    Returns also the solutions that equal problems have already, by their digests.
    """
    given = {
        "ids": ids,
        "claimant": worker,
        "lease_seconds": lease_seconds,
        "examined_by": examination_version(),
    }
    if is_postgres(connection):
        rows: Sequence[Row[*tuple[Any, ...]]] = connection.execute(_CLAIM_AND_BEGIN, given).all()
        solutions = {row.digest: row.solved for row in rows if row.solved is not None}
    else:
        rows = connection.execute(_CLAIM, given).all()
        attempts = [
            {"job_id": row.id, "number": row.attempt, "worker": worker, "started_at": row.started_at}
            for row in rows
        ]
        if attempts:
            connection.execute(_BEGIN, attempts)
        solutions = solved(connection, sorted({row.digest for row in rows}), hold=True)
    audited = {row.audited for row in rows if row.audited is not None}
    stored = stored_solutions(connection, sorted(audited)) if audited else {}
    order = {job_id: index for index, job_id in enumerate(ids)}
    begun = {
        row.sweep_id: chunks.begin(connection, row.sweep_id, worker)
        for row in rows
        if row.sweep_id is not None
    }
    claims = [
        Claim(
            job_id=row.id,
            attempt=row.attempt,
            worker=worker,
            problem=row.problem,
            digest=row.digest,
            key_id=row.key_id,
            kind=JobKind(row.kind),
            sweep=None if row.sweep_id is None else begun[row.sweep_id].document,
            sweep_id=row.sweep_id,
            way=None if row.sweep_id is None else begun[row.sweep_id].way,
            lane=Lane(row.lane),
            windows=_windows(row),
            audited=stored.get(row.audited),
            examined_seconds=row.examined_seconds,
            alone=row.alone,
        )
        for row in sorted(rows, key=lambda row: order[row.id])
    ]
    return claims, solutions


def _windows(row: Row[*tuple[Any, ...]]) -> str:
    if row.content is None:
        return ""
    return sound_content(row.examination, row.content, row.seal) or ""
