"""/v1/solutions: search, list and show solutions, without arrays."""

from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field

from service.api.dependencies import Inside
from service.api.queries.queries import Number, QueryModel, query_of, query_parameters, without_query
from service.api.replies.conditional import REVALIDATE, tag_of_thing, unchanged, validators
from service.api.replies.places import SolutionId
from service.api.replies.responses import JSON, json_response, refusals
from service.dynamics.motion import SolvedBy
from service.dynamics.problem import Tier
from service.schemas.problem.potentials import FamilyName
from service.schemas.replies.solution import SolutionOut, SolutionPageOut
from service.storage.solutions.solution_store import (
    NUMBER_COLUMNS,
    SORT_COLUMNS,
    NumberColumn,
    NumberRange,
    Solution,
    SolutionQuery,
    SortColumn,
)
from service.storage.solutions.standing import SolutionStanding, standing_of

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])

Sort = Literal[
    "created_at", "A", "C", "period", "energy", "error",
    "-created_at", "-A", "-C", "-period", "-energy", "-error",
]  # fmt: skip


class SolutionsQuery(QueryModel):
    """Filters and order of the list of solutions; bounds are inclusive."""

    job: str | None = Field(default=None, description="The job that computed it.")
    family: FamilyName | None = Field(default=None, description="The potential's `type`.")
    method: SolvedBy | None = Field(default=None, description="Method that computed it.")
    tier: Tier | None = Field(default=None, description="The tier that computed it.")
    A_min: Number | None = Field(default=None, description="Smallest A.")
    A_max: Number | None = Field(default=None, description="Largest A.")
    C_min: Number | None = Field(default=None, description="Smallest C.")
    C_max: Number | None = Field(default=None, description="Largest C.")
    period_min: Number | None = Field(default=None, description="Smallest period.")
    period_max: Number | None = Field(default=None, description="Largest period.")
    energy_min: Number | None = Field(default=None, description="Smallest energy h.")
    energy_max: Number | None = Field(default=None, description="Largest energy h.")
    error_min: Number | None = Field(default=None, description="Smallest claimed error.")
    error_max: Number | None = Field(default=None, description="Largest claimed error.")
    sort: Sort = Field(default="-created_at", description="With - in front: largest first.")
    limit: int = Field(default=50, ge=1, le=200, description="Items on a page at most.")
    offset: int = Field(default=0, ge=0, le=10**9, description="Items to leave out first.")


@router.get(
    "", response_model=SolutionPageOut, responses=refusals(), openapi_extra=query_parameters(SolutionsQuery)
)
def list_solutions(
    query: Annotated[SolutionsQuery, Depends(query_of(SolutionsQuery))], inside: Inside
) -> Response:
    """Find solutions by their numbers; those without the number they are sorted by come last."""
    page = inside.solutions.find(_store_query(query))
    items = [_out(solution) for solution in page.solutions]
    return json_response(
        SolutionPageOut(items=items, total=page.total, limit=query.limit, offset=query.offset)
    )


@router.get(
    "/{solution_id}", response_model=SolutionOut, responses=refusals(404), dependencies=[without_query]
)
def get_solution(request: Request, solution_id: SolutionId, inside: Inside) -> Response:
    """Show a solution without its arrays."""
    tag = solution_tag(request, standing_of(inside.database, solution_id))
    if known := unchanged(request, tag, REVALIDATE):
        return known
    return json_response(_out(inside.solutions.get(solution_id)), headers=validators(tag, REVALIDATE))


def solution_tag(request: Request, standing: SolutionStanding, *changeable: object) -> str:
    """Return the tag of a solution's summary; ``changeable`` is the version of what can change in it."""
    return tag_of_thing(request, JSON, standing.id, standing.digest, *changeable)


def _store_query(query: SolutionsQuery) -> SolutionQuery:
    given = query.model_dump()
    intervals: dict[NumberColumn, NumberRange] = {}
    for name in NUMBER_COLUMNS:
        interval = NumberRange(given[f"{name}_min"], given[f"{name}_max"])
        if interval != NumberRange():
            intervals[name] = interval
    return SolutionQuery(
        job_id=query.job,
        family=query.family,
        method=query.method,
        tier=query.tier,
        intervals=intervals,
        sort=_column(query.sort),
        descending=query.sort.startswith("-"),
        limit=query.limit,
        offset=query.offset,
    )


def _column(sort: Sort) -> SortColumn:
    return next(name for name in SORT_COLUMNS if name == sort.removeprefix("-"))


_ADDED_LATER: Mapping[str, object] = {"asymptotes": None, "precession": None, "warnings": []}
"""Fields that solutions stored by the first version lack."""


def _out(solution: Solution) -> SolutionOut:
    document = {
        **_ADDED_LATER,
        **solution.summary,
        "id": solution.id,
        "job": solution.job_id,
        "problem": solution.problem,
        "created_at": solution.created_at,
    }
    return SolutionOut.model_validate(document)
