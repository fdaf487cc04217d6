"""GET /v1/solutions/{id}/citation: how a solution is cited."""

from collections.abc import Callable, Mapping
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Request, Response
from pydantic import Field

from service.api.dependencies import Inside
from service.api.formats.citation import CITATIONS, Cited, bibtex, cff, title_of
from service.api.formats.negotiation import Accept, preferred
from service.api.queries.queries import FORMAT_HELP, QueryModel, query_of, query_parameters
from service.api.replies.responses import SolutionId, refusals
from service.api.tagged import validator_headers
from service.storage.solutions.solution_store import standing_of

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])

WRITERS: Mapping[str, Callable[[Cited], str]] = {CITATIONS["bibtex"]: bibtex, CITATIONS["cff"]: cff}


class CitationQuery(QueryModel):
    """The format of a citation."""

    format: Literal["bibtex", "cff"] | None = Field(default=None, description=FORMAT_HELP)


@router.get(
    "/{solution_id}/citation",
    response_class=Response,
    responses={
        200: {
            "description": "BibTeX, or a citation file (CFF 1.2.0).",
            "content": {media_type: {"schema": {"type": "string"}} for media_type in WRITERS},
        },
        **refusals(404, 406),
    },
    openapi_extra=query_parameters(CitationQuery),
)
def get_citation(
    request: Request,
    solution_id: SolutionId,
    query: Annotated[CitationQuery, Depends(query_of(CitationQuery))],
    inside: Inside,
    accept: Accept = None,
) -> Response:
    """Return how to cite a solution in a paper: what it is, what computed it, whose method it is."""
    media_type = preferred(list(WRITERS), accept) if query.format is None else CITATIONS[query.format]
    standing = inside.reads.get(standing_of, solution_id)
    headers = validator_headers(request, inside, standing)
    solution = inside.solutions.get(solution_id)
    provenance = solution.summary["provenance"]
    cited = Cited(
        solution.id,
        standing.digest,
        title_of(solution.problem),
        solution.created_at.date(),
        provenance["version"],
        provenance["numerics"],
    )
    return Response(WRITERS[media_type](cited), media_type=media_type, headers=headers)
