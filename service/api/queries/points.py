"""Reads a query for points of a sweep: ``?where=period<5&order=-energy&columns=index,period``."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import Field
from pydantic_core import PydanticCustomError

from service.api.queries.format_names import FORMAT_HELP, FormatName
from service.api.queries.queries import Asked, QueryModel
from service.schemas.reading.faults import Fault
from service.schemas.reading.numbers import read_exact
from service.schemas.sweep.sweep import Sweep
from service.storage.sweeps.point_query import INDEX, OUTCOME, Condition, Operator, PointQuery

DEFAULT_ROWS, MOST_ROWS = 100, 10_000
"""Points on a page of JSON by default."""
MOST_NUMBERS = 2_000_000
"""Numbers on a page of JSON at most, samples of series included."""
MOST_SORTED_NUMBERS = 40_000_000
"""Numbers of sorted points with series: for every 64 MB of them all chunks are read again."""

_CONDITION = re.compile(r"\s*([^<>=!]+?)\s*(<=|>=|<|>|=)\s*([^<>=]+?)\s*\Z")
_OPERATORS: dict[str, Operator] = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "=": "="}


class PointsQuery(QueryModel):
    """Which points, which of their columns, and in which order."""

    where: list[str] = Field(
        default_factory=list,
        description="Conditions such as `period<5`, `/motion/lambda>=0.5` and `outcome=solved`, with commas"
        " between or repeated: all must hold. A point without the number meets none.",
    )
    order: str | None = Field(
        default=None,
        description="A column to sort by, with - in front the largest first; by index if left out. Points"
        " without the number come last.",
    )
    columns: str | None = Field(default=None, description="Names with commas between, such as index,period.")
    limit: int | None = Field(
        default=None,
        ge=1,
        description=f"Points at most. Of a page of JSON {DEFAULT_ROWS} if left out, {MOST_ROWS} at most.",
    )
    offset: int = Field(default=0, ge=0, description="Points to leave out first.")
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


def read_wish(asked: Asked[PointsQuery], sweep: Sweep, *, has_lists: bool) -> Wish:
    """Read the query for ``sweep``; ``has_lists`` tells whether the format can hold series."""
    query, faults = asked.parameters, list(asked.faults)
    numbers = (INDEX, *sweep.pointers, *sweep.keep)
    columns = (*numbers, OUTCOME, *(sweep.series_columns if has_lists else ()))
    if query.columns is not None:
        accepted, wanted = columns, [name.strip() for name in query.columns.split(",")]
        faults += [_unknown("?columns", name, accepted) for name in wanted if name not in accepted]
        if len(set(wanted)) < len(wanted):
            faults.append(Fault("?columns", "invalid_value", "a column is given twice; once is accepted"))
        columns = tuple(name for name in wanted if name in accepted)
    texts = [text for given in query.where for text in given.split(",")]
    conditions, outcomes = _read_conditions(texts, numbers, faults)
    order = None if query.order is None else query.order.removeprefix("-")
    if order is not None and order not in numbers:
        faults.append(_unknown("?order", order, numbers))
    return Wish(
        PointQuery(
            conditions=tuple(conditions),
            outcomes=tuple(outcomes),
            order=order,
            descending=(query.order or "").startswith("-"),
            limit=query.limit,
            offset=query.offset,
        ),
        columns,
        tuple(name for name in columns if name in sweep.series_columns),
        tuple(faults),
    )


def _read_conditions(
    texts: Sequence[str], numbers: Sequence[str], faults: list[Fault]
) -> tuple[list[Condition], list[str]]:
    """Return the conditions on numbers and the outcomes asked for; add what is wrong with them."""
    conditions, outcomes = list[Condition](), list[str]()
    for text in texts:
        match = _CONDITION.match(text)
        if match is None:
            message = f"{text[:60]!r} is not a condition; accepted is, for example, period<5"
            faults.append(Fault("?where", "invalid_condition", message))
            continue
        column, sign, value = match.groups()
        if column == OUTCOME and sign == "=":
            outcomes.append(value)
        elif column == OUTCOME:
            message = f"{text[:60]!r}: outcomes have no order; accepted is =, as in outcome=solved"
            faults.append(Fault("?where", "invalid_condition", message))
        elif column not in numbers:
            faults.append(_unknown("?where", column, (*numbers, OUTCOME)))
        else:
            try:
                conditions.append(Condition(column, _OPERATORS[sign], float(read_exact(value))))
            except PydanticCustomError as fault:
                message = f"{text[:60]!r}: {fault.message()}"
                faults.append(Fault("?where", "invalid_number", message))
    return conditions, outcomes


def _unknown(pointer: str, name: str, accepted: Sequence[str]) -> Fault:
    message = f"there is no column {name[:60]!r} here; accepted are {', '.join(accepted)}"
    return Fault(pointer, "unknown_column", message)
