"""Reads sweep documents and their axes, with all faults at once, and checks the rules between their parts.

An axis says which number of the base varies, and its values.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Annotated

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    PlainValidator,
    Strict,
    Tag,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import CoreSchema

from service.dynamics.errors import InvalidNumberError
from service.dynamics.exact import exact_number
from service.dynamics.problem import Problem
from service.schemas.problem.documents import ProblemIn
from service.schemas.problem.problem import each_once, read_problem
from service.schemas.problem.sections import LABELS_HELP, NOTE_HELP, Labels, Note
from service.schemas.reading.documents import (
    Document,
    Fault,
    InvalidProblemError,
    NoSuchPlaceError,
    Part,
    split_pointer,
    value_at,
)
from service.schemas.reading.numbers import (
    Exact,
    Positive,
    Priority,
    each_of,
    integer_schema,
    read_exact,
    read_integer,
    refuse,
)
from service.schemas.reading.parts import TAG_MARK, WireModel, fields_of, read_parts, tag_by_field
from service.schemas.sweep.sweep import (
    DEFAULT_KEEP,
    NUMBERS,
    Combine,
    Sweep,
    SweepAxis,
    axis_of,
    first_point,
    sweep_axis,
    sweep_of,
)

MAX_LISTED = 100_000
LONGEST_AXIS = 100_000_000
"""Values that one axis can have; how many points a sweep may have is a setting."""
LARGEST_SEED = 2**64 - 1


def _read_length(value: object) -> int:
    number = read_integer(value)
    if not 1 <= number <= LONGEST_AXIS:
        raise refuse("out_of_range", f"{number:.6g} values; 1 to {LONGEST_AXIS} are accepted")
    return number


def _read_seed(value: object) -> int:
    number = read_integer(value)
    if not 0 <= number <= LARGEST_SEED:
        raise refuse("out_of_range", "a seed is an integer; 0 to 18446744073709551615 are accepted")
    return number


def _require_span(value: object) -> object:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise refuse("invalid_length", "a list of three is expected: [lo, hi, n], n values from lo to hi")
    return value


_LENGTH = WithJsonSchema(integer_schema("1000", minimum=1, maximum=LONGEST_AXIS))
_SEED = WithJsonSchema(integer_schema("7", minimum=0, maximum=LARGEST_SEED))
Length = Annotated[int, PlainValidator(_read_length), _LENGTH]
Seed = Annotated[int, PlainValidator(_read_seed), _SEED]
Span = Annotated[tuple[Exact, Exact, Length], Strict(False), BeforeValidator(_require_span)]
PositiveSpan = Annotated[tuple[Positive, Positive, Length], Strict(False), BeforeValidator(_require_span)]

_POINTER = "JSON pointer to a number of the base, such as /motion/lambda."


class ListedAxisIn(WireModel):
    """The values themselves."""

    pointer: str = Field(description=_POINTER, max_length=200)
    values: Annotated[
        list[Exact], Field(min_length=1, max_length=MAX_LISTED), each_of(read_exact, most=MAX_LISTED)
    ] = Field(description="Exact, in the order of the points.")


class LinearAxisIn(WireModel):
    """``n`` equidistant values from lo to hi, both included."""

    pointer: str = Field(description=_POINTER, max_length=200)
    linspace: Span = Field(description="[lo, hi, n].", examples=[[0.6, 2, 1000]])


class LogarithmicAxisIn(WireModel):
    """``n`` values with equal ratios from lo > 0 to hi > 0, both included."""

    pointer: str = Field(description=_POINTER, max_length=200)
    logspace: PositiveSpan = Field(description="[lo, hi, n].", examples=[["1e-3", 10, 100]])


class UniformAxisIn(WireModel):
    """``n`` independent random values between lo and hi; equal seeds at equal places give equal values."""

    pointer: str = Field(description=_POINTER, max_length=200)
    uniform: Span = Field(description="[lo, hi, n].", examples=[[-2, -1, 1000]])
    seed: Seed = Field(default=0, description="Of the random numbers; 0 if left out.")


AXES: Mapping[str, type[WireModel]] = {
    "values": ListedAxisIn,
    "linspace": LinearAxisIn,
    "logspace": LogarithmicAxisIn,
    "uniform": UniformAxisIn,
}
"""The axis classes by the field that holds their values."""


def _require_axis(value: object) -> object:
    if isinstance(value, tuple(AXES.values())):
        return value
    accepted = f'an axis has a "pointer" and one of {", ".join(AXES)}'
    if not isinstance(value, dict):
        raise refuse("invalid_type", f"an object is expected; {accepted}")
    given = [name for name in AXES if name in value]
    if len(given) > 1:
        raise refuse("conflicting_fields", f"{' and '.join(given)} exclude each other; {accepted}")
    if not given:
        raise refuse("missing_field", accepted)
    return value


AxisIn = Annotated[
    Annotated[ListedAxisIn, Tag(f"{TAG_MARK}values")]
    | Annotated[LinearAxisIn, Tag(f"{TAG_MARK}linspace")]
    | Annotated[LogarithmicAxisIn, Tag(f"{TAG_MARK}logspace")]
    | Annotated[UniformAxisIn, Tag(f"{TAG_MARK}uniform")],
    Discriminator(tag_by_field(tuple(AXES), "values")),
    BeforeValidator(_require_axis),
]


MAX_AXES = 16

Placed = Sequence[tuple[int, Part]]
"""The fields of the axes that could be read, each with its place in the list."""


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

    def __get_pydantic_json_schema__(self, _: CoreSchema, handler: GetJsonSchemaHandler) -> Document:
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
        json_schema_extra={"uniqueItems": True},
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
    faults += length_faults(given, parts.get("combine"), max_points)
    axes, problem = _first_point(parts.get("base"), given, _pointers(document), faults)
    keep, series = parts.get("keep"), parts.get("series")
    if problem is not None and axes and isinstance(keep, list) and "combine" in parts and "series" in parts:
        sweep = sweep_of(parts, axes, problem)
        faults += kept_faults(keep, problem, has_series=bool(series))
        if series:
            faults += series_faults(sweep)
        if not faults:
            return sweep
    raise InvalidSweepError(each_once(faults))


def _readable_axes(document: object) -> Iterator[tuple[int, Part]]:
    """Yield the fields of the readable axes with their places."""
    for place, axis in enumerate(_listed_axes(document)):
        try:
            yield place, fields_of(_axis_reader().validate_python(axis))
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
def _axis_reader() -> TypeAdapter[BaseModel]:
    return TypeAdapter(AxisIn)


def _first_point(
    base: object, given: Placed, pointers: Mapping[int, str], faults: list[Fault]
) -> tuple[tuple[SweepAxis, ...], Problem | None]:
    """Return the valid axes and the first point, if it is a problem; add the faults."""
    if not isinstance(base, dict):
        return (), None
    misplaced = list(pointer_faults(pointers, base))
    bad = {fault.pointer for fault in misplaced}
    axes = tuple(sweep_axis(axis, place) for place, axis in given if f"/axes/{place}/pointer" not in bad)
    faults += [*misplaced, *budget_faults(base)]
    try:
        return axes, read_problem(first_point(base, axes))
    except InvalidProblemError as error:
        faults += [replace(fault, pointer=f"/base{fault.pointer}") for fault in error.faults]
        return axes, None


MAX_SERIES_SAMPLES = 100_000_000
"""Samples of all points together: 0.8 GB of every column before compression."""

_SAMPLES = ("time", "samples")


def pointer_faults(pointers: Mapping[int, str], base: Mapping[str, object]) -> Iterator[Fault]:
    """Yield the faults of the axes' pointers into the base."""
    first_use: dict[str, int] = {}
    for place, pointer in pointers.items():
        where = f"/axes/{place}/pointer"
        try:
            found = value_at(base, split_pointer(pointer))
        except NoSuchPlaceError as error:
            message = f"{error}; accepted is a pointer to a number that the base has"
            yield Fault(where, "unknown_pointer", message)
            continue
        if not _is_number(found):
            message = f"the base has no number at {pointer}; accepted is a pointer to one that it has"
            yield Fault(where, "not_a_number", message)
        elif pointer in first_use:
            message = f"/axes/{first_use[pointer]} has this pointer too; each number varies along one axis"
            yield Fault(where, "pointer_taken", message)
        first_use.setdefault(pointer, place)


