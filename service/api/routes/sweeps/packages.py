"""GET /v1/sweeps/{id}/package: a finished sweep as one file to publish."""

from http import HTTPStatus

from fastapi import APIRouter, Request, Response

from service.api.dependencies import Inside
from service.api.formats.metadata import about_points, errors_of_points, provenance_of_points
from service.api.formats.packages import ZIP, Package, package
from service.api.formats.points import kinds_of, parquet
from service.api.middleware.heavy_answers import heavy
from service.api.middleware.methods import is_head
from service.api.queries.points import PointsQuery, read_wish
from service.api.queries.queries import Asked, without_query
from service.api.replies.errors import ApiError
from service.api.replies.pieces import PiecedAnswer
from service.api.replies.places import SweepId
from service.api.replies.responses import refusals
from service.api.tagged import told_of
from service.schemas.sweep.sweep import trusted_sweep
from service.storage.sweeps.point_reader import PointReader
from service.storage.sweeps.standing import standing_in

router = APIRouter(prefix="/v1/sweeps", tags=["sweeps"])


@router.get(
    "/{sweep_id}/package",
    response_class=Response,
    responses={
        200: {
            "description": "A ZIP of `datapackage.json` (Frictionless), `sweep.json` and `points.parquet`.",
            "content": {ZIP: {"schema": {"type": "string", "format": "binary"}}},
        },
        **refusals(404, 409),
    },
    dependencies=[without_query],
)
@heavy
def get_package(request: Request, sweep_id: SweepId, inside: Inside) -> Response:
    """Return a finished sweep as a data package: its document, all its points, units, errors, checksums."""
    record = inside.sweeps.get(sweep_id)
    if record.finished_at is None:
        detail = f"sweep {record.id} is {record.state}: only what has finished is a package; wait for its end"
        raise ApiError(HTTPStatus.CONFLICT, "not_finished", detail)
    told = told_of(request, inside, standing_in(record))
    told["Content-Disposition"] = f'attachment; filename="sweep-{record.id}.zip"'
    if is_head(request):
        return Response(media_type=ZIP, headers=told)
    sweep = trusted_sweep(record.document)
    wish = read_wish(Asked(PointsQuery(), frozenset(), ()), record.id, sweep, has_lists=True)
    reader = PointReader(inside.sweeps, record.id, sweep, with_series=bool(wish.series))
    about = Package(
        record.id,
        record.document,
        record.finished_at,
        kinds_of(wish),
        errors_of_points(wish.columns, wish.series),
        provenance_of_points(record),
    )
    points = parquet(wish, reader.blocks(wish.query), about_points(record, wish.columns, wish.series))
    return PiecedAnswer(package(about, points), held=reader.held(wish.query), media_type=ZIP, headers=told)
