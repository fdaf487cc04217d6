"""GET /metrics, for a Prometheus server."""

from fastapi import APIRouter, Response

from service.api.exposition import TEXT_FORMAT
from service.api.queries import without_query
from service.api.resources import Inside
from service.api.responses import refusals

router = APIRouter(tags=["health"])


@router.get(
    "/metrics",
    response_class=Response,
    responses={200: {"description": "Prometheus text format.", "content": {"text/plain": {}}}, **refusals()},
    dependencies=[without_query],
)
def get_metrics(inside: Inside) -> Response:
    """Tell what is queued, running, done, and how requests went, for a Prometheus server."""
    return Response(inside.metrics.text(), media_type=TEXT_FORMAT)
