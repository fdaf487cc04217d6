"""The answer to a validation."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class ResponseModel(BaseModel):
    """What every object of an answer has in common: every field is always there."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class EnergyFormulaOut(ResponseModel):
    """The energy of the motions, as a formula."""

    h: str = Field(description="In lambda, or in nu where A = 2C.")


class BallOut(ResponseModel):
    """mid ± rad, in decimals: the exact number is certainly inside."""

    mid: str
    rad: str


class CounterexampleOut(ResponseModel):
    """A point of the sphere where the residual of the compatibility equation is certainly not 0."""

    g: tuple[str, str, str] = Field(description="Exact g1, g2, g3.")
    residual: BallOut


class EvidenceOut(ResponseModel):
    """Zero could not be excluded anywhere."""

    points: int
    bits: int
    largest_enclosure: str


EndOut = Literal["pole", "rest", "equator", "equilibrium", "edge"]


class MotionWindowOut(ResponseModel):
    """A stretch of the curve on which a motion takes place."""

    window: int = Field(description="Its number, for the motion's `window`.")
    kind: Literal["periodic", "separatrix", "equilibrium", "collision", "pole", "edge"]
    ends: tuple[EndOut, EndOut] = Field(description="Where |g1| is smallest, where it is largest.")
    g1: tuple[float, float] = Field(description="g1, with its sign, at the two ends.")
    g2: tuple[float, float] = Field(description="Smallest and largest g2 of the northern arc.")


class VerdictOut(ResponseModel):
    """Whether a potential admits the planar motions, and how that is known."""

    verdict: Literal["admissible", "inadmissible", "undecided"]
    proof: Literal["symbolic", "counterexample", "numeric"]
    energy: EnergyFormulaOut | None = Field(description="Null if it is not known or has no formula.")
    counterexample: CounterexampleOut | None
    evidence: EvidenceOut | None = Field(description="With proof `numeric`.")
    decomposition: None = Field(description="Not computed by this version.")
    motions: list[MotionWindowOut] | None = Field(
        description="Every window of the motion that was sent; null if none was, or if there are no motions."
    )
