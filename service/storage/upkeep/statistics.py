"""Measures jobs, workers and sweeps for monitoring, and tells the activity of an installation at this moment.

The cost does not grow with the history. Live jobs are counted in the index of states. Ended attempts are
counted from the start of :class:`Statistics` on, by index, each once: sums over the whole history would read
the whole tables. The activity (the queue, the workers and their jobs, the latest rates) is read from an index
of live jobs or of attempts that ended lately.
"""

import threading
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from itertools import pairwise

from sqlalchemy import ColumnElement, case, func, or_, select, text
from sqlalchemy.orm import Session

from service.jobs.kernels import ClusterState, Kernels, most_missing
from service.jobs.records import FINISHED, AttemptOutcome, JobState
from service.storage.database.database import Database
from service.storage.database.rows import database_now, instant
from service.storage.tables.jobs import AttemptRow, JobRow
from service.storage.tables.operations import WorkerRow
from service.storage.tables.solutions import SolutionRow, SweepRow
from service.storage.upkeep.presence import clusters_of

BOUNDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0, 60.0, 300.0)
"""Upper bounds of the histogram of job durations, in seconds."""
SETTLED_SECONDS = 10.0
"""A transaction that recorded the end of an attempt is committed, or rolled back, after this time."""
SHARE = 0.05
"""Fraction of time that may be spent on measuring: costly figures are measured less often."""
YOUNG_SECONDS = 1.0
"""A measurement is reused for at least so long."""
LIVE = tuple(state.value for state in JobState if state not in FINISHED)


@dataclass(slots=True)
class Durations:
    """Histogram of the durations of successful attempts."""

    below: list[int] = field(default_factory=lambda: [0] * len(BOUNDS))
    """For each of BOUNDS, how many took at most that."""
    count: int = 0
    seconds: float = 0.0

    def __add__(self, other: "Durations") -> "Durations":
        """Return both together."""
        below = [mine + theirs for mine, theirs in zip(self.below, other.below, strict=True)]
        return Durations(below, self.count + other.count, self.seconds + other.seconds)


@dataclass(slots=True)
class Ended:
    """Counts of ended attempts."""

    attempts: Counter[str] = field(default_factory=Counter)
    """Numbers of attempts by outcome."""
    durations: dict[tuple[str, str], Durations] = field(default_factory=dict)
    """Durations by method and tier of the solution."""

    def __add__(self, other: "Ended") -> "Ended":
        """Return both together."""
        none = Durations()
        keys = sorted(self.durations.keys() | other.durations.keys())
        durations = {key: self.durations.get(key, none) + other.durations.get(key, none) for key in keys}
        return Ended(self.attempts + other.attempts, durations)


@dataclass(frozen=True, slots=True)
class Workers:
    """Workers with one engine that were seen lately."""

    count: int
    slots: int


@dataclass(frozen=True, slots=True)
class Figures:
    """The state of the database at one moment."""

    live: Mapping[tuple[str, str], int]
    """Jobs by state and kind, where there are any."""
    oldest_queued_seconds: float
    """How long the oldest queued job has waited; 0 if none waits."""
    workers: Mapping[str, Workers]
    """Workers by engine."""
    kernels_missing: int
    """Kernels that the worker with the most of them has still to compile."""
    clusters: Sequence[ClusterState]
    """Dask clusters on which workers compute."""
    sweeps: Mapping[str, int]
    """Live sweeps by state."""
    points: tuple[int, int]
    """Points of sweeps done since the start, and the refused ones among them."""
    ended: Ended
    """Since the start."""
    database_bytes: int
    log_bytes: int
    """Bytes of SQLite's write-ahead log; 0 elsewhere."""
    measured_at: float
    """Instant of the measurement by this process's monotonic clock."""
    seconds: float
    """Seconds that the measurement took."""

    def age(self) -> float:
        """Return how many seconds ago it was."""
        return time.monotonic() - self.measured_at


class Statistics:
    """Measures, and remembers the last measurement for a while. Safe between threads.

    Parameters
    ----------
    database
        What is measured.
    seen_seconds
        A worker that has been silent for longer is not counted.
    """

    def __init__(self, database: Database, *, seen_seconds: float) -> None:
        self._database = database
        self._seen_seconds = seen_seconds
        self._lock = threading.Lock()
        self._settled, self._settled_until = Ended(), time.time()
        self._sweeps = _SweepProgress()
        self._last: Figures | None = None

    def current(self) -> Figures:
        """Return the cached figures unless they have expired; the expiry grows with what measuring cost.

        Raises
        ------
        sqlalchemy.exc.SQLAlchemyError
            The database is away.
        """
        with self._lock:
            if self._last is None or self._is_due(self._last):
                self._last = self._measure()
            return self._last

    def _is_due(self, last: Figures) -> bool:
        return last.age() >= max(YOUNG_SECONDS, last.seconds / SHARE)

    def _measure(self) -> Figures:
        began = time.monotonic()
        with self._database.read() as session:
            now = database_now(session)
            ended = self._ended(session, now)
            live = _live_jobs(session)
            oldest = _oldest_queued(session, now)
            workers = _workers(session, now - self._seen_seconds)
            missing = _kernels_missing(session, now - self._seen_seconds)
            clusters = clusters_of(session, now - self._seen_seconds)
            sweeps = self._sweeps.look(session)
            size = _database_bytes(session)
        points = self._sweeps.done, self._sweeps.refused
        file = self._database.file
        log_size = 0 if file is None else file.log_bytes()
        took = time.monotonic() - began
        return Figures(
            live,
            oldest,
            workers,
            missing,
            clusters,
            sweeps,
            points,
            ended,
            size,
            log_size,
            began + took,
            took,
        )

    def _ended(self, session: Session, now: float) -> Ended:
        """Keep the counts that can no longer change, and count the recent rest anew each time."""
        until = max(now - SETTLED_SECONDS, self._settled_until)
        self._settled += _ended_within(session, self._settled_until, until)
        self._settled_until = until
        return self._settled + _ended_within(session, until, None)


