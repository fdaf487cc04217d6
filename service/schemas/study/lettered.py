"""Documents of questions about integrals and potentials, in which moments and parameters may be letters."""

from contextlib import suppress
from fractions import Fraction
from functools import partial
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, PlainValidator, WithJsonSchema
from pydantic.config import JsonDict

from service.dynamics.errors import FormulaError, InvalidNumberError
from service.dynamics.exact import exact_number
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import MAX_CHARACTERS
from service.schemas.reading.numbers import Exact, Moment, integer_schema, read_integer, read_moment, refuse
from service.schemas.reading.parts import WireModel

MOST_DEGREE, MOST_POTENTIAL_DEGREE = 12, 16
"""Largest degrees of integrals, in each group of variables, and of potentials."""
_MOMENT = "A number, or a formula in the other moments and parameters; left out it is a letter."
_AREAS = "accepted are 0, where the areas integral is 0, and null"


def _read_moment(value: object) -> Fraction | str:
    """Return a moment, or a formula for it in other moments and parameters."""
    if not isinstance(value, str):
        return read_moment(value)
    with suppress(InvalidNumberError):
        exact_number(value)
        return read_moment(value)
    try:
        parse(value)
    except FormulaError as error:
        raise refuse(error.code, error.message) from error
    return value


def moment_of(value: str | int | float) -> Fraction | str:
    """Return a valid moment as a number, or the text of its formula."""
    try:
        return exact_number(value)
    except InvalidNumberError:
        return str(value)


_FORMULA = {"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "string", "examples": ["2*C"]}]}
LetteredMoment = Annotated[Fraction | str, PlainValidator(_read_moment), WithJsonSchema(_FORMULA)]


def _read_areas(value: object) -> int | None:
    if value is not None and read_integer(value, accepted=_AREAS) != 0:
        raise refuse("out_of_range", _AREAS)
    return None if value is None else 0


Areas = Annotated[
    int | None,
    PlainValidator(_read_areas),
    WithJsonSchema({"anyOf": [{"const": 0}, {"type": "null"}]}),
]


def _up_to(value: object, *, most: int) -> int:
    accepted = f"0 to {most} are accepted"
    number = read_integer(value, accepted=accepted)
    if not 0 <= number <= most:
        raise refuse("out_of_range", f"{number}; {accepted}")
    return number


Degree = Annotated[
    int,
    PlainValidator(partial(_up_to, most=MOST_DEGREE)),
    WithJsonSchema(integer_schema("4", minimum=0, maximum=MOST_DEGREE)),
]
PotentialDegree = Annotated[
    int,
    PlainValidator(partial(_up_to, most=MOST_POTENTIAL_DEGREE)),
    WithJsonSchema(integer_schema("8", minimum=0, maximum=MOST_POTENTIAL_DEGREE)),
]


class LetteredBodyIn(WireModel):
    """Moments of inertia, some of which may be letters."""

    A: LetteredMoment | None = Field(default=None, description=_MOMENT)
    B: LetteredMoment | None = Field(default=None, description=_MOMENT)
    C: LetteredMoment | None = Field(default=None, description=_MOMENT)


class LetteredPotentialIn(WireModel):
    """A potential, some of whose parameters may be letters."""

    type: Literal["expression"] = Field(description="A formula; that of gravity is `a*g1 + b*g2 + c*g3`.")
    expression: str = Field(description="In g1, g2, g3, the parameters and A, B, C.")
    parameters: dict[str, Exact | None] = Field(
        default_factory=dict, description="Numbers by their names; null leaves one free, as a letter."
    )


class _SettingIn(WireModel):
    body: LetteredBodyIn = Field(default_factory=LetteredBodyIn, description="The rigid body.")
    potential: LetteredPotentialIn = Field(description="The potential.")
    areas: Areas = Field(default=None, description="0: only motions with I3 = 0; null: all.")


class IntegralIn(_SettingIn):
    """A function that may be an integral: what ``POST /v1/integrals`` takes."""

    function: str = Field(
        description="A formula in p, q, r, g1, g2, g3, the moments and the parameters.",
        max_length=MAX_CHARACTERS,
        examples=["(p^2 - q^2 - g1)^2 + (2*p*q - g2)^2"],
    )
    relations: Annotated[list[str], Field(max_length=8)] = Field(
        default_factory=list, description="Polynomials that are 0 on the motions that are asked about."
    )
    relation: bool = Field(
        default=False, description="Ask instead whether f = 0 is an invariant relation: f' = μ f."
    )


class DegreeIn(WireModel):
    """Largest degrees, each of one group of variables."""

    omega: Degree = Field(description="In p, q, r.")
    gamma: Degree = Field(description="In g1, g2, g3, on the sphere.")


class IntegralSearchIn(_SettingIn):
    """A body and a polynomial potential: what ``POST /v1/integrals/searches`` takes."""

    degree: DegreeIn = Field(description="Degrees up to which integrals are searched.")


class RatioIn(WireModel):
    """The two moments on which admissible potentials depend."""

    A: Moment = Field(description="The moment about the first axis.")
    C: Moment = Field(description="The moment about the third axis.")


def _accept_nothing(schema: JsonDict) -> None:
    if isinstance(choices := schema["anyOf"], list):
        choices.append({"type": "object", "maxProperties": 0})


class PotentialSearchIn(WireModel):
    """A degree, and perhaps a body: what ``POST /v1/potentials/searches`` takes."""

    body: Annotated[RatioIn | None, BeforeValidator(lambda value: None if value == {} else value)] = Field(
        default=None,
        description="The rigid body; left out, null or empty: every ratio A/C.",
        json_schema_extra=_accept_nothing,
    )
    degree: PotentialDegree = Field(description="Largest degree of the polynomials on the sphere.")
