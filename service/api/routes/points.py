"""GET /v1/sweeps/{id}/points, /grid, /package: computed points as a page, stream, matrix or ZIP."""

import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from http import HTTPStatus
from itertools import chain, islice
from typing import Annotated

import numpy as np
import orjson
from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Inside
from service.api.formats.columns import about_points, coded, errors_of_points, npz_file, provenance_of_points
from service.api.formats.negotiation import (
    ARROW,
    CSV,
    JSON,
    MEDIA_TYPES,
    NPZ,
    PARQUET,
    Accept,
    chosen,
    named_file,
    preferred,
)
from service.api.formats.points import STREAMS, ZIP, Package, kinds_of, package, parquet, rows
from service.api.middleware.caching import is_head
from service.api.middleware.heavy_answers import heavy
from service.api.queries.lists import cursor_of, link_to, next_page
from service.api.queries.points import (
    DEFAULT_ROWS,
    MOST_NUMBERS,
    MOST_ROWS,
    MOST_SORTED_NUMBERS,
    GridQuery,
    GridWish,
    PointsQuery,
    Wish,
    read_grid_wish,
    read_wish,
)
from service.api.queries.queries import Asked, asked_of, query_parameters, refuse_if_any, without_query
from service.api.replies import ApiError, PiecedAnswer, SweepId, invalid_request, refusals
from service.api.tagged import validator_headers
from service.jobs.records import SweepRecord
from service.schemas.reading.documents import Document, Fault
from service.schemas.replies.sweep import GridOut, PointPageOut
from service.schemas.sweep.sweep import Sweep, SweepAxis, trusted_sweep
from service.storage.sweeps.point_reader import PointBlock, PointQuery, PointReader
from service.storage.sweeps.point_tables import PointGrid, cell_indices, read_grid
from service.storage.sweeps.sweep_store import standing_in

router = APIRouter(prefix="/v1/sweeps", tags=["sweeps"])

MOST_ARRAY_NUMBERS = 10_000_000
"""Numbers in an answer of arrays: 80 MB, and as much again while it is written."""
POINTS_HEADER, DONE_HEADER = "Polhode-Points", "Polhode-Points-Done"
"""Headers with the number of points of the sweep, and of those computed; only these are in the answer."""


@router.get(
    "/{sweep_id}/points",
    response_model=PointPageOut,
    responses={
        200: {
            "model": PointPageOut,
            "description": "The points that are done, as a page of JSON. All other formats have all of"
            f" them, or `limit`, and the headers {POINTS_HEADER} and {DONE_HEADER}; CSV has no series.",
            "content": {name: {"schema": {"type": "string", "format": "binary"}} for name in STREAMS},
        },
        **refusals(404, 406),
    },
    openapi_extra=query_parameters(PointsQuery),
)
@heavy
def get_points(
    request: Request,
    sweep_id: SweepId,
    asked: Annotated[Asked[PointsQuery], Depends(asked_of(PointsQuery))],
    inside: Inside,
    accept: Accept = None,
) -> Response:
    """Return the computed points, filtered, sorted, and with only the requested columns."""
    media_type = chosen(asked.parameters.format, accept)
    record = inside.sweeps.get(sweep_id)
    sweep = trusted_sweep(record.document)
    wish = read_wish(asked, record.id, sweep, has_lists=media_type != CSV)
    reader = PointReader(inside.sweeps, record.id, sweep, with_series=bool(wish.series))
    is_page = media_type == JSON
    refuse_if_any([*wish.faults, *(_faults_of_page(wish.query.limit, reader) if is_page else ())])
    headers = validator_headers(request, inside, standing_in(record)) | named_file(
        f"points-{record.id}", media_type
    )
    if is_page:
        return _page(request, asked.parameters, record, wish, reader, headers)
    _check_size_of_sort(wish, reader)
    held = reader.held(wish.query)
    if media_type == NPZ:
        # The arrays, and the file with them.
        held = 2 * 8 * len(wish.columns) * _checked_size_of_arrays(wish, reader)
    headers |= {POINTS_HEADER: str(record.points), DONE_HEADER: str(record.done)}
    if is_head(request):
        return Response(media_type=media_type, headers=headers)
    # Read the first block now, while an error can still be answered with a status.
    blocks = reader.blocks(wish.query)
    first = list(islice(blocks, 1))
    about = {"sweep": record.id, **{name: headers[name] for name in (POINTS_HEADER, DONE_HEADER)}}
    if media_type == PARQUET:
        about = about_points(record, wish.columns, wish.series)
    content = STREAMS[media_type](wish, chain(first, blocks), about)
    return PiecedAnswer(content, held=held, media_type=media_type, headers=headers)


def _page(
    request: Request,
    asked: PointsQuery,
    record: SweepRecord,
    wish: Wish,
    reader: PointReader,
    headers: Mapping[str, str],
) -> Response:
    limit = wish.query.limit or min(_most_rows(reader), DEFAULT_ROWS)
    # One more than the page has tells whether there is another one.
    query = replace(wish.query, limit=limit + 1)
    blocks = list(reader.blocks(query))
    items = [row for block in blocks for row in rows(wish, block)][:limit]
    following = None
    if sum(len(block.indices) for block in blocks) > limit:
        following = next_page(request, cursor_of(record.id, query, _place(query, blocks, limit - 1)))
    # Not by json_response, which refuses NaN: missing numbers are NaN here and must become null.
    content = orjson.dumps(
        {
            "items": items,
            "total": reader.count(query) if query.after is None or asked.count else None,
            "limit": limit,
            "offset": query.offset,
            "next": following,
            "points": record.points,
            "done": record.done,
        },
        option=orjson.OPT_SERIALIZE_NUMPY,
    )
    return Response(content, media_type=JSON, headers={**headers, **link_to(following)})


