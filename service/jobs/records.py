"""Jobs and sweeps as they are stored: states, legal moves, results, claims, attempts, errors of requests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum

from service.jobs.queue import Lane
from service.schemas.query.terms import Value
from service.schemas.reading.documents import UNANNOTATED, Annotation, Document, Part
from service.schemas.replies.summary import SolutionSummary


class JobKind(StrEnum):
    """Kinds of jobs, by what is computed."""

    SOLVE = "solve"
    """The solution of one problem."""
    CHUNK = "chunk"
    """Some neighbouring points of a sweep."""
    ATLAS = "atlas"
    """All planar motions over a range of λ."""
    STUDY = "study"
    """An answer to a question about integrals, potentials or numbers."""


SUBMITTED = frozenset({JobKind.SOLVE, JobKind.ATLAS, JobKind.STUDY})
"""Kinds that clients submit, show, cancel and delete as a job; a chunk is a part of its sweep."""


class JobState(StrEnum):
    """The state of a job."""

    QUEUED = "queued"
    """Waits for a worker."""
    RUNNING = "running"
    """One worker holds its lease."""
    SUCCEEDED = "succeeded"
    """Its solution is in the database."""
    FAILED = "failed"
    """Its error says why."""
    CANCELLED = "cancelled"
    """A client asked for it; what a worker still computes is discarded."""


ALLOWED: dict[JobState, frozenset[JobState]] = {
    JobState.QUEUED: frozenset({JobState.RUNNING, JobState.CANCELLED}),
    JobState.RUNNING: frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED, JobState.QUEUED}),
    JobState.SUCCEEDED: frozenset(),
    JobState.FAILED: frozenset(),
    JobState.CANCELLED: frozenset(),
}
"""The only legal moves. RUNNING returns to QUEUED when its worker is lost or stops."""

FINISHED: frozenset[JobState] = frozenset(state for state, moves in ALLOWED.items() if not moves)
"""Final states."""


def sources(target: JobState) -> tuple[JobState, ...]:
    """Return the states from which ``target`` may be reached; every UPDATE of a state checks them."""
    return tuple(state for state, moves in ALLOWED.items() if target in moves)


class AttemptOutcome(StrEnum):
    """The ways in which an attempt at a job can end."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    """The computation failed, or reached its limit of time or memory: a retry would end the same way."""
    LOST = "lost"
    """The child died that computed it, or the whole worker, which had only this one; only this is counted."""
    RETURNED = "returned"
    """It went back to the queue, and may not have begun: its worker was asked to stop, a job that it took
    together took long, or the worker died, which had it with others. After a death it is computed alone."""
    CANCELLED = "cancelled"


def after_loss(losses: int, max_attempts: int) -> JobState:
    """Return the next state of a job that has lost ``losses`` workers, this one included."""
    return JobState.QUEUED if losses < max_attempts else JobState.FAILED


MOST_DOUBTS = 8
"""How often a job is returned from lost workers without being counted, since they had others beside it.

Jobs in other children of a worker may be to blame. A limit, since a worker may never have only this one.
"""
LONGEST_PAUSE_SECONDS = 60.0
JITTER = 0.2
"""Random fraction added to a pause, so that jobs lost together do not come back together."""


def pause_after(losses: int, first_seconds: float, spread: float) -> float:
    """Return how long a job waits that has lost ``losses`` workers: twice as long each time.

    The first time it does not wait: the worker may have been killed for any reason.
    ``spread`` is a random number from -1 to 1.
    """
    if losses < 2:
        return 0.0
    # The exponent is bounded: 2**losses could be too large for a double.
    pause = min(first_seconds * 2.0 ** min(losses - 2, 60), LONGEST_PAUSE_SECONDS)
    return pause * (1.0 + JITTER * spread)


@dataclass(frozen=True, slots=True)
class Solved:
    """The solution of one problem document."""

    summary: SolutionSummary
    dense: bytes
    """The function of time, encoded by :mod:`service.storage.codecs.packing`; so are the samples."""
    samples: bytes
    comparison: Mapping[str, object] | None = None
    """For an audit, the comparison with the stored solution."""


@dataclass(frozen=True, slots=True)
class StoredSolution:
    """A solution as it is stored, for a comparison with another one."""

    problem: Mapping[str, object]
    summary: Mapping[str, object]
    dense: bytes
    """Empty if it is missing, which no regular way leads to."""
    samples: bytes | None
    """None if they were removed to save space."""


@dataclass(frozen=True, slots=True)
class Refused:
    """Why one problem document has no solution."""

    error: Document
    """Holds at least ``code`` and ``detail``."""


SolveOutcome = Solved | Refused


@dataclass(frozen=True, slots=True)
class ChunkOutcome:
    """The results for some neighbouring points of a sweep.

    Made by :func:`service.storage.codecs.packing.chunk_outcome`.
    """

    count: int
    """Number of computed points, counted from the first, at least 1; the others are queued again."""
    refused: int
    """Points among them that were not solved; ``data`` has the reasons."""
    data: bytes
    """The columns of the points, encoded by :mod:`service.storage.codecs.packing`."""
    bounds: Mapping[str, tuple[float, float]]
    """Smallest and largest of each kept number that any point has."""
    seconds: float
    """Seconds that computing them took."""
    source: Mapping[str, object] | None = None
    """The ``host`` that computed them, and the provenance of a solution from there."""


@dataclass(frozen=True, slots=True)
class JobResult:
    """The document that a job has made: an atlas, or the answer of a study."""

    data: bytes
    """Encoded by :mod:`service.storage.codecs.packing`."""


Outcome = SolveOutcome | ChunkOutcome | JobResult


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
    """The problem document; for an atlas or a study, the document that asks for it."""
    digest: str
    """Equal for equal problems under equal numerics."""
    created_at: datetime
    started_at: datetime | None
    """When the last attempt began."""
    finished_at: datetime | None
    key_id: str | None
    """Id of the key that submitted it; None if there were no keys."""
    annotation: Annotation = UNANNOTATED
    kind: JobKind = JobKind.SOLVE
    result: Mapping[str, object] | None = None
    """The answer of a study that has succeeded."""

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
class ClaimedJobs:
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
    """Number of all of them, if that was wanted."""
    values: tuple[tuple[Value | None, ...], ...] = ()
    """The wanted columns of each, in place of the jobs."""
    next: tuple[Value | None, ...] | None = None
    """Values at which the following page begins; None if there is none."""


POINTS_PER_JOB = 100
"""So many unfinished points of a sweep count as one queued job, since they take about as long."""


def queued_as(points: int) -> int:
    """Return the number of queued jobs that ``points`` of a sweep count as."""
    return -(-points // POINTS_PER_JOB)


@dataclass(frozen=True, slots=True)
class SweepProgress:
    """A stored sweep and its progress. Instants are UTC by the database's clock."""

    id: str
    state: JobState
    """Never ``failed``: a point that cannot be computed is a point with a reason."""
    points: int
    done: int
    """Points that are stored, the refused ones among them."""
    refused: int
    point_seconds: float | None
    """Seconds of computing per point, in the chunk that was stored last."""
    remaining_seconds: float | None
    """Estimated seconds to the end; None if the sweep does not run, or too few chunks have ended."""
    priority: int
    key_id: str | None
    """Id of the key that submitted it."""
    created_at: datetime
    started_at: datetime | None
    """When its first chunk was claimed."""
    finished_at: datetime | None
    way: str | None
    """The way to compute all its points, ``compiled`` or ``plain``; None until its first chunk is claimed."""
    annotation: Annotation


