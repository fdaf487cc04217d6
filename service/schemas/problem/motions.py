"""The `motion` of a problem document: planar on a curve, from any initial state, or a classical case."""

from collections.abc import Iterator, Sequence, Set
from decimal import Context, Decimal
from fractions import Fraction
from typing import Annotated, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    WithJsonSchema,
    model_validator,
)

from service.dynamics.classical.bodies import CASES
from service.schemas.reading.documents import Document
from service.schemas.reading.numbers import (
    Exact,
    Nonzero,
    Positive,
    Sign,
    WindowNumber,
    integer_schema,
    read_integer,
    refuse,
)
from service.schemas.reading.parts import (
    TAG_MARK,
    Schema,
    Section,
    WireModel,
    given,
    one_of_each,
    require_kind,
    tag_by_type,
    within,
)

CaseName = Literal[
    "hess",
    "staude",
    "bobylev_steklov",
    "goriatchev",
    "steklov",
    "chaplygin",
    "kowalewski",
    "grioli",
    "dokshevich_1965",
    "konosevich_pozdnyakovich",
    "elliptic_x_minus_k_over_x",
]
HESS_TOLERANCE = Fraction(1, 10**15)
"""How far from 1 the square of the length of Hess's gamma may be: that is the rounding of doubles."""
OPTIONAL = ("phase", "direction", "sign", "solution", "spin")
"""Fields with a default; the others are needed where a case has them."""


def _read_solution(value: object) -> int:
    number = read_integer(value, accepted="1 and 2 are accepted")
    if number not in (1, 2):
        raise refuse("out_of_range", "1 and 2 are accepted")
    return number


Solution = Annotated[
    int, PlainValidator(_read_solution), WithJsonSchema(integer_schema("1", minimum=1, maximum=2))
]
PartialTriple = Annotated[list[Exact | None], Field(min_length=3, max_length=3)]


def _needed(case: str) -> tuple[str, ...]:
    return tuple(name for name in CASES[case].fields if name not in OPTIONAL)


def _with_what_they_need(needed: tuple[str, ...]) -> Schema:
    """Return the schema of a motion of one of the cases that need just these fields."""
    names = sorted(name for name in CASES if _needed(name) == needed)
    return {"allOf": [within("case", {"enum": names}), given(*needed)]}


class ClassicalMotionIn(Section):
    """A motion of one of the classical cases; `GET /v1/families` lists which fields each case takes."""

    model_config = one_of_each([_with_what_they_need(needed) for needed in sorted(set(map(_needed, CASES)))])

    type: Literal["classical"] = Field(description="Says which kind of motion this is.")
    case: CaseName = Field(description="The case, as `classical` in `GET /v1/families` lists it.")
    phase: Exact | None = Field(default=None, description="Where on its closed curve it is at t = 0, 0 to 1.")
    direction: Sign | None = Field(default=None, description="-1 for the motion backwards in time.")
    sign: Sign | None = Field(
        default=None, description="-1 for the motion turned by half a turn about the axis of the centre."
    )
    solution: Solution | None = Field(
        default=None, description="1 or 2: which body, where the case has two and the moments leave it open."
    )
    p: Exact | None = Field(default=None, description="Of Bobylev and Steklov: the constant component.")
    energy: Exact | None = Field(default=None, description="Of Bobylev and Steklov: the energy.")
    spin: Exact | None = Field(
        default=None,
        description="Of Staude, about a principal axis through the centre: the rate of rotation.",
    )
    omega: PartialTriple | None = Field(
        default=None, description="Of Hess: [p, q, r] at t = 0; null for one component that follows."
    )
    gamma: PartialTriple | None = Field(
        default=None,
        description="Of Hess: [g1, g2, g3] at t = 0. Of Staude: the direction of the axis, of any length;"
        " null for one component that follows.",
    )

    @model_validator(mode="after")
    def _of_its_case(self) -> Self:
        taken = CASES[self.case].fields
        accepted = ", ".join(taken)
        for name in self._given():
            if name not in taken:
                message = f"the case {self.case} does not take it; accepted are {accepted}"
                raise refuse("field_of_other_case", message, below=name)
        for name in _needed(self.case):
            if getattr(self, name) is None:
                message = f'the case {self.case} needs "{name}": {taken[name]}'
                raise refuse("missing_field", message, below=name)
        if self.phase is not None:
            _in_phase(self.phase)
        if self.case == "hess":
            self._require_unit_gamma()
        return self

    def _given(self) -> list[str]:
        names = [name for name in type(self).model_fields if name not in ("type", "case")]
        return [name for name in names if getattr(self, name) is not None]

    def _require_unit_gamma(self) -> None:
        gamma = self.gamma or []
        if None in gamma:
            raise refuse("invalid_number", "all three components are needed here", below="gamma")
        square = sum(((g or Fraction(0)) ** 2 for g in gamma), Fraction(0))
        if abs(square - 1) > 2 * HESS_TOLERANCE:
            message = f"the square of its length is {float(square):.17g}; 1 is accepted, within 2e-15"
            raise refuse("not_unit_gamma", message, below="gamma")

    def canonical(self) -> Document:
        """Return the document with every field that the case takes, defaults filled in."""
        defaults: Document = {
            "phase": "0",
            "direction": 1,
            "sign": 1,
            "solution": None,
            "spin": None,
        }
        document: Document = {"type": self.type, "case": self.case}
        for name in CASES[self.case].fields:
            document[name] = _text(getattr(self, name), defaults.get(name))
        return document


