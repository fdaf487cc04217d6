"""The `motion` of a problem document that is one of the classical cases."""

from fractions import Fraction
from typing import Annotated, Literal, Self

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from service.dynamics.classical.catalogue import CASES
from service.dynamics.problem import ClassicalMotion
from service.schemas.reading.choices import WireModel
from service.schemas.reading.needs import Schema, given, one_of_each, within
from service.schemas.reading.numbers import Exact, Sign, integer_schema, read_integer, refuse

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
UNIT_TOLERANCE = Fraction(1, 10**15)
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


class ClassicalMotionIn(WireModel):
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
        if abs(square - 1) > 2 * UNIT_TOLERANCE:
            message = f"the square of its length is {float(square):.17g}; 1 is accepted, within 2e-15"
            raise refuse("not_unit_gamma", message, below="gamma")

    def to_domain(self, centre: tuple[Fraction, Fraction, Fraction]) -> ClassicalMotion:
        """Return the motion in the potential of ``centre``."""
        return ClassicalMotion(
            self.case,
            centre,
            self.phase or Fraction(0),
            self.direction or 1,
            self.sign or 1,
            self.solution,
            self.p,
            self.energy,
            self.spin,
            None if self.omega is None else (self.omega[0], self.omega[1], self.omega[2]),
            None if self.gamma is None else (self.gamma[0], self.gamma[1], self.gamma[2]),
        )

    def canonical(self) -> dict[str, object]:
        """Return the document with every field that the case takes, defaults filled in."""
        defaults: dict[str, object] = {
            "phase": "0",
            "direction": 1,
            "sign": 1,
            "solution": None,
            "spin": None,
        }
        document: dict[str, object] = {"type": self.type, "case": self.case}
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
