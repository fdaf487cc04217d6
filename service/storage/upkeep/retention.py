"""Deletes jobs, solutions and sweeps with all that belongs to them; and what is old.

Old are samples, answers to requests with an Idempotency-Key, surplus examinations. A later request recomputes
samples from the dense output. Dense outputs, enclosures of the certified tier (their radii cannot be
recomputed), samples rounded from enclosures (the dense output has fewer digits), chunks of sweeps, and the
rows of jobs are kept until somebody deletes them.
"""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import ColumnElement, and_, delete, func, or_, select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import InstrumentedAttribute, Session

from service.jobs.records import (
    FINISHED,
    SUBMITTED,
    InUseError,
    JobNotFoundError,
    JobState,
    SolutionNotFoundError,
    StillAtWorkError,
    SweepNotFoundError,
)
from service.storage.codecs.summary import PROVEN_SAMPLES
from service.storage.database.database import Database
from service.storage.database.rows import database_now, first_id, is_id
from service.storage.examinations import ExaminationStore
from service.storage.jobs import chunks
from service.storage.keys import IdempotencyStore, charge
from service.storage.tables.jobs import AuditRow, JobRow, ResultRow
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow, SweepChunkRow, SweepRow

logger = logging.getLogger(__name__)

DAY_SECONDS = 86400.0
BATCH = 100
"""Solutions whose samples are deleted in one transaction: it holds the write lock for milliseconds."""
ROUND_SECONDS = 3600.0
"""How often a service looks for old samples."""

_ID_BELOW_ALL = "00000000-0000-0000-0000-000000000000"


@dataclass(frozen=True, slots=True)
class Pruned:
    """The amount deleted, or to be deleted in a dry run."""

    solutions: int = 0
    data_bytes: int = 0

    def __add__(self, other: "Pruned") -> "Pruned":
        """Return both together."""
        return Pruned(self.solutions + other.solutions, self.data_bytes + other.data_bytes)


def prune_samples(
    database: Database,
    *,
    older_than_seconds: float,
    dry_run: bool = False,
    pause: Callable[[float], object] = time.sleep,
) -> Pruned:
    """Delete samples older than that in batches, and pause after each batch as long as it took.

    Several processes may run it at once, on any number of hosts; each deletion is counted once.
    """
    with database.read() as session:
        before = database_now(session) - older_than_seconds
    last, total = _ID_BELOW_ALL, Pruned()
    while True:
        began = time.monotonic()
        with database.read() as session:
            found = _next_old(session, last, before)
        if not found:
            return total
        last = found[-1][0]
        if dry_run:
            total += Pruned(len(found), sum(size for _, size in found))
            continue
        with database.write() as session:
            total += _delete(session, [solution_id for solution_id, _ in found])
        pause(time.monotonic() - began)


