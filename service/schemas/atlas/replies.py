"""The answer of POST /v1/atlases."""

from typing import Literal

from pydantic import Field

from service.schemas.replies.response_model import ResponseModel
from service.schemas.replies.verdict import EndOut

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
