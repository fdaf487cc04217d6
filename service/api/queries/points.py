"""Reads queries for points of a sweep: ``?where=period<5&order=-energy&columns=index,period``.

A matrix of them is asked for by ``?of=period&at=/motion/lambda=3``.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from pydantic import Field

from service.api.queries.lists import FARTHEST, InvalidCursorError, place_of
from service.api.queries.queries import FORMAT_HELP, Asked, FormatName, QueryModel, refuse_if_any
from service.schemas.query.reading import read_columns, read_order, read_where
from service.schemas.query.terms import Fact, Kind, OrderKey, Vocabulary
from service.schemas.reading.documents import Fault
from service.schemas.sweep.sweep import Sweep
from service.storage.sweeps.point_reader import INDEX, OUTCOME, PointQuery

DEFAULT_ROWS, MOST_ROWS = 100, 10_000
"""Points on a page of JSON by default."""
MOST_NUMBERS = 2_000_000
"""Numbers on a page of JSON at most, samples of series included."""
MOST_SORTED_NUMBERS = 40_000_000
"""Numbers of sorted points with series: for every 64 MB of them all chunks are read again."""


class PointsQuery(QueryModel):
    """The points to return, their columns and their order."""

    where: list[str] = Field(
        default_factory=list,
        description="Conditions such as `period<5`, `/motion/lambda>=0.5`, `trace is null`, `outcome=solved`,"
        " with commas between or repeated: all must hold. A point without the number meets `is null` only.",
    )
    order: str | None = Field(
        default=None,
        description="Columns to sort by, with - in front the largest first; by index if left out. Points"
        " without the number come last.",
    )
    columns: str | None = Field(default=None, description="Names with commas between, such as index,period.")
    limit: int | None = Field(
        default=None,
        ge=1,
        le=FARTHEST,
        description=f"Points at most. Of a page of JSON {DEFAULT_ROWS} if left out, {MOST_ROWS} at most.",
    )
    offset: int = Field(default=0, ge=0, le=FARTHEST, description="Points to leave out first.")
    after: str | None = Field(
        default=None,
        max_length=4000,
        description="The cursor of a page, from `next` of the page before, for the same query.",
    )
    count: Literal["exact"] | None = Field(
        default=None,
        description="`exact`: with `total` after a cursor too, which is null if this is left out.",
    )
    format: FormatName | None = Field(default=None, description=FORMAT_HELP)


@dataclass(frozen=True, slots=True)
class Wish:
    """The parsed query, and its faults."""

    query: PointQuery
    columns: tuple[str, ...]
    series: tuple[str, ...]
    """The columns among them that are functions of time."""
    faults: tuple[Fault, ...]
    """Everything that is wrong with the query."""


def read_wish(asked: Asked[PointsQuery], sweep_id: str, sweep: Sweep, *, has_lists: bool) -> Wish:
    """Read the query for ``sweep``; ``has_lists`` tells whether the format can hold series."""
    query, faults = asked.parameters, list(asked.faults)
    vocabulary = vocabulary_of(sweep)
    numbers = {name: fact for name, fact in vocabulary.facts.items() if name != OUTCOME}
    columns = (*vocabulary.facts, *(sweep.series_columns if has_lists else ()))
    if query.columns is not None:
        named = Vocabulary({name: Fact(Kind.NUMBER, name) for name in columns})
        subjects, of_columns = read_columns(query.columns, named)
        columns = tuple(subject.name for subject in subjects)
        faults += of_columns
    conditions, of_where = read_where(query.where, vocabulary) if query.where else ((), [])
    faults += of_where
    order: tuple[OrderKey, ...] = ()
    if query.order is not None:
        order, of_order = read_order(query.order, Vocabulary(numbers))
        faults += of_order
    if query.after is not None and query.offset:
        faults.append(
            Fault("?offset", "conflicting_parameters", "after and offset; one of the two is accepted")
        )
    found = PointQuery(conditions, order, query.limit, query.offset)
    if query.after is not None and not (of_where or faults):
        try:
            place = place_of(sweep_id, found, query.after)
            found = replace(found, after=tuple(None if each is None else float(each) for each in place))
        except InvalidCursorError as error:
            faults.append(Fault("?after", "invalid_cursor", str(error)))
    series = tuple(name for name in columns if name in sweep.series_columns)
    return Wish(found, columns, series, tuple(faults))


def vocabulary_of(sweep: Sweep) -> Vocabulary:
    """Return what the points of a sweep can be asked for: index, axes, kept numbers, outcome."""
    numbers = {name: Fact(Kind.NUMBER, name) for name in (INDEX, *sweep.pointers, *sweep.keep)}
    return Vocabulary({**numbers, OUTCOME: Fact(Kind.TEXT, "solved, or the reason why not")})


MOST_CELLS = 1_000_000
"""Cells of a matrix, which is made at once."""
MOST_AXES = 2
_NUMBER = re.compile(r"[0-9]{1,18}")


class GridQuery(QueryModel):
    """The number to show, and its position on the axes that are neither rows nor columns."""

    of: str | None = Field(default=None, description="One of the kept numbers, such as `period`.")
    at: list[str] = Field(
        default_factory=list,
        description="Of a sweep of more than two axes the place, from 0, on each of the others, such as"
        " `/motion/lambda=3`; repeated, or with commas between.",
    )
    format: Literal["json", "arrow", "npz"] | None = Field(default=None, description=FORMAT_HELP)


@dataclass(frozen=True, slots=True)
class GridWish:
    """The matrix that is asked for."""

    of: str
    at: Mapping[int, int]
    """Places on axes, by the places of these among all axes."""


def read_grid_wish(asked: Asked[GridQuery], sweep: Sweep) -> GridWish:
    """Return what is asked for; raises the refusal with every fault."""
    of, faults = asked.parameters.of, list(asked.faults)
    accepted = f"accepted are {', '.join(sweep.keep)}"
    if of is None:
        faults.append(Fault("?of", "missing_parameter", f"of is missing; {accepted}"))
    elif of not in sweep.keep:
        faults.append(Fault("?of", "unknown_column", f"{of[:60]!r} is not kept by this sweep; {accepted}"))
    if sweep.combine != "grid":
        message = "this sweep combines its axes by zip, which is no matrix; its points are a list of rows"
        refuse_if_any([*faults, Fault("", "not_a_grid", message)])
    at, of_at = _places([part.strip() for text in asked.parameters.at for part in text.split(",")], sweep)
    faults += of_at
    free = [each for place, each in enumerate(sweep.axes) if place not in at]
    if not of_at and not 1 <= len(free) <= MOST_AXES:
        example = f"at={sweep.pointers[0]}=0"
        message = (
            f"a matrix has 1 or 2 axes, here {len(free)}; accepted is a place on each other axis: {example}"
        )
        faults.append(Fault("?at", "missing_parameter" if free else "out_of_range", message))
    elif not of_at and (cells := math.prod(each.axis.length for each in free)) > MOST_CELLS:
        message = f"{cells} cells; at most {MOST_CELLS} are accepted. Choose a place on one of the axes"
        faults.append(Fault("?at", "out_of_range", message))
    refuse_if_any(faults)
    assert of is not None
    return GridWish(of, at)


def _places(parts: Sequence[str], sweep: Sweep) -> tuple[dict[int, int], list[Fault]]:
    found, faults = dict[int, int](), list[Fault]()
    named = Vocabulary({name: Fact(Kind.NUMBER, name) for name in sweep.pointers})
    for part in parts:
        pointer, _, text = part.rpartition("=")
        meant = named.pointers_of(pointer)
        if pointer not in sweep.pointers and len(meant) == 1:
            (pointer,) = meant
        elif len(meant) > 1:
            message = f"{pointer!r} may be {' or '.join(meant)}; one of these is accepted"
            faults.append(Fault("?at", "ambiguous_name", message))
            continue
        if pointer not in sweep.pointers:
            accepted = ", ".join(f"{name}=0" for name in sweep.pointers)
            message = f"{part[:60]!r} is no place on an axis; accepted are such as {accepted}"
            faults.append(Fault("?at", "unknown_column", message))
            continue
        axis = sweep.pointers.index(pointer)
        length = sweep.axes[axis].axis.length
        if not _NUMBER.fullmatch(text) or int(text) >= length:
            message = f"{text[:20]!r} is no place on {pointer}; accepted are 0 to {length - 1}"
            faults.append(Fault("?at", "out_of_range", message))
        elif axis in found:
            faults.append(Fault("?at", "invalid_value", f"{pointer} is given twice; once is accepted"))
        else:
            found[axis] = int(text)
    return found, faults