@dataclass(frozen=True, slots=True)
class SweepRecord(SweepProgress):
    """One sweep."""

    document: Mapping[str, object]
    provenances: Sequence[Part]
    """Origins of its points: each provenance of a solution once, with the names of its ``hosts``."""


@dataclass(frozen=True, slots=True)
class SweepPage:
    """Some sweeps without their documents, in the order that was asked for."""

    sweeps: tuple[SweepProgress, ...]
    total: int | None
    """Number of all of them, if that was wanted."""
    values: tuple[tuple[Value | None, ...], ...] = ()
    """The wanted columns of each, in place of the sweeps."""
    next: tuple[Value | None, ...] | None = None
    """Values at which the following page begins; None if there is none."""


class SweepNotFoundError(LookupError):
    """There is no sweep of that id."""

    def __init__(self, sweep_id: str) -> None:
        super().__init__(f"there is no sweep {sweep_id}")
        self.sweep_id = sweep_id


class SweepFinishedError(Exception):
    """A sweep that has succeeded cannot be cancelled."""

    def __init__(self, sweep_id: str, state: JobState) -> None:
        super().__init__(
            f"sweep {sweep_id} has already {state}: only queued and running sweeps can be cancelled"
        )
        self.sweep_id, self.state = sweep_id, state


class JobNotFoundError(LookupError):
    """There is no job of that id."""

    def __init__(self, job_id: str) -> None:
        super().__init__(f"there is no job {job_id}")
        self.job_id = job_id


class JobFinishedError(Exception):
    """A job that has succeeded or failed cannot be cancelled."""

    def __init__(self, job_id: str, state: JobState) -> None:
        super().__init__(f"job {job_id} has already {state}: only queued and running jobs can be cancelled")
        self.job_id, self.state = job_id, state


class SolutionNotFoundError(LookupError):
    """There is no solution of that id."""

    def __init__(self, solution_id: str) -> None:
        super().__init__(f"there is no solution {solution_id}")
        self.solution_id = solution_id


class AuditNotFoundError(LookupError):
    """There is no audit of that id of that solution."""

    def __init__(self, solution_id: str, audit_id: str) -> None:
        super().__init__(f"there is no audit {audit_id} of a solution {solution_id}")


class ResultNotFoundError(LookupError):
    """No job of that id has made such a document."""

    def __init__(self, kind: JobKind, its_id: str) -> None:
        name = {JobKind.ATLAS: "atlas", JobKind.STUDY: "result of a study"}[kind]
        super().__init__(f"there is no {name} {its_id}; a job has one when it has succeeded")


class StillAtWorkError(Exception):
    """A job or a sweep that has not finished cannot be deleted."""

    def __init__(self, kind: str, its_id: str, state: JobState) -> None:
        super().__init__(f"{kind} {its_id} is {state}: only finished ones can be deleted; cancel it first")
        self.state = state


class InUseError(Exception):
    """Something else refers to what should be deleted."""

    def __init__(self, what: str, referrers: Sequence[str], count: int) -> None:
        super().__init__(f"{what} cannot be deleted; number of those that refer to it: {count}")
        self.referrers = tuple(referrers)
