"""Writes lists as CSV, NDJSON, Arrow or Parquet: all rows that match, read a page at a time; and atlases.

An atlas is one document: its formats are JSON, CSV, Arrow and a picture (SVG).
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import chain, islice
from typing import Any, Generic, Protocol, TypeVar  # Any: the OpenAPI description of answers

import numpy as np
from fastapi import Request, Response
from numpy.typing import NDArray

from service.api.formats.columns import ColumnKind
from service.api.formats.negotiation import (
    ARROW,
    CSV,
    JSON,
    MEDIA_TYPES,
    NDJSON,
    PARQUET,
    named_file,
    preferred,
)
from service.api.queries.lists import MOST_ITEMS, Listing, link_to
from service.api.queries.queries import ListFormatName, refuse_if_any
from service.api.replies import PiecedAnswer, json_content, json_response, refusals
from service.csv_text import CRLF, csv_blocks
from service.schemas.atlas.documents import AtlasOut
from service.schemas.atlas.showing import INTEGERS, NUMBERS, atlas_columns, picture_of
from service.schemas.query.terms import Kind, ListQuery, Subject, Value
from service.schemas.reading.documents import Document, Fault, instant_text
from service.schemas.replies.response_model import ResponseModel

LISTED = (JSON, CSV, NDJSON, ARROW, PARQUET)
"""The formats of lists; JSON has pages, the others have all rows."""
_TABLE_ROWS, _WHOLE_ROWS = 1000, 200
"""Rows of a page that is read for a stream: of columns, and of whole items."""
_HELD = 4_000_000
"""Bytes of such a page, about."""
_KINDS: Mapping[Kind, ColumnKind] = {
    Kind.NUMBER: "number",
    Kind.INSTANT: "instant",
    Kind.TRUTH: "truth",
    Kind.WORD: "word",
    Kind.TEXT: "word",
    Kind.IDENTIFIER: "word",
}


class FoundRows(Protocol):
    """One page of some list, as a store has found it."""

    @property
    def total(self) -> int | None:
        """The number of all rows, if that was wanted."""

    @property
    def values(self) -> Sequence[Sequence[Value | None]]:
        """The wanted columns of each row."""

    @property
    def next(self) -> Sequence[Value | None] | None:
        """The values at which the following page begins; None if there is none."""


Found = TypeVar("Found", bound=FoundRows)


@dataclass(frozen=True, slots=True)
class ListedRows(Generic[Found]):
    """A list of a store: the source of its pages, and the way its items are shown."""

    model: type[ResponseModel]
    """A page of JSON."""
    find: Callable[[ListQuery], Found]
    shown: Callable[[Found], Sequence[ResponseModel]]

    def answer(self, request: Request, listing: Listing) -> Response:
        """Return what is asked for, in the format that is asked for.

        Raises
        ------
        ApiError
            406: there is no such format; 422: a page of JSON is too long.
        """
        media_type = media_type_of(listing.format, request.headers.get("accept"))
        if media_type == JSON:
            return self._page(request, listing)
        pages = self._pages(listing, is_whole=media_type == NDJSON and not listing.query.columns)
        # Read the first one now, while an error can still be answered with a status.
        pages = chain(list(islice(pages, 1)), pages)
        headers = named_file(listing.source.name, media_type)
        content = self._pieces(media_type, listing, pages)
        return PiecedAnswer(content, held=_HELD, media_type=media_type, headers=headers)

    def _page(self, request: Request, listing: Listing) -> Response:
        query = listing.query
        if query.limit > MOST_ITEMS:
            message = f"'{query.limit}' is not accepted; accepted is an integer from 1 to {MOST_ITEMS}"
            refuse_if_any([Fault("?limit", "out_of_range", message)])
        found = self.find(query)
        following = listing.next_page(request, found.next)
        document = {
            "items": listing.rows(found.values) if query.columns else self.shown(found),
            "total": found.total,
            "limit": query.limit,
            "offset": query.offset,
            "next": following,
        }
        return json_response(self.model.model_validate(document), headers=link_to(following))

    def _pages(self, listing: Listing, *, is_whole: bool) -> Iterator[Found]:
        columns = () if is_whole else columns_of(listing)
        most, left = _WHOLE_ROWS if is_whole else _TABLE_ROWS, listing.most
        query = replace(listing.query, columns=columns, is_counted=False)
        while left is None or left > 0:
            found = self.find(replace(query, limit=most if left is None else min(most, left)))
            yield found
            if found.next is None:
                return
            left = None if left is None else left - most
            query = replace(query, after=tuple(found.next), offset=0)

    def _pieces(self, media_type: str, listing: Listing, pages: Iterable[Found]) -> Iterator[bytes]:
        if media_type == NDJSON:
            return self._lines(listing, pages)
        kinds = {each.text: _KINDS[each.kind] for each in columns_of(listing)}
        batches = (_batch(kinds, found.values) for found in pages)
        if media_type == CSV:
            texts = ([_text(batch[name]) for name in kinds] for batch in batches)
            return csv_blocks(kinds, texts, CRLF)
        from service.api.formats.arrow import arrow_batches, parquet_groups  # noqa: PLC0415

        return (arrow_batches if media_type == ARROW else parquet_groups)(kinds, batches, {})

    def _lines(self, listing: Listing, pages: Iterable[Found]) -> Iterator[bytes]:
        for found in pages:
            if listing.query.columns:
                lines = [json.dumps(row, allow_nan=False).encode() for row in listing.rows(found.values)]
            else:
                lines = [json_content(item) for item in self.shown(found)]
            yield b"".join(line + b"\n" for line in lines)


def media_type_of(name: ListFormatName | None, accept: str | None) -> str:
    """Return the media type of a list that is asked for by name, or else by the Accept header."""
    return preferred(LISTED, accept if name is None else MEDIA_TYPES[name])


def columns_of(listing: Listing) -> tuple[Subject, ...]:
    """Return the columns of a table: those that are asked for, or all facts."""
    facts = listing.source.vocabulary.facts
    return listing.query.columns or tuple(Subject("fact", name, fact.kind) for name, fact in facts.items())


def list_responses(model: Any, *statuses: int) -> dict[int | str, dict[str, Any]]:  # noqa: ANN401 (a type)
    """Return the OpenAPI entries of a list: its formats, and its refusals."""
    content = {kind: {"schema": {"type": "string", "format": "binary"}} for kind in LISTED if kind != JSON}
    described = (
        "A page of JSON. All other formats have all rows, or `limit`: NDJSON whole items, or with `columns`"
        " these; tables the `columns`, or all facts."
    )
    return {200: {"model": model, "description": described, "content": content}, **refusals(406, *statuses)}


def _batch(
    kinds: Mapping[str, ColumnKind], values: Sequence[Sequence[Value | None]]
) -> dict[str, NDArray[np.generic]]:
    columns = list(zip(*values, strict=True)) or [()] * len(kinds)
    return {name: _column(kind, column) for (name, kind), column in zip(kinds.items(), columns, strict=True)}


def _column(kind: ColumnKind, values: Sequence[Value | None]) -> NDArray[np.generic]:
    if kind == "number":
        return np.array([np.nan if each is None else each for each in values], dtype=np.float64)
    if kind == "instant":
        # As instants are in JSON, to the last digit.
        moments = [None if each is None else datetime.fromtimestamp(float(each), UTC) for each in values]
        naive = [None if each is None else each.replace(tzinfo=None) for each in moments]
        return np.array(naive, dtype="datetime64[us]")
    column = np.empty(len(values), dtype=np.object_)
    column[:] = values
    return column


def _text(column: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return instants as text; other columns as they are."""
    if column.dtype.kind != "M":
        return column
    found = np.empty(len(column), dtype=np.object_)
    found[:] = [
        None if each is None else instant_text(each.replace(tzinfo=UTC))
        for each in column.tolist()
        if each is None or isinstance(each, datetime)
    ]
    return found


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


def _csv_of_atlas(atlas: AtlasOut) -> Response:
    columns = atlas_columns(atlas)
    return Response(b"".join(csv_blocks(columns, [columns.values()], CRLF)), media_type="text/csv")


def _arrow_of_atlas(atlas: AtlasOut) -> Response:
    from service.api.formats.arrow import arrow_batches  # noqa: PLC0415

    columns = atlas_columns(atlas)
    kinds: dict[str, ColumnKind] = {
        name: "integer" if name in INTEGERS else "number" if name in NUMBERS else "word" for name in columns
    }
    changes = [change.model_dump_json(by_alias=True) for change in atlas.changes]
    metadata = {"changes": f"[{','.join(changes)}]", "verdict": atlas.verdict}
    content = b"".join(arrow_batches(kinds, [columns], metadata))
    return Response(content, media_type="application/vnd.apache.arrow.stream")


FORMATS: Mapping[str, Writer] = {
    "application/json": json_response,
    "text/csv": _csv_of_atlas,
    "application/vnd.apache.arrow.stream": _arrow_of_atlas,
    "image/svg+xml": lambda atlas: Response(picture_of(atlas), media_type="image/svg+xml"),
}
"""The writer of each media type."""
