"""The axes of a sweep document: which number of the base varies, and its values."""

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Discriminator, Field, PlainValidator, Strict, Tag, WithJsonSchema

from service.schemas.reading.numbers import (
    Exact,
    Positive,
    each_of,
    integer_schema,
    read_exact,
    read_integer,
    refuse,
)
from service.schemas.reading.parts import TAG_MARK, WireModel, tag_by_field

MAX_LISTED = 100_000
LONGEST_AXIS = 100_000_000
"""Values that one axis can have; how many points a sweep may have is a setting."""
LARGEST_SEED = 2**64 - 1
AXIS_KINDS = ("values", "linspace", "logspace", "uniform")


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


MODELS: Mapping[str, type[WireModel]] = {
    "values": ListedAxisIn,
    "linspace": LinearAxisIn,
    "logspace": LogarithmicAxisIn,
    "uniform": UniformAxisIn,
}
"""The axis classes by the field that holds their values."""


def _require_axis(value: object) -> object:
    if isinstance(value, tuple(MODELS.values())):
        return value
    accepted = f'an axis has a "pointer" and one of {", ".join(AXIS_KINDS)}'
    if not isinstance(value, dict):
        raise refuse("invalid_type", f"an object is expected; {accepted}")
    given = [name for name in AXIS_KINDS if name in value]
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
    Discriminator(tag_by_field(AXIS_KINDS, "values")),
    BeforeValidator(_require_axis),
]
