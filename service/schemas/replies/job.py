"""The answers of /v1/jobs."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.schemas.replies.response_model import ResponseModel

StateName = Literal["queued", "running", "succeeded", "failed", "cancelled"]


class JobOut(ResponseModel):
    """One piece of queued work."""

    id: str = Field(description="Of the job, a UUID; later jobs have larger ones.")
    state: StateName = Field(description="The last three are final.")
    priority: int = Field(description="Larger first.")
    attempt: int = Field(description="Number of times a worker has taken it.")
    progress: float = Field(description="From 0 to 1.")
    error: dict[str, object] | None = Field(description="Why it failed: `code`, `detail` and more.")
    reused: bool = Field(description="Its solution was computed for an earlier job.")
    solution: str | None = Field(description="Id of the solution, when succeeded.")
    atlas: str | None = Field(
        description="Id of the atlas, when a job has succeeded in drawing one: see `/v1/atlases/{id}`."
    )
    problem: dict[str, object] = Field(description="The document as it was sent.")
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


class JobPageOut(ResponseModel):
    """Some jobs, newest first."""

    items: list[JobOut | dict[str, float | str | bool | None]] = Field(
        description="In the order that was asked for; with `columns` the values of these by their names."
    )
    total: int | None = Field(
        description="Jobs that match in all; null with `where` or `after`, unless `count=exact`."
    )
    limit: int = Field(description="Items on a page at most.")
    offset: int = Field(description="Items left out before this page.")
    next: str | None = Field(
        description="Path and query of the next page, also in the header Link; null on the last one."
    )
