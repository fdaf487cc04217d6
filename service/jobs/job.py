"""Records of a job, a worker's claim to it, and an attempt."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from service.jobs.lanes import Lane
from service.jobs.outcome import StoredSolution
from service.jobs.states import AttemptOutcome, JobKind, JobState
from service.schemas.query.conditions import Value
from service.schemas.reading.marks import UNMARKED, Marks


@dataclass(frozen=True, slots=True)
class Job:
    """One piece of queued work, as stored. Instants are UTC by the database's clock."""

    id: str
    state: JobState
    priority: int
    """Larger first."""
    attempt: int
    """Number of times it was claimed; 0 if never."""
    progress: float
    """Finished share, 0 to 1."""
    error: Mapping[str, object] | None
    reused: bool
    """Its solution was computed for an earlier job."""
    solution_id: str | None
    problem: Mapping[str, object]
    """The problem document; for an atlas, the document that asks for it."""
    digest: str
    """Equal for equal problems under equal numerics."""
    created_at: datetime
    started_at: datetime | None
    """When the last attempt began."""
    finished_at: datetime | None
    key_id: str | None
    """Id of the key that submitted it; None if there were no keys."""
    marks: Marks = UNMARKED
    kind: JobKind = JobKind.SOLVE

    @property
    def is_finished(self) -> bool:
        """Nothing will change any more."""
        return self.finished_at is not None


@dataclass(frozen=True, slots=True)
class Claim:
    """One worker's right to compute a job until its lease ends; every later write checks it."""

    job_id: str
    attempt: int
    worker: str
    problem: Mapping[str, object]
    digest: str
    key_id: str | None
    """Id of the key that is charged for it."""
    kind: JobKind = JobKind.SOLVE
    sweep: Mapping[str, object] | None = None
    """For a chunk: the document of its sweep."""
    sweep_id: str | None = None
    way: str | None = None
    """For a chunk: that of its sweep."""
    lane: Lane = Lane.SINGLE
    windows: str = ""
    """The windows of its curve, as its examination found them; empty where they are not kept."""
    examined_seconds: float | None = None
    """Seconds that its examination took; None without one."""
    audited: StoredSolution | None = None
    """For an audit, the solution that is solved again and compared."""
    alone: bool = False
    """A child computes nothing else with it: a worker was lost that had it, perhaps because of it."""

    @property
    def payload(self) -> Mapping[str, object]:
        """The document to compute: the problem, or {"sweep", "way", "waits", "first", "count"} for a chunk.

        A plain chunk waits for kernels, unless its problem says that nobody will have them.
        """
        if self.sweep is None:
            return self.problem
        return {"sweep": self.sweep, "way": self.way, "waits": True, **self.problem}


@dataclass(frozen=True, slots=True)
class Taken:
    """Jobs that a worker has been given."""

    claims: tuple[Claim, ...] = ()
    """Jobs to compute, in the order of the queue."""
    reused: tuple[str, ...] = ()
    """Ids of those that have succeeded already, with the solution of an equal problem."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt at a job."""

    number: int
    worker: str
    started_at: datetime
    ended_at: datetime | None
    """None while it runs."""
    outcome: AttemptOutcome | None
    detail: str | None


@dataclass(frozen=True, slots=True)
class JobPage:
    """Some jobs, in the order that was asked for."""

    jobs: tuple[Job, ...]
    total: int | None
    """How many there are in all, if that was wanted."""
    values: tuple[tuple[Value | None, ...], ...] = ()
    """The wanted columns of each, in place of the jobs."""
    next: tuple[Value | None, ...] | None = None
    """Where the following page begins; None if there is none."""
