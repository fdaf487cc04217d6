"""GET /v1/families: the potentials that have a name."""

from fastapi import APIRouter, Response

from service.api.catalogue.cases import cases
from service.api.catalogue.families import families
from service.api.queries import without_query
from service.api.responses import json_response, refusals
from service.schemas.catalogue import FamiliesOut

router = APIRouter(prefix="/v1/families", tags=["families"])


@router.get("", response_model=FamiliesOut, responses=refusals(), dependencies=[without_query])
def list_families() -> Response:
    """List the families and the named cases: conditions, parameters, sources, example problems."""
    return json_response(FamiliesOut(items=families(), cases=cases()))
