"""Reads sweep documents, with all faults at once."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Annotated

from pydantic import (
    AfterValidator,
    Field,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import CoreSchema

from service.dynamics.equations.orientation import PRECESSION, QUATERNION
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import Problem, TimeList
from service.schemas.problem.problem import each_once, read_problem
from service.schemas.problem.sections import ProblemIn
from service.schemas.reading.choices import WireModel
from service.schemas.reading.faults import Fault, InvalidProblemError
from service.schemas.reading.marks_in import LABELS_HELP, NOTE_HELP, Labels, Note
from service.schemas.reading.numbers import Priority, refuse
from service.schemas.reading.parts import read_parts
from service.schemas.reading.pointers import split_pointer, with_values
from service.schemas.sweep import rules
from service.schemas.sweep.axes import MODELS as AXES
from service.schemas.sweep.axes import AxisIn, AxisModel
from service.schemas.sweep.kept_numbers import DEFAULT_KEEP, NUMBERS
from service.schemas.sweep.sweep import Combine, Sweep, SweepAxis, json_number

MAX_AXES = 16


class InvalidSweepError(InvalidProblemError):
    """A document that is not a valid sweep; ``faults`` lists every fault."""


def _require_kept(name: str) -> str:
    if name not in NUMBERS:
        raise refuse("invalid_value", f"{name[:40]!r} cannot be kept; accepted are {', '.join(NUMBERS)}")
    return name


KeptName = Annotated[
    str, AfterValidator(_require_kept), WithJsonSchema({"type": "string", "enum": list(NUMBERS)})
]


class _AsProblem:
    """Describes a field as a problem in the schema; it is read by :mod:`service.schemas.problem`."""

    def __get_pydantic_json_schema__(self, _: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, object]:
        return handler(ProblemIn.__pydantic_core_schema__)


class SweepIn(WireModel):
    """One problem, some of whose numbers vary: what ``POST /v1/sweeps`` takes."""

    base: Annotated[dict[str, object], _AsProblem()] = Field(
        description="A problem; the numbers it has at the axes' pointers are replaced."
    )
    axes: Annotated[list[AxisIn], Field(min_length=1, max_length=MAX_AXES)] = Field(
        description="Which numbers vary, and what values they take."
    )
    combine: Combine = Field(
        default="grid",
        description="`grid`: every value with every other, the last axis fastest;"
        " `zip`: the n-th values of all axes with each other.",
    )
    keep: Annotated[list[KeptName], Field(max_length=len(NUMBERS))] = Field(
        default_factory=lambda: list(DEFAULT_KEEP),
        description="Numbers to keep of each point; period, energy and error if left out.",
    )
    series: bool = Field(default=False, description="Keep the samples of each point too.")
    priority: Priority = Field(
        default=0, description="Larger ones are computed first; above 0 only for keys of the role operate."
    )
    labels: Labels = Field(default_factory=dict, description=LABELS_HELP)
    note: Note | None = Field(default=None, description=NOTE_HELP)


def read_sweep(document: object, *, max_points: int | None = None) -> Sweep:
    """Return the sweep that ``document`` states; ``max_points`` is the limit of the installation.

    The base with the first value of each axis must be a valid problem; each other
    point reports its own faults.

    Raises
    ------
    InvalidSweepError
        Lists every fault.
    """
    parts, faults = read_parts(document, SweepIn, AXES)
    given = list(_readable_axes(document))
    faults += rules.length_faults(given, parts.get("combine"), max_points)
    axes, problem = _first_point(parts.get("base"), given, _pointers(document), faults)
    match (problem, parts):
        case (
            Problem(),
            {
                "base": dict(base),
                "combine": ("grid" | "zip") as combine,
                "keep": list(keep),
                "series": bool(series),
            },
        ) if axes:
            columns = _series_columns(problem) if series else ()
            samples = _samples(problem) if columns else 0
            sweep = Sweep(base, axes, combine, tuple(keep), columns, samples, problem)
            faults += rules.kept_faults(keep, problem, has_series=series)
            if series:
                faults += rules.series_faults(sweep)
            if not faults:
                return sweep
    raise InvalidSweepError(each_once(faults))


def _readable_axes(document: object) -> Iterator[tuple[int, AxisModel]]:
    """Yield the readable axes with their places."""
    for place, axis in enumerate(_listed_axes(document)):
        try:
            yield place, _axis_reader().validate_python(axis)
        except ValidationError:
            continue  # its faults are among those of the whole document


def _pointers(document: object) -> dict[int, str]:
    """Return the pointers of the axes, also of faulty ones, by their places."""
    found = enumerate(
        axis.get("pointer") if isinstance(axis, dict) else None for axis in _listed_axes(document)
    )
    return {place: pointer for place, pointer in found if isinstance(pointer, str)}


def _listed_axes(document: object) -> list[object]:
    listed = document.get("axes") if isinstance(document, dict) else None
    return listed[:MAX_AXES] if isinstance(listed, list) else []


@cache
def _axis_reader() -> TypeAdapter[AxisModel]:
    return TypeAdapter(AxisIn)


def _first_point(
    base: object, given: Sequence[tuple[int, AxisModel]], pointers: Mapping[int, str], faults: list[Fault]
) -> tuple[tuple[SweepAxis, ...], Problem | None]:
    """Return the valid axes and the first point, if it is a problem; add the faults."""
    if not isinstance(base, dict):
        return (), None
    misplaced = list(rules.pointer_faults(pointers, base))
    bad = {fault.pointer for fault in misplaced}
    axes = tuple(
        SweepAxis(axis.pointer, split_pointer(axis.pointer), axis.to_domain(place))
        for place, axis in given
        if f"/axes/{place}/pointer" not in bad
    )
    faults += [*misplaced, *rules.budget_faults(base)]
    first = with_values(base, {each.path: json_number(each.axis.value(0)) for each in axes})
    try:
        return axes, read_problem(first)
    except InvalidProblemError as error:
        faults += [replace(fault, pointer=f"/base{fault.pointer}") for fault in error.faults]
        return axes, None


def _series_columns(problem: Problem) -> tuple[str, ...]:
    """Return ``t`` and the functions of time that the outputs ask for; empty if there are none."""
    columns = [name for name in COLUMNS if ("gamma" if name.startswith("g") else "omega") in problem.outputs]
    if "orientation" in problem.outputs:
        columns += [*QUATERNION, *PRECESSION]
    return ("t", *columns) if columns else ()


def _samples(problem: Problem) -> int:
    return len(problem.time.times) if isinstance(problem.time, TimeList) else problem.time.samples
