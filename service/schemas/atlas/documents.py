"""Documents of atlases: what ``POST /v1/atlases`` and ``polhode atlas`` take, and what they answer.

They take a body, a potential and a range of λ.
"""

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
from service.schemas.problem.documents import MEMBERS, read_setting
from service.schemas.problem.potentials import PotentialIn
from service.schemas.problem.problem import each_once
from service.schemas.problem.sections import BodyIn
from service.schemas.problem.trusted import body_of, potential_of, sign_of
from service.schemas.reading.documents import InvalidProblemError, Part, fault_of
from service.schemas.reading.numbers import Positive, Sign, integer_schema, read_integer, refuse
from service.schemas.reading.parts import WireModel, given, one_of_each, read_parts, within
from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.verdict import EndOut

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


ChangeOut = Literal[
    "window_appears",
    "window_vanishes",
    "windows_merge",
    "window_splits",
    "end_crosses_equator",
    "end_at_pole",
    "several",
]
ProofOut = Literal["proved", "seen"]
_PROOF = (
    "`proved` for every λ, or `seen`: of a potential without a formula, at the samples and by bisection"
    " between them; a window narrower than the distance of two samples can be missed."
)
WindowKindOut = Literal["periodic", "separatrix", "equilibrium", "standstill", "collision", "pole", "edge"]


class MeasuredOut(ResponseModel):
    """A number with a bound of its error."""

    value: float = Field(description="The number.")
    error: float = Field(description="Largest error that it may have.")


class AtlasStabilityOut(ResponseModel):
    """Whether small disturbances leave the plane, for each of `samples.lambda`; null where it is not known.

    As in a solution: the errors are measured by halving the steps, and not proved; between these λ nothing
    is said.
    """

    trace: list[float | None] = Field(description="μ + 1/μ over the period of the six variables.")
    trace_error: list[float | None] = Field(description="Estimated errors of the trace.")
    multipliers: list[tuple[tuple[float, float], tuple[float, float]] | None] = Field(
        description="μ and 1/μ as [real, imaginary]."
    )
    multipliers_error: list[float | None] = Field(
        description="Errors of each multiplier that follow from those of the trace."
    )
    verdict: list[Literal["stable", "unstable", "marginal"] | None] = Field(
        description="`stable` if |trace| < 2, `unstable` if > 2, `marginal` if the error does not tell."
    )
    reason: list[str | None] = Field(description="The code that a job at this λ is refused with, else null.")


class AtlasWindowOut(ResponseModel):
    """One window on a part: its kind and ends are the same for all λ of the part."""

    window: int = Field(
        description="Its number at the λ in the middle of `samples`, for a motion's `window`."
    )
    kind: WindowKindOut = Field(description="As in verdicts: `periodic`, or why the motion never comes back.")
    ends: tuple[EndOut, EndOut] = Field(description="Where |g1| is smallest, where it is largest.")
    has_mirror_image: bool = Field(
        description="There is another arc with g2 → -g2, which counts as the same window."
    )
    g1: tuple[list[float | None], list[float | None]] = Field(
        description="g1 at the two ends for each of `samples.lambda`; null where an end is not enclosed."
    )
    g1_error: tuple[list[float | None], list[float | None]] = Field(
        description="Proved bounds of its errors."
    )
    g2: tuple[list[float | None], list[float | None]] = Field(
        description="Smallest and largest g2 of the northern arc for each of `samples.lambda`."
    )
    g2_error: tuple[list[float | None], list[float | None]] = Field(
        description="Proved bounds of its errors."
    )
    period: list[float | None] | None = Field(
        description="The period for each of `samples.lambda`; null where it is not known to three digits, and"
        " as a whole where it was not asked for, or the motion is not periodic."
    )
    period_error: list[float | None] | None = Field(
        description="Estimated errors: by how much the last two sums of the quadrature differ, and rounding."
    )
    stability: AtlasStabilityOut | None = Field(
        description="Null where it was not asked for, or the motion is not periodic."
    )


class AtlasSamplesOut(ResponseModel):
    """The λ of a part at which its windows are followed."""

    lambda_: list[float] = Field(
        alias="lambda", description="Growing, and denser towards the ends of the part."
    )
    energy: list[float | None] = Field(
        description="h(λ), the same for all windows; null where it has no bound."
    )
    energy_error: list[float | None] = Field(description="Proved bounds of its errors.")
    windows: list[AtlasWindowOut] = Field(description="None where there is no motion.")


class AtlasReasonOut(ResponseModel):
    """Why a part has no windows."""

    code: str = Field(description="The code that a job at this λ would be refused with.")
    detail: str = Field(description="The reason, for people.")


class AtlasPartOut(ResponseModel):
    """A part of the range on which the number, kinds and ends of the windows stay the same."""

    lambda_: tuple[float, float] = Field(alias="lambda", description="Its ends, rounded to doubles.")
    samples: AtlasSamplesOut | None = Field(description="Null with a `reason`.")
    reason: AtlasReasonOut | None = Field(
        description="Where the zeros of p² stay, but the kind of the motions is not settled; else null."
    )
    proof: ProofOut = Field(default="proved", description=_PROOF)


class AtlasChangeOut(ResponseModel):
    """A value of λ where windows change."""

    lambda_: MeasuredOut = Field(
        alias="lambda",
        description="The change is inside, and outside of all changes there is none: `proof` says how that"
        " is known.",
    )
    kind: ChangeOut = Field(
        description="As λ grows. Where a window appears or vanishes its motion is an equilibrium; where two"
        " merge or one splits there is a separatrix. `several`: more than one of these."
    )
    g1: MeasuredOut | None = Field(
        description="Where on the curve, with an estimated error; null where that is not known."
    )
    g2: MeasuredOut | None = Field(description="Where on the curve, with an estimated error.")
    proof: ProofOut = Field(default="proved", description=_PROOF)


class AtlasOut(ResponseModel):
    """All planar motions of a body and a potential over a range of λ."""

    lambda_: tuple[float, float] = Field(alias="lambda", description="The range that was asked.")
    verdict: Literal["admissible", "undecided"] = Field(
        description="That of the potential; if `undecided`, the motions are those that it would have."
    )
    parts: list[AtlasPartOut] = Field(description="In the order of growing λ.")
    changes: list[AtlasChangeOut] = Field(description="Between the parts, in the order of growing λ.")
    undecided: list[tuple[float, float]] = Field(
        description="Stretches of λ on which nothing is proved: features too narrow, or the time was over."
    )
