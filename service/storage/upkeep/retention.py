"""Deletes what is old: samples, answers to requests with an Idempotency-Key, surplus examinations.

A later request recomputes samples from the dense output.
Dense outputs, enclosures of the certified tier (their radii cannot be recomputed),
samples rounded from enclosures (the dense output has fewer digits), chunks of
sweeps, and the rows of jobs are kept for ever.
"""

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from sqlalchemy import ColumnElement, and_, delete, func, or_, select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from service.storage.codecs.summary import PROVEN_SAMPLES
from service.storage.database.database import Database
from service.storage.database.rows import database_now, first_id
from service.storage.examinations import ExaminationStore
from service.storage.keys.idempotency_store import IdempotencyStore
from service.storage.keys.key_store import charge
from service.storage.tables.jobs import JobRow
from service.storage.tables.solutions import SamplesRow, SolutionRow

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
