"""GET /v1/sweeps/{id}/grid: a kept number of the points as a matrix."""

import json
from typing import Annotated

import numpy as np
import orjson
from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Inside
from service.api.formats.negotiation import ARROW, JSON, MEDIA_TYPES, NPZ, Accept, named_file, preferred
from service.api.formats.npz import coded, npz_file
from service.api.middleware.heavy_answers import heavy
from service.api.queries.grid import GridQuery, GridWish, read_grid_wish
from service.api.queries.queries import Asked, asked_of, query_parameters
from service.api.replies.places import SweepId
from service.api.replies.responses import refusals
from service.api.tagged import told_of
from service.schemas.replies.sweep import GridOut
from service.schemas.sweep.sweep import Sweep, SweepAxis, trusted_sweep
from service.storage.sweeps.point_grid import PointGrid, cell_indices, read_grid
from service.storage.sweeps.point_reader import PointReader
from service.storage.sweeps.standing import standing_in

router = APIRouter(prefix="/v1/sweeps", tags=["sweeps"])


@router.get(
    "/{sweep_id}/grid",
    response_model=GridOut,
    responses={
        200: {
            "model": GridOut,
            "description": "The matrix. As an Arrow stream it has for each row the number of its axis, and"
            " the lists of the columns and `outcome`; the rest is JSON in the metadata `polhode.grid`. As NPZ"
            " it has the matrix by the name of its number, the values of the axes by their pointers without"
            " the first stroke, `outcome` as places in the list `outcomes`, -1 where a point is not"
            " computed yet, and `indices`.",
            "content": {kind: {"schema": {"type": "string", "format": "binary"}} for kind in (ARROW, NPZ)},
        },
        **refusals(404, 406),
    },
    openapi_extra=query_parameters(GridQuery, "of"),
)
@heavy
def get_grid(
    request: Request,
    sweep_id: SweepId,
    asked: Annotated[Asked[GridQuery], Depends(asked_of(GridQuery))],
    inside: Inside,
    accept: Accept = None,
) -> Response:
    """Return a kept number over one or two axes of a grid: rows along the first, columns along the last.

    Of a sweep with more axes `at` chooses a place on each of the others.
    """
    name = asked.parameters.format
    media_type = preferred(list(_WRITERS), accept) if name is None else MEDIA_TYPES[name]
    record = inside.sweeps.get(sweep_id)
    sweep = trusted_sweep(record.document)
    wish = read_grid_wish(asked, sweep)
    reader = PointReader(inside.sweeps, record.id, sweep, with_series=False)
    grid = read_grid(reader, cell_indices(sweep, wish.at), wish.of)
    headers = told_of(request, inside, standing_in(record)) | named_file(f"grid-{record.id}", media_type)
    return Response(_WRITERS[media_type](sweep, wish, grid), media_type=media_type, headers=headers)


def _about(sweep: Sweep, wish: GridWish, grid: PointGrid) -> dict[str, object]:
    """Return everything but the cells."""
    free = [each for place, each in enumerate(sweep.axes) if place not in wish.at]
    places = [(sweep.axes[place], index) for place, index in sorted(wish.at.items())]
    first, rows, columns = int(grid.indices[0, 0]), grid.indices[:2, 0], grid.indices[0, :2]
    return {
        "of": wish.of,
        "axes": [{"pointer": each.pointer, "values": _doubles(each)} for each in free],
        "at": [
            {"pointer": each.pointer, "index": index, "value": float(each.axis.value(index))}
            for each, index in places
        ],
        "indices": [first, int(rows[-1]) - first, int(columns[-1]) - first],
        "points": grid.indices.size,
        "done": int(np.count_nonzero(grid.outcomes != None)),  # noqa: E711  (of each cell)
    }


def _doubles(each: SweepAxis) -> list[float]:
    return [float(value) for value in each.axis.doubles(0, each.axis.length)]


def _json(sweep: Sweep, wish: GridWish, grid: PointGrid) -> bytes:
    # Not by json_response, which refuses NaN: missing numbers are NaN here and must become null.
    about = _about(sweep, wish, grid)
    return orjson.dumps(
        {**about, "rows": grid.numbers, "outcomes": grid.outcomes.tolist()}, option=orjson.OPT_SERIALIZE_NUMPY
    )


def _arrow(sweep: Sweep, wish: GridWish, grid: PointGrid) -> bytes:
    from service.api.formats.arrow import matrix_stream  # noqa: PLC0415

    about = _about(sweep, wish, grid)
    *rows, _ = [each for place, each in enumerate(sweep.axes) if place not in wish.at]
    values = {each.pointer: np.array(_doubles(each)) for each in rows}
    return matrix_stream(
        values, {wish.of: grid.numbers}, {"outcome": grid.outcomes}, {"polhode.grid": json.dumps(about)}
    )


def _npz(sweep: Sweep, wish: GridWish, grid: PointGrid) -> bytes:
    codes, words = coded(grid.outcomes)
    free = [each for place, each in enumerate(sweep.axes) if place not in wish.at]
    values = {each.pointer: np.array(_doubles(each)) for each in free}
    indices = np.array(_about(sweep, wish, grid)["indices"], dtype=np.int64)
    return npz_file(
        {wish.of: grid.numbers, "outcome": codes, "outcomes": words, "indices": indices, **values}
    )


_WRITERS = {JSON: _json, ARROW: _arrow, NPZ: _npz}