class Retention:
    """A thread that prunes now and then while a service runs; several services may run it at once.

    Without ``older_than_seconds`` samples are kept for ever; examinations are trimmed in any case, and
    answers deleted after their day.
    """

    def __init__(
        self, database: Database, answers: IdempotencyStore, *, older_than_seconds: float | None
    ) -> None:
        self._database, self._answers = database, answers
        self._older_than_seconds = older_than_seconds
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="retention", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop after the batch that is being deleted."""
        self._stopping.set()
        self._thread.join()

    def _keep(self) -> None:
        is_first = True
        while True:
            try:
                # Not at once: a service that is killed and started again and again has better things to do.
                if not is_first:
                    self._answers.forget_old()
                self._prune()
            except _StoppedError:
                return
            except SQLAlchemyError as fault:
                logger.warning("old data could not be deleted: %s", type(fault).__name__)
            is_first = False
            if self._stopping.wait(ROUND_SECONDS):
                return

    def _prune(self) -> None:
        trimmed = ExaminationStore(self._database).trim()
        if trimmed:
            logger.info("kept examinations deleted", extra={"fields": {"examinations": trimmed}})
        if self._older_than_seconds is None:
            return
        pruned = prune_samples(self._database, older_than_seconds=self._older_than_seconds, pause=self._pause)
        if pruned.solutions:
            fields = {"solutions": pruned.solutions, "bytes": pruned.data_bytes}
            logger.info("old samples deleted", extra={"fields": fields})

    def _pause(self, seconds: float) -> None:
        if self._stopping.wait(seconds):
            raise _StoppedError


class _StoppedError(Exception):
    """The service ends."""


def _next_old(session: Session, last: str, before: float) -> list[tuple[str, int]]:
    """Return ids after ``last``, with the sizes of their samples."""
    statement = (
        select(SamplesRow.solution_id, func.length(SamplesRow.data))
        .join(SolutionRow, SolutionRow.id == SamplesRow.solution_id)
        # Ids grow with time, so recent ones are skipped by the index.
        .where(SamplesRow.solution_id > last, SamplesRow.solution_id < first_id(before))
        .where(SolutionRow.created_at < before, _can_be_remade())
        .order_by(SamplesRow.solution_id)
        .limit(BATCH)
    )
    return [(solution_id, size) for solution_id, size in session.execute(statement)]


def _can_be_remade() -> ColumnElement[bool]:
    proven = SolutionRow.summary[("evidence", PROVEN_SAMPLES)].as_string()
    return and_(or_(SolutionRow.tier.is_(None), SolutionRow.tier != "certified"), proven.is_(None))


def _delete(session: Session, solution_ids: list[str]) -> Pruned:
    """Delete samples, and subtract their bytes from the keys that asked for them."""
    statement = delete(SamplesRow).where(SamplesRow.solution_id.in_(solution_ids))
    deleted = session.execute(statement.returning(SamplesRow.solution_id, func.length(SamplesRow.data)))
    sizes = {solution_id: int(size) for solution_id, size in deleted}
    owners = (
        select(SolutionRow.id, JobRow.key_id)
        .join(JobRow, JobRow.id == SolutionRow.job_id)
        .where(SolutionRow.id.in_(sizes), JobRow.key_id.is_not(None))
    )
    by_key: dict[str, int] = {}
    for solution_id, key_id in session.execute(owners):
        assert key_id is not None
        by_key[key_id] = by_key.get(key_id, 0) + sizes[solution_id]
    for key_id in sorted(by_key):
        charge(session.connection(), key_id, -by_key[key_id])
    return Pruned(len(sizes), sum(sizes.values()))


_MOST_TOLD = 100
"""Jobs that are named when they keep a solution from being deleted."""


def delete_job(database: Database, job_id: str) -> None:
    """Delete a finished job, its attempts, and the atlas that it has drawn, which is no longer charged.

    Raises
    ------
    InUseError
        A solution comes from it: deleting the solution deletes the job, too.
    StillAtWorkError, JobNotFoundError
    """
    with database.write() as session:
        row = None
        if is_id(job_id):
            row = session.scalar(
                select(JobRow).where(JobRow.id == job_id, JobRow.kind.in_(SUBMITTED)).with_for_update()
            )
        if row is None:
            raise JobNotFoundError(job_id)
        _require_end("job", row.id, JobState(row.state))
        if own := session.scalar(select(SolutionRow.id).where(SolutionRow.job_id == row.id)):
            raise InUseError(f"job {row.id}", [f"/v1/solutions/{own}"], 1)
        size, key_id = _bytes_of(session, ResultRow.data, ResultRow.job_id == row.id), row.key_id
        session.execute(delete(JobRow).where(JobRow.id == row.id))
        charge(session.connection(), key_id, -size)


def delete_solution(database: Database, solution_id: str) -> None:
    """Delete a solution, its arrays and the job that computed it; its bytes are no longer charged.

    Raises
    ------
    InUseError
        Later jobs have reused it, or a live one audits it.
    SolutionNotFoundError
    """
    with database.write() as session:
        row = None
        if is_id(solution_id):
            # Locked: whoever is about to reuse it waits, and finds that it is gone.
            row = session.execute(
                select(SolutionRow.id, SolutionRow.job_id)
                .where(SolutionRow.id == solution_id)
                .with_for_update()
            ).one_or_none()
        if row is None:
            raise SolutionNotFoundError(solution_id)
        audits = select(AuditRow.job_id).where(AuditRow.solution_id == row.id)
        is_audit = and_(JobRow.id.in_(audits), JobRow.finished_at.is_(None))
        others = or_(JobRow.solution_id == row.id, is_audit), JobRow.id != row.job_id
        if count := session.scalar(select(func.count()).select_from(JobRow).where(*others)):
            found = session.scalars(select(JobRow.id).where(*others).order_by(JobRow.id).limit(_MOST_TOLD))
            raise InUseError(f"solution {row.id}", [f"/v1/jobs/{job_id}" for job_id in found], count)
        size = sum(
            _bytes_of(session, table.data, table.solution_id == row.id)
            for table in (DenseOutputRow, SamplesRow)
        )
        key_id = session.scalar(select(JobRow.key_id).where(JobRow.id == row.job_id))
        session.execute(delete(JobRow).where(JobRow.id == row.job_id))
        session.execute(delete(SolutionRow).where(SolutionRow.id == row.id))
        charge(session.connection(), key_id, -size)


def delete_sweep(database: Database, sweep_id: str) -> None:
    """Delete a finished sweep, its points and its chunks; its bytes are no longer charged.

    Raises
    ------
    StillAtWorkError, SweepNotFoundError
    """
    with database.write() as session:
        row = chunks.hold(session, sweep_id) if is_id(sweep_id) else None
        if row is None:
            raise SweepNotFoundError(sweep_id)
        _require_end("sweep", row.id, JobState(row.state))
        stored = select(func.sum(func.length(SweepChunkRow.data))).where(SweepChunkRow.sweep_id == row.id)
        size, key_id = session.scalar(stored) or 0, row.key_id
        session.execute(
            delete(SweepRow).where(SweepRow.id == row.id).execution_options(synchronize_session=False)
        )
        charge(session.connection(), key_id, -int(size))


def key_of_solution(database: Database, solution_id: str) -> str | None:
    """Return the key that submitted the job that a solution comes from; None if that is not known.

    Raises
    ------
    SolutionNotFoundError
    """
    statement = (
        select(SolutionRow.id, JobRow.key_id)
        .outerjoin(JobRow, JobRow.id == SolutionRow.job_id)
        .where(SolutionRow.id == solution_id)
    )
    with database.read() as session:
        row = session.execute(statement).one_or_none() if is_id(solution_id) else None
    if row is None:
        raise SolutionNotFoundError(solution_id)
    return None if row.key_id is None else str(row.key_id)


def _bytes_of(session: Session, data: InstrumentedAttribute[bytes], condition: ColumnElement[bool]) -> int:
    return session.scalar(select(func.length(data)).where(condition)) or 0


def _require_end(kind: str, its_id: str, state: JobState) -> None:
    if state not in FINISHED:
        raise StillAtWorkError(kind, its_id, state)
