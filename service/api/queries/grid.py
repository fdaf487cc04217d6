"""Reads which matrix of a sweep is asked for: ``?of=period&at=/motion/lambda=3``."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from service.api.queries.queries import FORMAT_HELP, Asked, QueryModel, refuse_if_any
from service.schemas.query.conditions import Kind
from service.schemas.query.facts import Fact, Vocabulary
from service.schemas.reading.documents import Fault
from service.schemas.sweep.sweep import Sweep

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
