"""Reads what ``POST /v1/atlases`` and ``polhode atlas`` take: a body, a potential and a range of λ."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, PlainValidator, WithJsonSchema

from service.dynamics.atlas.parts import LambdaRange
from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.exact import exact_number
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Accept
from service.schemas.problem.documents import MEMBERS
from service.schemas.problem.potentials import PotentialIn
from service.schemas.problem.problem import each_once
from service.schemas.problem.rules import read_setting
from service.schemas.problem.sections import BodyIn
from service.schemas.problem.trusted import body_of, potential_of, sign_of
from service.schemas.reading.documents import InvalidProblemError, Part, fault_of
from service.schemas.reading.numbers import Positive, Sign, integer_schema, read_integer, refuse
from service.schemas.reading.parts import WireModel, given, one_of_each, read_parts, within

SMALLEST, LARGEST = Fraction(1, 10**9), Fraction(10**9)
FEWEST, MOST = 9, 2001
DEFAULT_SAMPLES = 101


def _forward(ends: list[Fraction]) -> list[Fraction]:
    lower, upper = ends
    for place, end in enumerate(ends):
        if not SMALLEST <= end <= LARGEST:
            raise refuse("out_of_range", f"{float(end):g}; accepted are 1e-9 to 1e9", below=str(place))
    if not lower < upper or float(lower) == float(upper):
        raise refuse(
            "out_of_range", "the second number must be larger than the first, also as a double", below="1"
        )
    return ends


def _read_followed(value: object) -> int:
    accepted = f"{FEWEST} to {MOST} are accepted"
    number = read_integer(value, accepted=accepted)
    if not FEWEST <= number <= MOST:
        raise refuse("out_of_range", f"out of range; {accepted}")
    return number


Followed = Annotated[
    int,
    PlainValidator(_read_followed),
    WithJsonSchema(integer_schema("101", minimum=FEWEST, maximum=MOST)),
]
AtlasOutput = Literal["period", "stability"]


def _all_outputs() -> list[AtlasOutput]:
    return ["period"]


class AtlasIn(WireModel):
    """A body, a potential and a range of λ: what ``POST /v1/atlases`` takes."""

    model_config = one_of_each([within("body", given("A", "C"))])

    body: BodyIn = Field(description="The rigid body; A ≠ C. B is needed for stability only.")
    potential: PotentialIn = Field(
        description="The potential. Without a formula (`general`, F not constant) the windows are seen,"
        " and not proved."
    )
    lambda_: Annotated[list[Positive], Field(min_length=2, max_length=2), AfterValidator(_forward)] = Field(
        alias="lambda", description="Smallest and largest λ, from 1e-9 to 1e9."
    )
    g1_sign: Sign = Field(default=1, description="Sign of g1 on the curves; 1 if left out.")
    g3_sign: Sign = Field(default=1, description="Sign of g3 where the motion starts; 1 if left out.")
    samples: Followed = Field(
        default=DEFAULT_SAMPLES,
        description="About how many λ the windows are followed at; each part has at least 9.",
    )
    outputs: Annotated[list[AtlasOutput], Field(max_length=2)] = Field(
        default_factory=_all_outputs,
        description="`period`, or nothing, which is faster. `stability` takes a job's time for every λ: a job"
        " always draws such an atlas.",
    )
    accept: Accept = Field(
        default="proved",
        description="`undecided`: the potential may be neither proved admissible nor refuted; the motions are"
        " then those that it would have.",
    )


@dataclass(frozen=True, slots=True)
class AtlasRequest:
    """A request for an atlas."""

    body: RigidBody
    potential: Potential
    range: LambdaRange
    samples: int
    wants_period: bool
    wants_stability: bool
    accepts_undecided: bool


def trusted_atlas(document: Part) -> AtlasRequest:
    """Return what a valid document asks; raises what its constructors raise."""
    body = body_of(document)
    return _question(document, body, potential_of(document["potential"], body))


def _question(document: Part, body: RigidBody, potential: Potential) -> AtlasRequest:
    lower, upper = map(exact_number, document["lambda"])
    g1_sign, g3_sign = (sign_of(document.get(name, 1)) for name in ("g1_sign", "g3_sign"))
    outputs = document.get("outputs", ("period",))
    return AtlasRequest(
        body,
        potential,
        LambdaRange(lower, upper, g1_sign, g3_sign),
        int(exact_number(document.get("samples", DEFAULT_SAMPLES))),
        "period" in outputs,
        "stability" in outputs,
        document.get("accept", "proved") == "undecided",
    )


def read_atlas(document: object) -> AtlasRequest:
    """Return what the document asks.

    Raises
    ------
    InvalidProblemError
        Lists every fault.
    """
    parts, faults = read_parts(document, AtlasIn, MEMBERS)
    body, potential = read_setting(document, parts, faults)
    outputs = parts.get("outputs")
    if body is not None:
        demands: list[Callable[[], object]] = [body.require_planar]
        if isinstance(outputs, list) and "stability" in outputs:
            demands.append(lambda: body.require_B("stability"))
        for demand in demands:
            try:
                demand()
            except DynamicsError as error:
                faults.append(fault_of(error))
    if body is None or potential is None or faults:
        raise InvalidProblemError(each_once(faults))
    return _question({**parts, "lambda": parts["lambda_"]}, body, potential)
