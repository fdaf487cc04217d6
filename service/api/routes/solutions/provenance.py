"""GET /v1/solutions/{id}/provenance: all that is known of how a solution was made."""

from fastapi import APIRouter, Request, Response

from service.api.dependencies import Inside
from service.api.formats.negotiation import JSON, Accept, preferred
from service.api.formats.prov_json import provenance_graph
from service.api.queries.queries import without_query
from service.api.replies.responses import SolutionId, json_response, refusals
from service.api.tagged import validator_headers
from service.schemas.replies.solution import ProvenanceGraphOut
from service.storage.solutions.origin import origin_of

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])


@router.get(
    "/{solution_id}/provenance",
    response_model=ProvenanceGraphOut,
    responses=refusals(404, 406),
    dependencies=[without_query],
)
def get_provenance(
    request: Request, solution_id: SolutionId, inside: Inside, accept: Accept = None
) -> Response:
    """Tell how a solution was made, as PROV-JSON of the W3C.

    Entities are the problem with its document, the kept result of its examination, and
    the solution; activities are the examination and each attempt; agents are the
    workers, polhode and the libraries with their versions.
    """
    preferred([JSON], accept)
    headers = validator_headers(request, inside)
    document = provenance_graph(origin_of(inside.database, solution_id))
    return json_response(document, headers=headers)
