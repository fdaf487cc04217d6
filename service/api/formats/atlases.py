"""Writes atlases as JSON, CSV, Arrow or a picture (SVG), chosen by the Accept header."""

from collections.abc import Callable, Mapping

from fastapi import Response

from service.api.formats.columns import ColumnKind
from service.api.formats.negotiation import preferred
from service.api.replies.responses import json_response
from service.csv_text import CRLF, csv_blocks
from service.schemas.atlas.replies import AtlasOut
from service.schemas.atlas.showing import INTEGERS, NUMBERS, atlas_columns, picture_of
from service.schemas.reading.documents import Document

Writer = Callable[[AtlasOut], Response]


def choose_format(accept: str | None) -> Writer:
    """Return the writer of the format that the client prefers; JSON without a header.

    Raises
    ------
    ApiError
        406 if it accepts none of ours.
    """
    write = FORMATS[preferred(list(FORMATS), accept)]

    def respond(atlas: AtlasOut) -> Response:
        response = write(atlas)
        response.headers["Vary"] = "Accept"
        return response

    return respond


def media_types() -> Document:
    """Return the formats other than JSON, for the OpenAPI document."""
    binary = {"schema": {"type": "string", "format": "binary"}}
    return {name: binary for name in FORMATS if name != "application/json"}


def _csv(atlas: AtlasOut) -> Response:
    columns = atlas_columns(atlas)
    return Response(b"".join(csv_blocks(columns, [columns.values()], CRLF)), media_type="text/csv")


def _arrow(atlas: AtlasOut) -> Response:
    from service.api.formats.arrow import arrow_batches  # noqa: PLC0415

    columns = atlas_columns(atlas)
    kinds: dict[str, ColumnKind] = {
        name: "integer" if name in INTEGERS else "number" if name in NUMBERS else "word" for name in columns
    }
    changes = [change.model_dump_json(by_alias=True) for change in atlas.changes]
    metadata = {"changes": f"[{','.join(changes)}]", "verdict": atlas.verdict}
    content = b"".join(arrow_batches(kinds, [columns], metadata))
    return Response(content, media_type="application/vnd.apache.arrow.stream")


def _svg(atlas: AtlasOut) -> Response:
    return Response(picture_of(atlas), media_type="image/svg+xml")


FORMATS: Mapping[str, Writer] = {
    "application/json": json_response,
    "text/csv": _csv,
    "application/vnd.apache.arrow.stream": _arrow,
    "image/svg+xml": _svg,
}
"""The writer of each media type."""
