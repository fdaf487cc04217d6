"""GET /metrics: metrics in the Prometheus text format."""

from fastapi import APIRouter, Response

from service.api.dependencies import Inside
from service.api.prometheus import TEXT_FORMAT
from service.api.queries.queries import without_query
from service.api.replies.responses import refusals

router = APIRouter(tags=["health"])


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"description": "Prometheus text format.", "content": {"text/plain": {}}}, **refusals()},
    dependencies=[without_query],
)
async def get_metrics(inside: Inside) -> Response:
    """Report jobs, sweeps, workers and requests to a Prometheus server."""
    return Response(await inside.metrics_text.get(), media_type=TEXT_FORMAT)
