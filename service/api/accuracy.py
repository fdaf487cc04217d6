"""GET /v1/accuracy: what the tiers reach and cost on this installation."""

from typing import Annotated

from fastapi import APIRouter, Depends, Response
from pydantic import Field

from service.api.queries import QueryModel, query_of, query_parameters
from service.api.resources import Inside
from service.api.responses import json_response, refusals
from service.dynamics.accuracy import MotionKind
from service.dynamics.problem import Tier
from service.schemas.accuracy import AccuracyOut, AccuracyRowOut, UnavailableOut
from service.storage.solutions.accuracy_store import AccuracyStore

router = APIRouter(prefix="/v1/accuracy", tags=["accuracy"])


class AccuracyQuery(QueryModel):
    """Which rows."""

    tier: Tier | None = Field(default=None, description="Only what was measured of this tier.")
    kind: MotionKind | None = Field(
        default=None, description="Only this kind of motion: of a periodic planar one its ends."
    )

    def admits(self, row: AccuracyRowOut | UnavailableOut) -> bool:
        """Tell whether a row was asked for."""
        return self.tier in (None, row.tier) and self.kind in (None, row.kind)


@router.get(
    "", response_model=AccuracyOut, responses=refusals(), openapi_extra=query_parameters(AccuracyQuery)
)
def get_accuracy(
    query: Annotated[AccuracyQuery, Depends(query_of(AccuracyQuery))], inside: Inside
) -> Response:
    """Show the table of the latest `polhode calibrate`, before the first the one that is shipped."""
    answer = AccuracyOut.of(AccuracyStore(inside.database).current())
    chosen = {
        "rows": [row for row in answer.rows if query.admits(row)],
        "unavailable": [row for row in answer.unavailable if query.admits(row)],
    }
    return json_response(answer.model_copy(update=chosen))
