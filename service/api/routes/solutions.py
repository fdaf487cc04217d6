"""/v1/solutions: search, list and show solutions, without arrays."""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Path, Request, Response
from pydantic import Field

from service.api.dependencies import Inside, Resources
from service.api.formats.lists import ListedRows, list_responses
from service.api.middleware.heavy_answers import listed, read_list
from service.api.queries.lists import AskingQuery, Listing
from service.api.queries.queries import Asked, Number, asked_of, query_parameters, without_query
from service.api.replies import JSON, SolutionId, json_content, refusals, solution_out
from service.api.tagged import validator_headers
from service.dynamics.numerics import SolvedBy
from service.dynamics.problem import Tier
from service.schemas.query.terms import OF_SOLUTIONS, Condition, FamilyName, Kind, OrderKey, Subject, equals
from service.schemas.reading.documents import Fault
from service.schemas.replies.solution import SolutionOut, SolutionPageOut
from service.schemas.replies.sweep import QueryEstimateOut
from service.storage.database.rows import is_id
from service.storage.searching.sources import OF_SOLUTION_ROWS
from service.storage.solutions.solution_store import SolutionPage, standing_and_annotation

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])
by_problem = APIRouter(prefix="/v1/problems", tags=["solutions"])

_DIGEST = re.compile(r"[0-9a-f]{64}\Z")

Sort = Literal[
    "created_at", "A", "C", "period", "energy", "error",
    "-created_at", "-A", "-C", "-period", "-energy", "-error",
]  # fmt: skip


class SolutionsQuery(AskingQuery):
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


@router.get(
    "",
    responses=list_responses(SolutionPageOut | QueryEstimateOut),
    openapi_extra=query_parameters(SolutionsQuery),
)
async def list_solutions(
    request: Request,
    asked: Annotated[Asked[SolutionsQuery], Depends(asked_of(SolutionsQuery))],
    inside: Inside,
) -> Response:
    """Find solutions by their numbers; those without the number they are sorted by come last."""
    listing = await _listing(inside, asked, ())
    return await listed(request, inside, listing, _listed(inside))


@by_problem.get(
    "/{digest}/solutions",
    responses=list_responses(SolutionPageOut | QueryEstimateOut),
    openapi_extra=query_parameters(SolutionsQuery),
)
async def list_problem_solutions(
    digest: Annotated[str, Path(description="Of the problem, the fact `digest` of its jobs and solutions.")],
    request: Request,
    asked: Annotated[Asked[SolutionsQuery], Depends(asked_of(SolutionsQuery))],
    inside: Inside,
) -> Response:
    """Find the solutions of one problem, as in the list of all; a digest that nobody has, has none."""
    problem = Subject("fact", "digest", Kind.TEXT)
    values = (digest,) if _DIGEST.match(digest) else ()
    listing = await _listing(inside, asked, (Condition(problem, "in", values),))
    return await listed(request, inside, listing, _listed(inside))


async def _listing(
    inside: Resources, asked: Asked[SolutionsQuery], conditions: tuple[Condition, ...]
) -> Listing:
    given = asked.parameters
    if {"sort", "order"} <= asked.sent:
        both = Fault("?sort", "conflicting_parameters", "sort and order; one of the two is accepted")
        asked = replace(asked, faults=(*asked.faults, both))
    return await read_list(
        inside,
        asked,
        OF_SOLUTION_ROWS,
        conditions=(*conditions, *_filters(given)),
        order=(_order(given.sort),),
    )


def _listed(inside: Resources) -> ListedRows[SolutionPage]:
    return ListedRows(
        SolutionPageOut, inside.solutions.find, lambda page: list(map(solution_out, page.solutions))
    )


@router.get(
    "/{solution_id}", response_model=SolutionOut, responses=refusals(404), dependencies=[without_query]
)
def get_solution(request: Request, solution_id: SolutionId, inside: Inside) -> Response:
    """Show a solution without its arrays."""
    standing, annotation = inside.reads.get(standing_and_annotation, solution_id)
    headers = validator_headers(request, inside, (standing, annotation))

    def content() -> bytes:
        # With the annotation that are in the tag: they may have changed since.
        solution = replace(inside.solutions.get(solution_id), annotation=annotation)
        return json_content(solution_out(solution))

    return Response(inside.answers.get_or_make(headers["ETag"], content), media_type=JSON, headers=headers)


def _filters(query: SolutionsQuery) -> Iterator[Condition]:
    """Yield what the parameters with a name of their own ask for."""
    if query.job is not None:
        job = Subject("fact", "job", Kind.IDENTIFIER)
        # What is no id is the id of no job.
        yield Condition(job, "in", (query.job,) if is_id(query.job) else ())
    for name, word in (("family", query.family), ("method", query.method), ("tier", query.tier)):
        yield from equals(name, Kind.WORD, word)
    given = query.model_dump()
    for name in ("A", "C", "period", "energy", "error"):
        number = Subject("fact", name, Kind.NUMBER)
        if (least := given[f"{name}_min"]) is not None:
            yield Condition(number, ">=", (least,))
        if (largest := given[f"{name}_max"]) is not None:
            yield Condition(number, "<=", (largest,))


def _order(sort: Sort) -> OrderKey:
    name = sort.removeprefix("-")
    return OrderKey(Subject("fact", name, OF_SOLUTIONS[name].kind), sort.startswith("-"))
