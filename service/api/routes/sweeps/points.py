"""GET /v1/sweeps/{id}/points: the computed points, as a page of JSON or a stream."""

import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice
from typing import Annotated

import orjson
from fastapi import APIRouter, Depends, Request, Response

from service.api.dependencies import Inside
from service.api.formats.metadata import about_points
from service.api.formats.negotiation import CSV, JSON, NPZ, PARQUET, Accept, chosen, named_file
from service.api.formats.points import STREAMS, rows
from service.api.middleware.heavy_answers import heavy
from service.api.middleware.methods import is_head
from service.api.queries.cursors import cursor_of
from service.api.queries.lists import link_to, next_page
from service.api.queries.points import (
    DEFAULT_ROWS,
    MOST_NUMBERS,
    MOST_ROWS,
    MOST_SORTED_NUMBERS,
    PointsQuery,
    Wish,
    read_wish,
)
from service.api.queries.queries import Asked, asked_of, query_parameters, refuse_if_any
from service.api.replies.errors import invalid_request
from service.api.replies.pieces import PiecedAnswer
from service.api.replies.places import SweepId
from service.api.replies.responses import refusals
from service.api.tagged import told_of
from service.jobs.records import SweepRecord
from service.schemas.reading.documents import Fault
from service.schemas.replies.sweep import PointPageOut
from service.schemas.sweep.sweep import trusted_sweep
from service.storage.sweeps.point_query import PointQuery
from service.storage.sweeps.point_reader import PointBlock, PointReader
from service.storage.sweeps.standing import standing_in

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
    told = told_of(request, inside, standing_in(record)) | named_file(f"points-{record.id}", media_type)
    if is_page:
        return _page(request, asked.parameters, record, wish, reader, told)
    _check_size_of_sort(wish, reader)
    held = reader.held(wish.query)
    if media_type == NPZ:
        # The arrays, and the file with them.
        held = 2 * 8 * len(wish.columns) * _checked_size_of_arrays(wish, reader)
    told |= {POINTS_HEADER: str(record.points), DONE_HEADER: str(record.done)}
    if is_head(request):
        return Response(media_type=media_type, headers=told)
    # Read the first block now, while an error can still be answered with a status.
    blocks = reader.blocks(wish.query)
    first = list(islice(blocks, 1))
    about = {"sweep": record.id, **{name: told[name] for name in (POINTS_HEADER, DONE_HEADER)}}
    if media_type == PARQUET:
        about = about_points(record, wish.columns, wish.series)
    content = STREAMS[media_type](wish, chain(first, blocks), about)
    return PiecedAnswer(content, held=held, media_type=media_type, headers=told)


def _page(
    request: Request,
    asked: PointsQuery,
    record: SweepRecord,
    wish: Wish,
    reader: PointReader,
    headers: Mapping[str, str],
) -> Response:
    limit = _page_rows(wish.query.limit, reader)
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


def _page_rows(asked: int | None, reader: PointReader) -> int:
    return min(_most_rows(reader), DEFAULT_ROWS) if asked is None else asked


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
