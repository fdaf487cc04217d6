"""GET /v1/families: the catalogue of potential families and named cases."""

from fastapi import APIRouter, Response

from service.api.queries.queries import without_query
from service.api.replies.responses import json_response, refusals
from service.catalogue.cases import cases
from service.catalogue.classical import classical
from service.catalogue.families import families
from service.schemas.replies.installation import FamiliesOut

router = APIRouter(prefix="/v1/families", tags=["families"])


@router.get("", response_model=FamiliesOut, responses=refusals(), dependencies=[without_query])
def list_families() -> Response:
    """List families, named and classical cases: conditions, parameters, sources, example problems."""
    return json_response(FamiliesOut(items=families(), cases=cases(), classical=classical()))
