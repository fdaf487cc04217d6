"""GET /v1/accuracy: the measured errors and times of the tiers on this installation."""

from typing import Annotated

from fastapi import APIRouter, Depends, Response
from pydantic import Field

from service.api.dependencies import Inside
from service.api.queries.queries import QueryModel, query_of, query_parameters
from service.api.replies.responses import json_response, refusals
from service.dynamics.accuracy import MotionKind
from service.dynamics.problem import Tier
from service.schemas.replies.installation import AccuracyOut, AccuracyRowOut, UnavailableOut
from service.storage.solutions.accuracy_store import AccuracyStore
from service.storage.solutions.shipped_accuracy import shipped_comparison, shipped_costs

router = APIRouter(prefix="/v1/accuracy", tags=["accuracy"])


class AccuracyQuery(QueryModel):
    """The conditions on rows of the table."""

    tier: Tier | None = Field(default=None, description="Only rows of this tier.")
    kind: MotionKind | None = Field(
        default=None, description="Only this kind of motion: of a periodic planar one its ends."
    )

    def admits(self, row: AccuracyRowOut | UnavailableOut) -> bool:
        """Tell whether a row matches the query."""
        return self.tier in (None, row.tier) and self.kind in (None, row.kind)


@router.get(
    "", response_model=AccuracyOut, responses=refusals(), openapi_extra=query_parameters(AccuracyQuery)
)
def get_accuracy(
    query: Annotated[AccuracyQuery, Depends(query_of(AccuracyQuery))], inside: Inside
) -> Response:
    """Show the table of the latest `polhode calibrate`, or the shipped one if it was never run.

    Always shipped are `costs`: what a job, a request, a list and a sweep cost at each tier; and
    `comparison`: what other methods take and reach, and what each output adds.
    """
    current = AccuracyStore(inside.database).current()
    answer = AccuracyOut.beside(current, shipped_costs(), shipped_comparison())
    chosen = {
        "rows": [row for row in answer.rows if query.admits(row)],
        "unavailable": [row for row in answer.unavailable if query.admits(row)],
    }
    return json_response(answer.model_copy(update=chosen))