def _in_phase(phase: Fraction) -> None:
    if not 0 <= phase <= 1:
        raise refuse("out_of_range", f"phase = {float(phase):.6g}; 0 to 1 is accepted", below="phase")


def _text(value: object, default: object) -> object:
    if value is None:
        return default
    if isinstance(value, list):
        return [None if x is None else str(x) for x in value]
    return str(value) if isinstance(value, Fraction) else value


UNIT_TOLERANCE = Fraction(1, 10**12)
"""How far from 1 the length of gamma may be; gamma is never normalised."""

_G2_SIGN = "Sign of g2: the hemisphere; 1 if left out."
_S_SIGN = "Sign of s = r/(A g1) = -p/(C g3): which way it goes along the curve; 1 if left out."


class EquatorStartIn(WireModel):
    """Start where g2 = 0."""

    at: Literal["equator"] = Field(description="Says which kind of start this is.")
    s_sign: Sign = Field(default=1, description=_S_SIGN)


class RestStartIn(WireModel):
    """Start where p = r = 0."""

    at: Literal["rest"] = Field(description="Says which kind of start this is.")
    g2_sign: Sign = Field(default=1, description=_G2_SIGN)


class PointStartIn(WireModel):
    """Start at a given g1."""

    g1: Nonzero = Field(description="Within the window, with the sign of its curve.")
    g2_sign: Sign = Field(default=1, description=_G2_SIGN)
    s_sign: Sign = Field(default=1, description=_S_SIGN)


def _require_start(value: object) -> object:
    accepted = 'accepted are {"at": "equator"}, {"at": "rest"} and {"g1": x}'
    if isinstance(value, EquatorStartIn | RestStartIn | PointStartIn):
        return value
    if not isinstance(value, dict):
        raise refuse("invalid_type", f"an object is expected; {accepted}")
    if "at" not in value and "g1" not in value:
        raise refuse("missing_field", accepted)
    if "at" in value and value["at"] not in ("equator", "rest"):
        raise refuse("invalid_value", "accepted are equator and rest", below="at")
    return value


def _tag_start(value: object) -> str:
    at = value.get("at", "point") if isinstance(value, dict) else getattr(value, "at", "point")
    return f"{TAG_MARK}{at}"


StartIn = Annotated[
    Annotated[EquatorStartIn, Tag(f"{TAG_MARK}equator")]
    | Annotated[RestStartIn, Tag(f"{TAG_MARK}rest")]
    | Annotated[PointStartIn, Tag(f"{TAG_MARK}point")],
    Discriminator(_tag_start),
    BeforeValidator(_require_start),
]


CURVE_FIELDS = {"lambda": "lambda_", "nu": "nu", "g1_sign": "g1_sign"}
"""Fields that choose the curve, and their attributes."""


def curve_faults(given: Set[str]) -> Iterator[tuple[str, str, str]]:
    """Yield field, code and message of each fault in the choice among CURVE_FIELDS."""
    if not given & {"lambda", "nu"}:
        yield "lambda", "missing_field", '"lambda" (or, for A = 2C, "nu") is missing'
    if {"lambda", "nu"} <= given:
        yield "nu", "conflicting_fields", 'either "lambda" or "nu" is accepted, not both'
    elif {"nu", "g1_sign"} <= given:
        yield "g1_sign", "conflicting_fields", "the sign of nu is the sign of g1: leave g1_sign out"


