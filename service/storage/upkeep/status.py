"""The activity of an installation at this moment: the queue, the workers and their jobs, the latest rates.

Every figure is read from an index of live jobs or of attempts that ended lately, so
that the cost does not grow with the history.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise

from sqlalchemy import case, func, select
from sqlalchemy.orm import Session

from service.jobs.kernels import ClusterState, Kernels
from service.jobs.records import FINISHED, AttemptOutcome, JobState
from service.storage.database.database import Database
from service.storage.database.rows import database_now, instant
from service.storage.tables.jobs import AttemptRow, JobRow
from service.storage.tables.operations import WorkerRow

LIVE_STATES = tuple(state.value for state in JobState if state not in FINISHED)
RATE_MINUTES = (1, 5, 15)
CURVE_MINUTES = max(RATE_MINUTES)
"""Minutes that are counted one by one."""
MOST_WORKERS = 1000
MOST_RUNNING = 10_000


@dataclass(frozen=True, slots=True)
class QueuePart:
    """Live jobs of one state and kind."""

    state: str
    kind: str
    jobs: int
    oldest_seconds: float
    """Since the oldest one was submitted."""


@dataclass(frozen=True, slots=True)
class RunningJob:
    """A job that a worker is computing."""

    id: str
    kind: str
    sweep: str | None
    """The id of its sweep."""
    attempt: int
    seconds: float
    """Since the attempt began."""


@dataclass(frozen=True, slots=True)
class WorkerStatus:
    """A worker or service that was seen lately."""

    name: str
    host: str
    engine: str
    slots: int
    started_at: datetime
    silent_seconds: float
    kernels: str | None
    """How far they are compiled; None if there is nothing to compile."""
    cluster: ClusterState | None
    """The cluster on which it computes; None if it has children."""
    running: tuple[RunningJob, ...]


@dataclass(frozen=True, slots=True)
class Rate:
    """Attempts at jobs that ended within the last minutes."""

    minutes: int
    by_outcome: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class InstallationStatus:
    """The state of one moment, by the database's clock."""

    at: datetime
    queue: tuple[QueuePart, ...]
    workers: tuple[WorkerStatus, ...]
    rates: tuple[Rate, ...]
    succeeded_by_minute: tuple[int, ...]
    """Successful attempts that ended in each of the last minutes, the latest one last."""


def status_of(database: Database, *, seen_seconds: float) -> InstallationStatus:
    """Return what goes on; a worker that has been silent for longer than ``seen_seconds`` is left out."""
    with database.read() as session:
        now = database_now(session)
        within = _ended_within(session, now)
        succeeded = [counts.get(AttemptOutcome.SUCCEEDED.value, 0) for counts in within]
        by_minute = [more - fewer for fewer, more in pairwise([0, *succeeded])]
        return InstallationStatus(
            instant(now),
            tuple(_queue(session, now)),
            tuple(_workers(session, now, seen_seconds)),
            tuple(Rate(minutes, within[minutes - 1]) for minutes in RATE_MINUTES),
            tuple(reversed(by_minute)),
        )


def _queue(session: Session, now: float) -> Sequence[QueuePart]:
    statement = (
        select(JobRow.state, JobRow.kind, func.count(), func.min(JobRow.created_at))
        .where(JobRow.state.in_(LIVE_STATES))
        .group_by(JobRow.state, JobRow.kind)
        .order_by(JobRow.state, JobRow.kind)
    )
    return [
        QueuePart(state, kind, count, max(0.0, now - oldest))
        for state, kind, count, oldest in session.execute(statement)
    ]


def _workers(session: Session, now: float, seen_seconds: float) -> Sequence[WorkerStatus]:
    columns = JobRow.owner, JobRow.id, JobRow.kind, JobRow.sweep_id, JobRow.attempt, JobRow.started_at
    at_work = select(*columns).where(JobRow.state == JobState.RUNNING.value).order_by(JobRow.id)
    running: dict[str | None, list[RunningJob]] = {}
    for owner, job_id, kind, sweep_id, attempt, started_at in session.execute(at_work.limit(MOST_RUNNING)):
        seconds = max(0.0, now - (now if started_at is None else started_at))
        running.setdefault(owner, []).append(RunningJob(job_id, kind, sweep_id, attempt, seconds))
    seen = select(WorkerRow).where(WorkerRow.seen_at >= now - seen_seconds).order_by(WorkerRow.name)
    return [
        WorkerStatus(
            row.name,
            row.host,
            row.engine,
            row.slots,
            instant(row.started_at),
            max(0.0, now - row.seen_at),
            None if row.kernels is None else str(Kernels.read(row.kernels)),
            None if row.cluster is None else ClusterState.read(row.cluster),
            tuple(running.get(row.name, ())),
        )
        for row in session.scalars(seen.limit(MOST_WORKERS))
    ]


def _ended_within(session: Session, now: float) -> list[Mapping[str, int]]:
    """Return how many attempts ended with each outcome within the last minute, the last two, and so on."""
    since = [now - 60.0 * minutes for minutes in range(1, CURVE_MINUTES + 1)]
    counted = [func.sum(case((AttemptRow.ended_at > start, 1), else_=0)) for start in since]
    ended = select(AttemptRow.outcome, *counted).where(AttemptRow.ended_at > since[-1])
    rows = session.execute(ended.group_by(AttemptRow.outcome)).all()
    return [{str(outcome): int(counts[k]) for outcome, *counts in rows} for k in range(CURVE_MINUTES)]