def _place(query: PointQuery, blocks: Sequence[PointBlock], row: int) -> list[float | None]:
    """Return the numbers of the order's columns at a row of the blocks."""
    for block in blocks:
        if row < len(block.indices):
            numbers = [float(block.column(key.subject.name)[row]) for key in query.keys]
            return [number if math.isfinite(number) else None for number in numbers]
        row -= len(block.indices)
    raise IndexError(row)


def _most_rows(reader: PointReader) -> int:
    return max(1, min(MOST_ROWS, MOST_NUMBERS // reader.row_numbers))


def _faults_of_page(asked: int | None, reader: PointReader) -> Iterator[Fault]:
    most = _most_rows(reader)
    if asked is not None and asked > most:
        message = f"{asked} points on a page; 1 to {most} are accepted. NDJSON and Arrow have no limit"
        yield Fault("?limit", "out_of_range", message)


def _checked_size_of_arrays(wish: Wish, reader: PointReader) -> int:
    """Return how many points there are.

    Arrays that would take much memory are refused: unlike the other formats they are made at once.
    """
    points = min(reader.count(wish.query), wish.query.limit or sys.maxsize)
    if points * reader.row_numbers > MOST_ARRAY_NUMBERS:
        most = MOST_ARRAY_NUMBERS // reader.row_numbers
        message = f"{points} points as npz; at most {most} are accepted. Arrow and Parquet have no limit"
        raise invalid_request([Fault("?limit", "out_of_range", message)])
    return points


def _check_size_of_sort(wish: Wish, reader: PointReader) -> None:
    """Refuse to sort long series: every chunk would be read again and again."""
    if wish.query.is_by_index or not wish.series:
        return
    points = reader.count(wish.query)
    numbers = min(points, wish.query.limit or points) * reader.row_numbers
    if numbers > MOST_SORTED_NUMBERS:
        message = (
            f"{numbers} numbers would be sorted with their series; at most {MOST_SORTED_NUMBERS} are accepted"
            ", since all are read again for each 64 MB. Set a limit, or leave the series out of columns"
        )
        raise invalid_request([Fault("?order", "sort_too_large", message)])


@router.get(
    "/{sweep_id}/grid",
    response_model=GridOut,
    responses={
        200: {
            "model": GridOut,
            "description": "The matrix. As an Arrow stream it has for each row the number of its axis, and"
            " the lists of the columns and `outcome`; the rest is JSON in the metadata `polhode.grid`. As NPZ"
            " it has the matrix by the name of its number, the values of the axes by their pointers without"
            " the first stroke, `outcome` as indices into the list `outcomes`, -1 where a point is not"
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

    Of a sweep with more axes `at` chooses an index on each of the others.
    """
    name = asked.parameters.format
    media_type = preferred(list(_WRITERS), accept) if name is None else MEDIA_TYPES[name]
    record = inside.sweeps.get(sweep_id)
    sweep = trusted_sweep(record.document)
    wish = read_grid_wish(asked, sweep)
    reader = PointReader(inside.sweeps, record.id, sweep, with_series=False)
    grid = read_grid(reader, cell_indices(sweep, wish.at), wish.of)
    headers = validator_headers(request, inside, standing_in(record)) | named_file(
        f"grid-{record.id}", media_type
    )
    return Response(_WRITERS[media_type](sweep, wish, grid), media_type=media_type, headers=headers)


def _about(sweep: Sweep, wish: GridWish, grid: PointGrid) -> Document:
    """Return everything but the cells."""
    free = [axis for k, axis in enumerate(sweep.axes) if k not in wish.at]
    chosen = [(sweep.axes[k], index) for k, index in sorted(wish.at.items())]
    first, rows, columns = int(grid.indices[0, 0]), grid.indices[:2, 0], grid.indices[0, :2]
    return {
        "of": wish.of,
        "axes": [{"pointer": each.pointer, "values": _doubles(each)} for each in free],
        "at": [
            {"pointer": each.pointer, "index": index, "value": float(each.axis.value(index))}
            for each, index in chosen
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
    *rows, _ = [axis for k, axis in enumerate(sweep.axes) if k not in wish.at]
    values = {each.pointer: np.array(_doubles(each)) for each in rows}
    return matrix_stream(
        values, {wish.of: grid.numbers}, {"outcome": grid.outcomes}, {"polhode.grid": json.dumps(about)}
    )


def _npz(sweep: Sweep, wish: GridWish, grid: PointGrid) -> bytes:
    codes, words = coded(grid.outcomes)
    free = [axis for k, axis in enumerate(sweep.axes) if k not in wish.at]
    values = {each.pointer: np.array(_doubles(each)) for each in free}
    indices = np.array(_about(sweep, wish, grid)["indices"], dtype=np.int64)
    return npz_file(
        {wish.of: grid.numbers, "outcome": codes, "outcomes": words, "indices": indices, **values}
    )


_WRITERS = {JSON: _json, ARROW: _arrow, NPZ: _npz}


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
    headers = validator_headers(request, inside, standing_in(record))
    headers["Content-Disposition"] = f'attachment; filename="sweep-{record.id}.zip"'
    if is_head(request):
        return Response(media_type=ZIP, headers=headers)
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
    return PiecedAnswer(package(about, points), held=reader.held(wish.query), media_type=ZIP, headers=headers)
