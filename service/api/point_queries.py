"""Which points of a sweep a client asks for: ``?where=period<5&order=-energy&columns=index,period``."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict, Field

from service.api.errors import invalid_request
from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import exact_number
from service.schemas.faults import Fault
from service.schemas.sweep import Sweep
from service.storage.sweeps.point_query import INDEX, OUTCOME, Condition, Operator, PointQuery

DEFAULT_ROWS, MOST_ROWS = 100, 10_000
"""Of a page of JSON."""
MOST_NUMBERS = 2_000_000
"""Of a page of JSON, the samples of series among them."""
MOST_SORTED_NUMBERS = 40_000_000
"""Of sorted points: their rows are gathered 64 MB at a time, and every chunk is read each time."""

_CONDITION = re.compile(r"\s*([^<>=!]+?)\s*(<=|>=|<|>|=)\s*([^<>=]+?)\s*\Z")
_OPERATORS: dict[str, Operator] = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "=": "="}


class PointsQuery(BaseModel):
    """Which points, which of their columns, and in which order."""

    model_config = ConfigDict(extra="forbid")

    where: list[str] = Field(
        default_factory=list,
        description="Conditions such as `period<5`, `/motion/lambda>=0.5` and `outcome=solved`, with commas"
        " between or repeated: all must hold. A point that has no such number meets none.",
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


@dataclass(frozen=True, slots=True)
class Wish:
    """What a client asks for, checked."""

    query: PointQuery
    columns: tuple[str, ...]
    series: tuple[str, ...]
    """Those of the columns that are functions of time."""


def read_query(query: PointsQuery, sweep: Sweep, *, has_lists: bool) -> Wish:
    """Return what is asked for of ``sweep``; ``has_lists`` tells whether the format can hold series.

    Raises
    ------
    ApiError
        422 with every fault of the query.
    """
    faults: list[Fault] = []
    numbers = (INDEX, *sweep.pointers, *sweep.keep)
    columns = (*numbers, OUTCOME, *(sweep.series_columns if has_lists else ()))
    if query.columns is not None:
        accepted, columns = columns, tuple(name.strip() for name in query.columns.split(","))
        faults += [_unknown("?columns", name, accepted) for name in columns if name not in accepted]
        if len(set(columns)) < len(columns):
            faults.append(Fault("?columns", "invalid_value", "a column is there twice; once is accepted"))
    texts = [text for given in query.where for text in given.split(",")]
    conditions, outcomes = _read_conditions(texts, numbers, faults)
    order = None if query.order is None else query.order.removeprefix("-")
    if order is not None and order not in numbers:
        faults.append(_unknown("?order", order, numbers))
    if faults:
        raise invalid_request(faults)
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
    )


def _read_conditions(
    texts: Sequence[str], numbers: Sequence[str], faults: list[Fault]
) -> tuple[list[Condition], list[str]]:
    """Return the conditions on numbers and the outcomes asked for; add what is wrong with them."""
    conditions, outcomes = list[Condition](), list[str]()
    for text in texts:
        match = _CONDITION.match(text)
        if match is None:
            message = f"{text[:60]!r} is no condition; accepted are such as period<5 with < <= > >= ="
            faults.append(Fault("?where", "invalid_condition", message))
            continue
        column, sign, value = match.groups()
        if column == OUTCOME and sign == "=":
            outcomes.append(value)
        elif column == OUTCOME:
            message = f"{text[:60]!r}: outcomes have no order; accepted is outcome=solved"
            faults.append(Fault("?where", "invalid_condition", message))
        elif column not in numbers:
            faults.append(_unknown("?where", column, (*numbers, OUTCOME)))
        else:
            try:
                conditions.append(Condition(column, _OPERATORS[sign], float(exact_number(value))))
            except (InvalidNumberError, OverflowError):
                message = f"{value[:40]!r} is not a number; accepted are 1.5, 1e-12 and 17/10"
                faults.append(Fault("?where", "invalid_number", message))
    return conditions, outcomes


def _unknown(pointer: str, name: str, accepted: Sequence[str]) -> Fault:
    message = f"there is no column {name[:60]!r} here; accepted are {', '.join(accepted)}"
    return Fault(pointer, "unknown_column", message)
