"""GET /v1/solutions/{id}/enclosures: the proven samples of the certified tier."""

from collections.abc import Mapping
from http import HTTPStatus

import numpy as np
from fastapi import APIRouter, Request, Response
from numpy.typing import NDArray

from service.api.dependencies import Inside
from service.api.middleware.heavy_answers import heavy
from service.api.queries.queries import without_query
from service.api.replies.errors import ApiError
from service.api.replies.responses import SolutionId, json_response, refusals
from service.api.tagged import validator_headers
from service.dynamics.equations.orientation import PRECESSION, QUATERNION
from service.dynamics.motion import COLUMNS
from service.dynamics.solution.dense_output import MAX_PARTS, RADIUS, as_decimals, join
from service.schemas.problem.trusted import ONE_AT_A_TIME
from service.schemas.replies.solution import EnclosureOut, EnclosuresOut
from service.storage.codecs.packing import decode_arrays

FloatArray = NDArray[np.float64]

router = APIRouter(prefix="/v1/solutions", tags=["solutions"])


@router.get(
    "/{solution_id}/enclosures",
    response_model=EnclosuresOut,
    responses=refusals(404),
    dependencies=[without_query],
)
@heavy
def get_enclosures(request: Request, solution_id: SolutionId, inside: Inside) -> Response:
    """Return the six variables at the exact times that were asked, as decimals with proven radii.

    With the output ``orientation`` of a motion that was proven by steps also the quaternion and the azimuths.
    """
    headers = validator_headers(request, inside)
    stored = decode_arrays(inside.solutions.samples(solution_id))
    names = [name for name in (*COLUMNS, *QUATERNION, *PRECESSION) if f"{name}.{RADIUS}" in stored]
    if not names:
        raise ApiError(
            HTTPStatus.NOT_FOUND, "no_enclosures", "only solutions of the tier certified have enclosures"
        )
    with ONE_AT_A_TIME:
        columns = {name: _enclosures(stored, name) for name in names}
        times = _enclosures(stored, "t")
    document = EnclosuresOut(t=stored["t"].tolist(), times=times, columns=columns)
    return json_response(document, headers=headers)


def _enclosures(stored: Mapping[str, FloatArray], name: str) -> list[EnclosureOut]:
    further = sorted(set(stored) & {f"{name}.{part}" for part in range(1, MAX_PARTS)})
    rows = zip(*(stored[part].tolist() for part in (name, *further)), strict=True)
    # Times stored without radii are exact doubles.
    radii = stored.get(f"{name}.{RADIUS}", np.zeros(len(stored[name]))).tolist()
    pairs = (as_decimals(join(row, radius)) for row, radius in zip(rows, radii, strict=True))
    return [EnclosureOut(value=value, radius=radius) for value, radius in pairs]
