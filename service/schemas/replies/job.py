"""The answers of /v1/jobs and /v1/status, and problem details (RFC 9457)."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.schemas.replies.response_model import Columns, PageOut, ResponseModel
from service.schemas.replies.summary import StateName
from service.schemas.replies.verdict import CounterexampleOut, EvidenceOut, ExistenceOut, MotionWindowOut


class JobOut(ResponseModel):
    """One piece of queued work."""

    id: str = Field(description="Of the job, a UUID; later jobs have larger ones.")
    state: StateName = Field(description="The last three are final.")
    priority: int = Field(description="Larger first.")
    attempt: int = Field(description="Number of times a worker has taken it.")
    progress: float = Field(
        description="From 0 to 1, which only what has succeeded has; it never falls. A study tells how much"
        " of its box is settled, or how many of its steps are done; other jobs tell nothing on the way."
    )
    error: dict[str, object] | None = Field(description="Why it failed: `code`, `detail` and more.")
    reused: bool = Field(description="Its solution was computed for an earlier job.")
    solution: str | None = Field(description="Id of the solution, when succeeded.")
    atlas: str | None = Field(
        description="Id of the atlas, when a job has succeeded in drawing one: see `/v1/atlases/{id}`."
    )
    result: dict[str, object] | None = Field(
        description="The answer of a study, when a job has succeeded in it; see also `/v1/jobs/{id}/result`."
    )
    problem: dict[str, object] = Field(description="The document as it was sent; of a study with `what`.")
    labels: dict[str, str] = Field(description="Its labels: values by their keys.")
    note: str | None = Field(description="What somebody wrote on it.")
    created_at: datetime = Field(description="When it was submitted, UTC.")
    started_at: datetime | None = Field(description="When the last attempt began.")
    finished_at: datetime | None = Field(description="When it came to its final state.")


class JobItemOut(ResponseModel):
    """The result of submitting one problem of a list."""

    status: int = Field(description="HTTP status as if it had been sent alone: 202, or that of its refusal.")
    job: JobOut | None = Field(description="The job, if it was accepted.")
    problem: dict[str, object] | None = Field(description="The refusal, as a problem document.")


class JobListOut(ResponseModel):
    """The results of submitting a list of problems, in its order."""

    items: list[JobItemOut] = Field(description="One result for each problem.")


class JobPageOut(PageOut[JobOut | Columns]):
    """Some jobs, newest first."""


KindName = Literal["solve", "chunk", "atlas", "study"]
KIND = "`solve`: of one problem; `chunk`: of a sweep; `atlas`: draws an atlas; `study`: answers a question."


class AttemptOut(ResponseModel):
    """One try at a job."""

    number: int = Field(description="From 1.")
    worker: str = Field(description="Name of the worker.")
    started_at: datetime = Field(description="When it began, UTC.")
    ended_at: datetime | None = Field(description="When it ended; null while it runs.")
    outcome: Literal["succeeded", "failed", "cancelled", "lost", "returned"] | None = Field(
        description="`lost`: the child process died, or the worker that had only this job for it;"
        " `returned`: not computed, or nobody knows whether it had begun when its worker died."
    )
    detail: str | None = Field(description="The reason, where there is one.")


class AttemptsOut(ResponseModel):
    """The history of a job."""

    items: list[AttemptOut] = Field(description="The attempts, oldest first.")


class ChunkJobOut(ResponseModel):
    """A job that computes some neighbouring points of a sweep."""

    id: str = Field(description="Of the job.")
    state: StateName = Field(description="The last three are final.")
    first: int = Field(description="Index of its first point.")
    count: int = Field(description="Points that it was given; what it did not reach is queued again.")
    attempt: int = Field(description="Number of times a worker has taken it.")
    progress: float = Field(description="From 0 to 1.")
    error: dict[str, object] | None = Field(description="Why it failed: `code`, `detail` and more.")
    created_at: datetime = Field(description="When it was queued, UTC.")
    started_at: datetime | None = Field(description="When the last attempt began.")
    finished_at: datetime | None = Field(description="When it came to its final state.")
    host: str | None = Field(description="The host that computed its points; null if that is not known.")
    provenance: int | None = Field(
        description="Which of the `provenances` of its sweep that host has, from 0; null as `host`."
    )


class ChunkJobPageOut(PageOut[ChunkJobOut | Columns]):
    """Some jobs of a sweep."""


class QueuePartOut(ResponseModel):
    """Live jobs of one state and kind."""

    state: Literal["queued", "running"] = Field(description="Where they are in their lives.")
    kind: KindName = Field(description=KIND)
    jobs: int = Field(description="How many.")
    oldest_seconds: float = Field(description="Seconds since the oldest one was submitted.")


class RunningJobOut(ResponseModel):
    """A job that a worker is computing."""

    id: str = Field(description="Of the job.")
    kind: KindName = Field(description=KIND)
    sweep: str | None = Field(description="Of a chunk: its sweep.")
    attempt: int = Field(description="Number of times a worker has taken it.")
    seconds: float = Field(description="Since the attempt began.")


class LeftOutOut(ResponseModel):
    """A worker of a cluster that computes nothing."""

    worker: str = Field(description="Its address.")
    why: str = Field(description="For people.")


class ClusterOut(ResponseModel):
    """A Dask cluster that computes for a worker."""

    scheduler: str = Field(description="Address of its scheduler, or the path of its file.")
    is_connected: bool = Field(description="Whether the worker is connected to the scheduler.")
    workers: int = Field(description="Workers that are ready.")
    threads: int = Field(description="Jobs that they compute at once.")
    left_out: list[LeftOutOut] = Field(description="Workers that get no jobs.")
    dashboard: str | None = Field(description="Address of Dask's own page; null if it has none.")


class WorkerOut(ResponseModel):
    """A worker or service that was seen lately."""

    name: str = Field(description="As in attempts.")
    host: str = Field(description="The machine.")
    engine: str = Field(description="`local`, `postgres`, or `service` for an API process.")
    slots: int = Field(description="Jobs that it computes at once; 0 for a service.")
    started_at: datetime = Field(description="When it started, UTC.")
    silent_seconds: float = Field(description="Since its last sign of life.")
    kernels: str | None = Field(
        description="How far its kernels are compiled; null if all are. Until then jobs go the plain way."
    )
    cluster: ClusterOut | None = Field(description="Where it computes; null: in children of its own.")
    running: list[RunningJobOut] = Field(description="What it does.")


class RateOut(ResponseModel):
    """Attempts at jobs that ended lately."""

    minutes: int = Field(description="Within so many last minutes.")
    succeeded: int = Field(description="With a result.")
    failed: int = Field(description="With an error.")
    cancelled: int = Field(description="By a client.")
    lost: int = Field(description="By the death of a worker or its child process.")
    returned: int = Field(description="Returned to the queue.")


class StatusOut(ResponseModel):
    """The activity of the installation at one instant."""

    at: datetime = Field(description="The instant of these figures by the database's clock, UTC.")
    queue: list[QueuePartOut] = Field(description="The live jobs; what there is none of is left out.")
    workers: list[WorkerOut] = Field(description="Workers and services that were seen lately.")
    rates: list[RateOut] = Field(description="Of the last 1, 5 and 15 minutes.")
    succeeded_by_minute: list[int] = Field(
        description="Attempts with a result in each of the last 15 minutes, the latest minute last."
    )


class FaultOut(ResponseModel):
    """One fault of a request."""

    pointer: str = Field(description="JSON pointer into the body; `?name` is a query parameter.")
    code: str = Field(description="Stable code for programs.")
    message: str = Field(description="Sentence for people; says what would have been accepted.")
    position: int = Field(
        default=0,
        description="Of a fault in the language of queries: its character in the parameter, from 0.",
    )


class ProblemDetailsOut(ResponseModel):
    """Why a request was refused. Fields that do not apply are left out."""

    type: str = Field(description="`urn:polhode:problem:` and the code.")
    title: str = Field(description="The kind of refusal in a few words; the same for all with this type.")
    status: int = Field(description="The HTTP status, again.")
    detail: str = Field(description="The fault of this request, for people.")
    errors: list[FaultOut] = Field(description="Every fault of the request.")
    counterexample: CounterexampleOut = Field(
        description="With `inadmissible_potential` and `inadmissible_motion`."
    )
    evidence: EvidenceOut = Field(description="With `undecided_potential`.")
    verdict: Literal["admissible", "undecided"] = Field(
        description="With `signs_unsettled`, `essential_singularity`, `separatrix_undecided` and"
        " `passage_undecided`: the verdict on the potential, which is known although the windows are not."
    )
    existence: ExistenceOut = Field(
        description="With `no_motion`: the λ for which motions exist. Left out in a list of jobs if"
        " too many problems are refused."
    )
    windows: list[MotionWindowOut] = Field(description="With `several_windows` and `no_such_window`.")
    items: list[JobItemOut] = Field(
        description="With `no_problem_accepted`: the refusal of each problem of the list, in its order."
    )
    checks: dict[str, str] = Field(description="With `not_ready`.")
    referrers: list[str] = Field(description="With `in_use`: paths of what refers to it, 100 at most.")
    needed_role: str = Field(description="With `role_insufficient`.")
    exceeds_limit: Literal[True] = Field(
        description="With `too_many_queued_jobs`: even an empty queue would not take so many at once."
    )
    request_id: str = Field(description="Also in the header X-Request-ID, and in the log of the service.")