class PlanarMotionIn(Section):
    """The q = 0, I3 = 0 motion on |g3| = lambda |g1|^(C/A); for A = 2C on g3² = nu g1."""

    model_config = one_of_each([given("lambda"), given("nu")])

    type: Literal["planar"] = Field(description="Says which kind of motion this is.")
    lambda_: Positive | None = Field(
        default=None, alias="lambda", description="The constant of the curve, > 0; needed unless nu is given."
    )
    nu: Nonzero | None = Field(default=None, description="Stands for lambda and g1_sign; for A = 2C only.")
    g1_sign: Sign | None = Field(default=None, description="Sign of g1 on the curve; 1 if left out.")
    g3_sign: Sign = Field(default=1, description="Sign of g3 on the curve; 1 if left out.")
    window: WindowNumber | None = Field(
        default=None, description="Number of one of several windows, from 0; the only one if left out."
    )
    start: StartIn | None = Field(
        default=None,
        description="Where on the window it is at t = 0. If left out at the equator with s > 0, or, where the"
        " window does not reach it, at rest at the larger |g1| with g2 > 0.",
    )

    @model_validator(mode="after")
    def _one_curve(self) -> Self:
        given = {name for name in CURVE_FIELDS if getattr(self, CURVE_FIELDS[name]) is not None}
        for below, code, message in curve_faults(given):
            raise refuse(code, message, below=below)
        return self

    def canonical(self) -> Document:
        """Return the canonical document, with every field that applies."""
        curve: Document = (
            {"nu": str(self.nu)}
            if self.nu is not None
            else {"lambda": str(self.lambda_), "g1_sign": self.g1_sign or 1}
        )
        start = None if self.start is None else self.start.model_dump()
        return {"type": self.type, **curve, "g3_sign": self.g3_sign, "window": self.window, "start": start}


def _length(square: Fraction) -> Decimal:
    # 20 digits show a deviation of 1e-12, which 6 digits of a double would not; Decimal has any exponent.
    context = Context(prec=20)
    ratio = context.divide(Decimal(square.numerator), Decimal(square.denominator))
    return context.sqrt(ratio).normalize()


Triple = Annotated[list[Exact], Field(min_length=3, max_length=3)]


def is_unit(gamma: Sequence[Fraction]) -> bool:
    """Tell whether a document may have this gamma: its length is 1 within the tolerance."""
    square = sum((g * g for g in gamma), Fraction(0))
    # |γ| = 1 ± e means γ² = 1 ± 2e + e²; the numbers are exact, so no rounding is allowed for.
    return (1 - UNIT_TOLERANCE) ** 2 <= square <= (1 + UNIT_TOLERANCE) ** 2


class StateMotionIn(Section):
    """The motion from any initial state."""

    type: Literal["state"] = Field(description="Says which kind of motion this is.")
    omega: Triple = Field(description="[p, q, r], the angular velocity at t = 0, radians per unit of time.")
    gamma: Triple = Field(description="[g1, g2, g3] at t = 0, of length 1 within 1e-12.")

    @model_validator(mode="after")
    def _unit_gamma(self) -> Self:
        if not is_unit(self.gamma):
            square = sum((g * g for g in self.gamma), Fraction(0))
            raise refuse(
                "not_unit_gamma",
                f"the length of gamma is {_length(square)}; 1 is accepted, within 1e-12",
                below="gamma",
            )
        return self

    def canonical(self) -> Document:
        """Return the document."""
        return {
            "type": self.type,
            "omega": [str(x) for x in self.omega],
            "gamma": [str(x) for x in self.gamma],
        }


MOTIONS: dict[str, type[BaseModel]] = {
    "planar": PlanarMotionIn,
    "state": StateMotionIn,
    "classical": ClassicalMotionIn,
}
"""Classes of motions by their types."""

MotionIn = Annotated[
    Annotated[PlanarMotionIn, Tag(f"{TAG_MARK}planar")]
    | Annotated[StateMotionIn, Tag(f"{TAG_MARK}state")]
    | Annotated[ClassicalMotionIn, Tag(f"{TAG_MARK}classical")],
    Discriminator(tag_by_type),
    BeforeValidator(require_kind(tuple(MOTIONS), models=MOTIONS)),
]
