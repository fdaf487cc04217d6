"""Reads what a list is asked for: conditions, order, columns, and which page."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Literal, TypeVar
from urllib.parse import urlencode

from fastapi import Request, Response
from pydantic import Field

from service.api.queries.cursors import InvalidCursorError, cursor_of, place_of
from service.api.queries.queries import FORMAT_HELP, Asked, ListFormatName, QueryModel, refuse_if_any
from service.api.replies.responses import json_response
from service.jobs.records import JobState
from service.schemas.query.conditions import ID, Condition, Kind, ListQuery, OrderKey, Subject, Value
from service.schemas.query.reading import read_columns, read_order, read_where
from service.schemas.reading.documents import Fault, instant_text
from service.schemas.replies.analysis import QueryEstimateOut, SlowPart
from service.storage.database.database import SEARCH_SECONDS
from service.storage.searching.narrowing import slow_parts
from service.storage.searching.sources import Source

NEWEST_FIRST = (OrderKey(ID, descending=True),)

WHERE = (
    "Conditions such as `period<5`, `/motion/lambda>=1`, `tier in (draft,high)` and `created_at>=2026-01-01`,"
    " with commas between or repeated: all must hold. See docs/queries.md."
)


ESTIMATE = (
    'Nothing is read: the answer is `{"slow": [{"pointer", "why"}], "seconds"}`, what of the query takes long'
    " over many rows, and after how many seconds it is stopped."
)

COUNTED_AT_ONCE = 10_000
"""Rows that are counted in some milliseconds."""
MOST_ITEMS = 200
"""Items on a page of JSON."""
FARTHEST = 10**9
"""Rows that a request may leave out, or ask for, at most: more than any list has."""


class AskingQuery(QueryModel):
    """The parameters that every list accepts."""

    where: list[str] = Field(default_factory=list, description=WHERE)
    order: str | None = Field(
        default=None,
        description="Columns to sort by, such as `-energy,created_at`; with - in front the largest first."
        " The id is the last one. Rows without a value come last.",
    )
    columns: str | None = Field(
        default=None,
        description="Items hold these facts only, such as `id,period,/motion/lambda`; null where none is.",
    )
    limit: int = Field(
        default=50,
        ge=1,
        le=FARTHEST,
        description=f"Items on a page of JSON, {MOST_ITEMS} at most; rows of other formats, all if left out.",
    )
    offset: int = Field(default=0, ge=0, le=FARTHEST, description="Items to leave out first.")
    after: str | None = Field(
        default=None,
        max_length=4000,
        description="The cursor of a page, from `next` of the page before, for the same query.",
    )
    count: Literal["exact"] | None = Field(
        default=None,
        description="`exact`: with `total`, also where it takes time: with `where` or `after`, or of over"
        f" {COUNTED_AT_ONCE:,} rows, it is null if this is left out.",
    )
    estimate: bool = Field(default=False, description=ESTIMATE)
    format: ListFormatName | None = Field(default=None, description=FORMAT_HELP)


AnyAsking = TypeVar("AnyAsking", bound=AskingQuery)


class PageQuery(AskingQuery):
    """A list of what has a state."""

    state: JobState | None = None


@dataclass(frozen=True, slots=True)
class Listing:
    """A list and what it is asked for."""

    source: Source
    query: ListQuery
    format: ListFormatName | None = None
    most: int | None = None
    """Rows of a stream at most."""

    def next_page(self, request: Request, place: Sequence[Value | None] | None) -> str | None:
        """Return the query of the page that begins after ``place``, None if there is none."""
        if place is None:
            return None
        return next_page(request, cursor_of(self.source.name, self.query, place))

    def estimate(self) -> Response:
        """Return what of it takes long, as an answer."""
        query = self.query
        return estimate_of(slow_parts(self.source, query.conditions, query.keys))

    def rows(self, values: Sequence[Sequence[Value | None]]) -> list[dict[str, Value | None]]:
        """Return the items that hold the wanted columns only."""
        columns = self.query.columns
        return [
            {column.text: _shown(column.kind, value) for column, value in zip(columns, row, strict=True)}
            for row in values
        ]


def next_page(request: Request, cursor: str) -> str:
    """Return the query of the same request after a cursor, which holds behind any proxy."""
    kept = [(k, v) for k, v in request.query_params.multi_items() if k not in ("after", "offset")]
    return f"?{urlencode([*kept, ('after', cursor)])}"


def link_to(next_page: str | None) -> dict[str, str]:
    """Return the header that leads to the next page (RFC 8288)."""
    return {} if next_page is None else {"Link": f'<{next_page}>; rel="next"'}


def estimate_of(found: Iterable[tuple[str, str]]) -> Response:
    """Return what of a query takes long, as an answer."""
    slow = [SlowPart(pointer=pointer, why=why) for pointer, why in found]
    return json_response(QueryEstimateOut(slow=slow, seconds=SEARCH_SECONDS))


def read_listing(
    asked: Asked[AnyAsking],
    source: Source,
    *,
    conditions: Sequence[Condition] = (),
    order: tuple[OrderKey, ...] = NEWEST_FIRST,
) -> Listing:
    """Return what is asked for, beside ``conditions`` and in ``order`` if none is given.

    Raises
    ------
    ApiError
        With every fault of the query.
    """
    given, faults = asked.parameters, list(asked.faults)
    found, of_where = read_where(given.where, source.vocabulary)
    faults += of_where
    if given.order is not None:
        order, of_order = read_order(given.order, source.vocabulary)
        faults += of_order
    columns: tuple[Subject, ...] = ()
    if given.columns is not None:
        columns, of_columns = read_columns(given.columns, source.vocabulary)
        faults += of_columns
    faults += _conflicts(asked)
    refuse_if_any(faults)
    query = ListQuery(
        (*conditions, *found),
        order,
        columns,
        given.limit,
        given.offset,
        is_counted=given.count == "exact" or not (given.where or given.after),
        count_limit=None if given.count == "exact" else COUNTED_AT_ONCE,
        is_estimated=given.estimate,
    )
    listing = Listing(source, query, given.format, given.limit if "limit" in asked.sent else None)
    if given.after is None:
        return listing
    try:
        after = place_of(source.name, query, given.after)
    except InvalidCursorError as error:
        refuse_if_any([Fault("?after", "invalid_cursor", str(error))])
        raise
    return replace(listing, query=replace(query, after=after))


def _conflicts(asked: Asked[AnyAsking]) -> Iterator[Fault]:
    if asked.parameters.after is not None and asked.parameters.offset:
        yield Fault("?offset", "conflicting_parameters", "after and offset; one of the two is accepted")


def _shown(kind: Kind, value: Value | None) -> Value | None:
    if kind is Kind.INSTANT and isinstance(value, float):
        return instant_text(datetime.fromtimestamp(value, UTC))
    return value
