"""The answers of /v1/solutions/{id}/audits."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.schemas.replies.job import StateName
from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.solution import ProvenanceOut


class DifferenceOut(ResponseModel):
    """The difference of two solutions in one number or column."""

    difference: float | None = Field(
        description="Largest absolute difference; null if one of the numbers is none."
    )
    allowed: float | None = Field(description="Sum of the errors that both claim.")
    share: float | None = Field(
        description="The difference in units of what is allowed, of columns the largest: up to 1 they agree."
        " Null if that is no number: then they do not."
    )


class AuditedOut(ResponseModel):
    """Method, tier, error and provenance of one of the two solutions."""

    method: str = Field(description="The method.")
    tier: str = Field(description="The tier of accuracy.")
    error: float = Field(description="Its claimed error of any variable.")
    provenance: ProvenanceOut | None = Field(description="Version, numerics and machine.")


class ComparisonOut(ResponseModel):
    """The comparison of a stored solution with the new one."""

    identical: bool = Field(description="All stored numbers are the same bits.")
    detail: str = Field(description="The result in words.")
    differences: dict[str, DifferenceOut] = Field(
        description="Of what both have: `period`, `energy`, `trace`, `psi1`, `psi3`, `function` (at 33"
        " times), `samples` (all that are stored). Empty if a stored part cannot be read or is missing."
    )
    stored: AuditedOut = Field(description="The audited solution.")
    found: AuditedOut = Field(description="The new solution.")


class AuditOut(ResponseModel):
    """An audit: a job that solves the problem of a solution again."""

    id: str = Field(description="Of the audit, and of its job: `/v1/jobs/{id}` has its attempts and events.")
    solution: str = Field(description="Id of the audited solution.")
    state: StateName = Field(description="Of the job.")
    verdict: Literal["agrees", "disagrees", "failed"] | None = Field(
        description="`agrees`: within the errors that both claim. `failed`: there is no second solution, see"
        " `error`. Null while the job is live or if it was cancelled."
    )
    found: str | None = Field(description="Id of the new solution, when succeeded.")
    comparison: ComparisonOut | None = Field(description="Of the two solutions, when succeeded.")
    error: dict[str, object] | None = Field(description="Why it failed: `code` and `detail`.")
    problem: dict[str, object] = Field(description="What is solved.")
    created_at: datetime = Field(description="When it was asked for, UTC.")
    finished_at: datetime | None = Field(description="When the job came to its final state.")


class AuditPageOut(ResponseModel):
    """Some audits of a solution, newest first."""

    items: list[AuditOut | dict[str, float | str | bool | None]] = Field(
        description="In the order that was asked for; with `columns` facts of their jobs by their names."
    )
    total: int | None = Field(
        description="Audits that match in all; null with `where` or `after`, unless `count=exact`."
    )
    limit: int = Field(description="Items on a page at most.")
    offset: int = Field(description="Items left out before this page.")
    next: str | None = Field(
        description="Path and query of the next page, also in the header Link; null on the last one."
    )