def length_faults(axes: Placed, combine: object, max_points: int | None) -> Iterator[Fault]:
    """Yield the faults of the numbers of values."""
    lengths = [axis_of(axis, place).length for place, axis in axes]
    if combine == "zip":
        for (place, _), length in zip(axes, lengths, strict=True):
            if length != lengths[0]:
                message = f"{length} values, and /axes/{axes[0][0]} has {lengths[0]}; zip needs equally many"
                yield Fault(f"/axes/{place}", "unequal_lengths", message)
    points = max(lengths, default=0) if combine == "zip" else math.prod(lengths)
    if max_points is not None and points > max_points:
        yield Fault("/axes", "too_many_points", f"{points} points; at most {max_points} are accepted")


def budget_faults(base: Mapping[str, object]) -> Iterator[Fault]:
    """Yield a fault for a budget, which is turned into a tier for one problem at a time."""
    match base:
        case {"accuracy": {"budget_seconds": _}}:
            message = "a budget is for single problems; accepted in a sweep are a tolerance and a tier"
            yield Fault("/base/accuracy/budget_seconds", "budget_in_sweep", message)


def kept_faults(keep: Sequence[str], problem: Problem, *, has_series: bool) -> Iterator[Fault]:
    """Yield the faults of ``keep`` for points like ``problem``."""
    if not keep and not has_series:
        accepted = ", ".join(NUMBERS)
        yield Fault("/keep", "invalid_length", f"nothing is kept of the points; accepted are {accepted}")
    for place, name in enumerate(keep):
        output = NUMBERS[name].output
        if name in keep[:place]:
            yield Fault(f"/keep/{place}", "invalid_value", f"{name} is given twice; once is accepted")
        elif output is not None and output not in problem.outputs:
            message = f'{name} needs "{output}" among the outputs of the base'
            yield Fault(f"/keep/{place}", "output_needed", message)


def series_faults(sweep: Sweep) -> Iterator[Fault]:
    """Yield the faults of keeping the samples of every point of ``sweep``."""
    if not sweep.series_columns:
        message = "the outputs of the base hold no function of time; add gamma, omega or orientation"
        yield Fault("/series", "output_needed", message)
    for place, each in enumerate(sweep.axes):
        if each.path == _SAMPLES:
            message = "series are equally long: with them the number of samples cannot vary"
            yield Fault(f"/axes/{place}/pointer", "varying_samples", message)
    total = sweep.points * sweep.samples
    if total > MAX_SERIES_SAMPLES:
        message = (
            f"{sweep.points} points with {sweep.samples} samples are {total} samples; at most "
            f"{MAX_SERIES_SAMPLES} are accepted. Without series any point can be solved again by itself"
        )
        yield Fault("/series", "series_too_large", message)


def _is_number(found: object) -> bool:
    if isinstance(found, bool) or not isinstance(found, int | float | str):
        return False
    try:
        exact_number(found)
    except InvalidNumberError:
        return False
    return True
