"""GET /v1/solutions/{id}/enclosures: the proven samples of the certified tier."""

from http import HTTPStatus

from fastapi import APIRouter, Response

from service.api.errors import ApiError
from service.api.places import SolutionId
from service.api.queries import without_query
from service.api.resources import Inside
from service.api.responses import json_response, refusals
from service.dynamics.enclosure import MAX_PARTS, RADIUS, as_decimals, join
from service.dynamics.motion import COLUMNS
from service.schemas.solution import EnclosureOut, EnclosuresOut
from service.storage.solutions.codec import decode_arrays

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])


@router.get(
    "/{solution_id}/enclosures",
    response_model=EnclosuresOut,
    responses=refusals(404),
    dependencies=[without_query],
)
def get_enclosures(solution_id: SolutionId, inside: Inside) -> Response:
    """Return the six variables at the stored times as decimals with proven radii."""
    stored = decode_arrays(inside.solutions.samples(solution_id))
    names = [name for name in COLUMNS if f"{name}.{RADIUS}" in stored]
    if not names:
        raise ApiError(
            HTTPStatus.NOT_FOUND, "no_enclosures", "only solutions of the tier certified have enclosures"
        )
    columns = {}
    for name in names:
        further = sorted(set(stored) & {f"{name}.{part}" for part in range(1, MAX_PARTS)})
        rows = zip(*(stored[part].tolist() for part in (name, *further)), strict=True)
        radii = stored[f"{name}.{RADIUS}"].tolist()
        pairs = (as_decimals(join(row, radius)) for row, radius in zip(rows, radii, strict=True))
        columns[name] = [EnclosureOut(value=value, radius=radius) for value, radius in pairs]
    return json_response(EnclosuresOut(t=stored["t"].tolist(), columns=columns))