class _SweepProgress:
    """Adds up the progress of sweeps between measurements."""

    def __init__(self) -> None:
        self.done, self.refused = 0, 0
        self._known: dict[str, tuple[int, int]] | None = None
        self._newest = ""

    def look(self, session: Session) -> Counter[str]:
        """Add the progress since the last measurement; return the live sweeps by state."""
        known = self._known or {}
        # Live sweeps, those live at the last measurement, and those created and finished in between.
        interesting: list[ColumnElement[bool]] = [SweepRow.state.in_(LIVE)]
        if known:
            interesting.append(SweepRow.id.in_(known))
        if self._newest:
            interesting.append(SweepRow.id > self._newest)
        columns = SweepRow.id, SweepRow.state, SweepRow.done, SweepRow.refused
        rows = session.execute(select(*columns).where(or_(*interesting))).all()
        newest = session.scalar(select(SweepRow.id).order_by(SweepRow.id.desc()).limit(1))
        if self._known is not None:
            for sweep_id, _, done, refused in rows:
                done_before, refused_before = known.get(sweep_id, (0, 0))
                self.done += done - done_before
                self.refused += refused - refused_before
        live = [row for row in rows if row.state in LIVE]
        self._known = {row.id: (row.done, row.refused) for row in live}
        self._newest = newest or self._newest
        return Counter(row.state for row in live)


def _live_jobs(session: Session) -> dict[tuple[str, str], int]:
    statement = (
        select(JobRow.state, JobRow.kind, func.count())
        .where(JobRow.state.in_(LIVE))
        .group_by(JobRow.state, JobRow.kind)
    )
    return {(state, kind): count for state, kind, count in session.execute(statement)}


def _oldest_queued(session: Session, now: float) -> float:
    # Ids grow with time, so the primary key finds recent rows.
    queued = select(JobRow.created_at).where(JobRow.state == JobState.QUEUED.value)
    created_at = session.scalar(queued.order_by(JobRow.id).limit(1))
    return 0.0 if created_at is None else max(now - created_at, 0.0)


def _kernels_missing(session: Session, since: float) -> int:
    stored = session.scalars(select(WorkerRow.kernels).where(WorkerRow.seen_at >= since)).all()
    most = most_missing(Kernels.read(each) for each in stored if each is not None)
    return 0 if most is None else most.of - most.done


def _workers(session: Session, since: float) -> dict[str, Workers]:
    statement = (
        select(WorkerRow.engine, func.count(), func.sum(WorkerRow.slots))
        .where(WorkerRow.seen_at >= since, WorkerRow.slots > 0)  # a service has none
        .group_by(WorkerRow.engine)
    )
    return {engine: Workers(count, int(slots)) for engine, count, slots in session.execute(statement)}


def _ended_within(session: Session, since: float, until: float | None) -> Ended:
    within = [AttemptRow.ended_at > since]
    if until is not None:
        within.append(AttemptRow.ended_at <= until)
    by_outcome = select(AttemptRow.outcome, func.count()).where(*within).group_by(AttemptRow.outcome)
    took = AttemptRow.ended_at - AttemptRow.started_at
    by_way = (
        select(
            SolutionRow.method,
            SolutionRow.tier,
            func.count(),
            func.sum(took),
            *(func.sum(case((took <= bound, 1), else_=0)) for bound in BOUNDS),
        )
        .join(AttemptRow, AttemptRow.job_id == SolutionRow.job_id)
        .where(AttemptRow.outcome == AttemptOutcome.SUCCEEDED.value, *within)
        .group_by(SolutionRow.method, SolutionRow.tier)
    )
    durations = {
        (method or "", tier or ""): Durations(list(map(int, below)), count, float(seconds))
        for method, tier, count, seconds, *below in session.execute(by_way)
    }
    counts = {str(outcome): count for outcome, count in session.execute(by_outcome)}
    return Ended(Counter(counts), durations)


def _database_bytes(session: Session) -> int:
    if session.get_bind().dialect.name == "sqlite":
        pages = session.scalar(text("PRAGMA page_count")) or 0
        return int(pages) * int(session.scalar(text("PRAGMA page_size")) or 0)
    return int(session.scalar(text("SELECT pg_database_size(current_database())")) or 0)


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
        within = _ended_by_minute(session, now)
        succeeded = [counts.get(AttemptOutcome.SUCCEEDED.value, 0) for counts in within]
        by_minute = [more - fewer for fewer, more in pairwise([0, *succeeded])]
        return InstallationStatus(
            instant(now),
            tuple(_queue(session, now)),
            tuple(_workers_at_work(session, now, seen_seconds)),
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


def _workers_at_work(session: Session, now: float, seen_seconds: float) -> Sequence[WorkerStatus]:
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


def _ended_by_minute(session: Session, now: float) -> list[Mapping[str, int]]:
    """Return how many attempts ended with each outcome within the last minute, the last two, and so on."""
    since = [now - 60.0 * minutes for minutes in range(1, CURVE_MINUTES + 1)]
    counted = [func.sum(case((AttemptRow.ended_at > start, 1), else_=0)) for start in since]
    ended = select(AttemptRow.outcome, *counted).where(AttemptRow.ended_at > since[-1])
    rows = session.execute(ended.group_by(AttemptRow.outcome)).all()
    return [{str(outcome): int(counts[k]) for outcome, *counts in rows} for k in range(CURVE_MINUTES)]
