"""A job, the right to try it, and the record of a try."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from service.jobs.lanes import Lane
from service.jobs.states import AttemptOutcome, JobKind, JobState


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
    """From 0 to 1."""
    error: Mapping[str, object] | None
    reused: bool
    """Its solution was computed for an earlier job."""
    solution_id: str | None
    problem: Mapping[str, object]
    digest: str
    """Equal for equal problems under equal numerics."""
    created_at: datetime
    started_at: datetime | None
    """When the last attempt began."""
    finished_at: datetime | None
    key_id: str | None
    """Of the key that submitted it; None if there were no keys."""

    @property
    def is_finished(self) -> bool:
        """Nothing will change any more."""
        return self.finished_at is not None


@dataclass(frozen=True, slots=True)
class Claim:
    """The right of one worker to try a job, until its lease ends: the fence of every later write."""

    job_id: str
    attempt: int
    worker: str
    problem: Mapping[str, object]
    digest: str
    key_id: str | None
    """Of the key on whose account it was submitted."""
    kind: JobKind = JobKind.SOLVE
    sweep: Mapping[str, object] | None = None
    """Of a chunk: the document of the sweep that it belongs to."""
    sweep_id: str | None = None
    lane: Lane = Lane.SINGLE

    @property
    def payload(self) -> Mapping[str, object]:
        """What the computation gets: the problem, or {"sweep", "first", "count"} of a chunk."""
        return self.problem if self.sweep is None else {"sweep": self.sweep, **self.problem}


@dataclass(frozen=True, slots=True)
class Taken:
    """Jobs that a worker has got."""

    claims: tuple[Claim, ...] = ()
    """To be computed, in the order of the queue."""
    reused: tuple[str, ...] = ()
    """Ids of those that have succeeded already, with the solution of an equal problem."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One try at a job."""

    number: int
    worker: str
    started_at: datetime
    ended_at: datetime | None
    """None while it runs."""
    outcome: AttemptOutcome | None
    detail: str | None


@dataclass(frozen=True, slots=True)
class JobPage:
    """Some jobs, newest first, and how many there are in all."""

    jobs: tuple[Job, ...]
    total: int
