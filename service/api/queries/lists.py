"""Reads what a list is asked for: conditions, order, columns, and which page; or its facets and statistics.

A cursor is the place of a row in an order, opaque to clients. It holds the values that the order compares,
and a digest of the query it belongs to, so that it cannot be used with other conditions by mistake.
"""

import base64
import binascii
import hashlib
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Literal, Protocol, TypeVar
from urllib.parse import urlencode

from fastapi import Request, Response
from pydantic import Field

from service.api.queries.queries import FORMAT_HELP, Asked, ListFormatName, QueryModel, refuse_if_any
from service.api.replies import json_response
from service.jobs.records import JobState
from service.schemas.query.reading import read_columns, read_names, read_order, read_where
from service.schemas.query.terms import (
    ID,
    Condition,
    Excerpt,
    Fact,
    Kind,
    ListQuery,
    OrderKey,
    Subject,
    Value,
    Vocabulary,
    split,
)
from service.schemas.reading.documents import Fault, instant_text
from service.schemas.replies.sweep import QueryEstimateOut, SlowPart
from service.storage.database.database import SEARCH_SECONDS
from service.storage.database.rows import is_id
from service.storage.searching.narrowing import slow_parts
from service.storage.searching.sources import Source


class Ordered(Protocol):
    """A query whose rows have places."""

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The conditions that choose the rows."""
        ...

    @property
    def keys(self) -> tuple[OrderKey, ...]:
        """The order; its last column is different for each row."""
        ...


class InvalidCursorError(Exception):
    """A text that is no cursor of this query."""

    def __init__(self) -> None:
        super().__init__(
            "not a cursor of this list with these conditions and this order; accepted is the one in `next` of"
            " the page before"
        )


def cursor_of(name: str, query: Ordered, place: Sequence[Value | None]) -> str:
    """Return the cursor of a row in the list ``name``; ``place`` has the values of the order's columns."""
    content = json.dumps([_digest(name, query), *place], separators=(",", ":"), allow_nan=False)
    return base64.urlsafe_b64encode(content.encode()).decode().rstrip("=")


def place_of(name: str, query: Ordered, cursor: str) -> tuple[Value | None, ...]:
    """Return the place that a cursor tells; raises :class:`InvalidCursorError`."""
    try:
        content = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    except (ValueError, binascii.Error, RecursionError):
        raise InvalidCursorError from None
    keys = query.keys
    if not isinstance(content, list) or len(content) != 1 + len(keys) or content[0] != _digest(name, query):
        raise InvalidCursorError
    kinds = [key.subject.kind for key in keys]
    if (
        not all(_fits(kind, value) for kind, value in zip(kinds, content[1:], strict=True))
        or content[-1] is None
    ):
        raise InvalidCursorError
    return tuple(content[1:])


def _digest(name: str, query: Ordered) -> str:
    said = repr((name, query.conditions, query.keys))
    return hashlib.sha256(said.encode("utf-8", "backslashreplace")).hexdigest()[:12]


def _fits(kind: Kind, value: object) -> bool:
    """Tell whether a database can compare a column with a value."""
    if value is None:
        return True
    match kind:
        case Kind.NUMBER | Kind.INSTANT:
            return isinstance(value, int | float) and not isinstance(value, bool) and _is_double(value)
        case Kind.TRUTH:
            return isinstance(value, bool)
        case Kind.IDENTIFIER:
            return isinstance(value, str) and is_id(value)
    # Any text that a database stores.
    return isinstance(value, str) and not re.search(r"[\x00\ud800-\udfff]", value)


def _is_double(value: float) -> bool:
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


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


MOST_NAMES = 8
MOST_BINS = 200


class FacetsQuery(QueryModel):
    """The conditions and facts of a request for counts of values."""

    where: list[str] = Field(default_factory=list, description=WHERE)
    by: str | None = Field(
        default=None, description="Facts such as `family,tier`, or pointers; each is counted by itself."
    )
    limit: int = Field(default=50, ge=1, le=1000, description="Values of each at most, the most frequent.")
    estimate: bool = Field(default=False, description=ESTIMATE)


class StatisticsQuery(QueryModel):
    """The conditions, numbers and groups of a request for statistics."""

    where: list[str] = Field(default_factory=list, description=WHERE)
    of: str | None = Field(default=None, description="Numbers such as `period,/motion/lambda`.")
    by: str | None = Field(
        default=None, description="A fact or pointer whose values divide them into groups."
    )
    bins: int = Field(default=0, ge=0, le=MOST_BINS, description="Bins of a histogram; none if left out.")
    limit: int = Field(default=20, ge=1, le=200, description="Groups at most, the largest.")
    estimate: bool = Field(default=False, description=ESTIMATE)


@dataclass(frozen=True, slots=True)
class Analysis:
    """The conditions, subjects and groups of a request for facets or statistics."""

    conditions: tuple[Condition, ...]
    of: tuple[Subject, ...]
    by: tuple[Subject, ...]


def read_facets(asked: Asked[FacetsQuery], vocabulary: Vocabulary) -> Analysis:
    """Return what is counted; raises the refusal with every fault."""
    faults = list(asked.faults)
    conditions, of_where = read_where(asked.parameters.where, vocabulary)
    by, of_by = _names("by", asked.parameters.by, _groupable(vocabulary))
    if asked.parameters.by is None:
        faults.append(Fault("?by", "missing_parameter", f"by is missing; {vocabulary.accepted()}"))
    refuse_if_any([*faults, *of_where, *of_by])
    return Analysis(conditions, (), by)


def read_statistics(asked: Asked[StatisticsQuery], vocabulary: Vocabulary) -> Analysis:
    """Return what is summed up; raises the refusal with every fault."""
    faults = list(asked.faults)
    conditions, of_where = read_where(asked.parameters.where, vocabulary)
    numbers = replace(_only(vocabulary, lambda fact: fact.kind is Kind.NUMBER), has_labels=False)
    of, of_of = _names("of", asked.parameters.of, numbers)
    by, of_by = _names("by", asked.parameters.by, _groupable(vocabulary))
    if asked.parameters.of is None:
        faults.append(Fault("?of", "missing_parameter", f"of is missing; {numbers.accepted()}"))
    if len(by) > 1:
        faults.append(Fault("?by", "too_many_columns", f"{len(by)} facts; one is accepted"))
    refuse_if_any([*faults, *of_where, *of_of, *of_by])
    return Analysis(conditions, of, by)


def _groupable(vocabulary: Vocabulary) -> Vocabulary:
    """Return what rows can have in common: not ids and instants."""
    return _only(vocabulary, lambda fact: fact.kind not in (Kind.IDENTIFIER, Kind.INSTANT))


def _only(vocabulary: Vocabulary, accept: Callable[[Fact], bool]) -> Vocabulary:
    facts = {name: fact for name, fact in vocabulary.facts.items() if accept(fact)}
    return replace(vocabulary, facts=facts)


def _names(
    parameter: str, text: str | None, vocabulary: Vocabulary
) -> tuple[tuple[Subject, ...], list[Fault]]:
    if text is None:
        return (), []
    parts = list(split(Excerpt(text, 0)))
    if len(parts) > MOST_NAMES:
        message = f"{len(parts)} names; at most {MOST_NAMES} are accepted"
        return (), [Fault(f"?{parameter}", "too_many_columns", message)]
    return read_names(parameter, parts, vocabulary)
