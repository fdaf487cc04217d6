"""The answer to a validation."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class ResponseModel(BaseModel):
    """What every object of an answer has in common: every field is always there."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


QuadrantOut = Literal["pp", "mp", "pm", "mm"]
"""Signs of g1 and g3."""


class EnergyFormulaOut(ResponseModel):
    """The energy of the motions, as a formula."""

    h: str | dict[QuadrantOut, str] = Field(
        description="In lambda, or in nu where A = 2C; by the signs of g1 and g3 where it depends on them."
    )


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


class FunctionValuesOut(ResponseModel):
    """A function that has no formula, by its values."""

    numeric: Literal[True]
    points: list[tuple[float, float]] = Field(description="[argument, value], the values rounded to doubles.")
    error: float = Field(description="Largest absolute error of a value.")


FunctionOut = str | FunctionValuesOut
"""A formula of the grammar, or values where there is none."""


class TermsOut(ResponseModel):
    """V = constant + (A g1² + C g3²) Σ A_n g2^n + Σ B_n-, C_n- and log_n-terms, n from 0; exact."""

    constant: str
    A: list[str]
    B: list[str]
    C: list[str]
    log: list[str]


class QuadrantValuesOut(ResponseModel):
    """F and G at the points that were sent."""

    F: list[tuple[float, float | None, float | None]] = Field(description="[w, value, error]")
    G: list[tuple[float, float | None, float | None]] = Field(description="[g2, value, error]")


class DecompositionOut(ResponseModel):
    """V = V1[F] + (A g1² + C g3²) G(g2); by the signs of g1 and g3 where they differ between quadrants."""

    F: FunctionOut | dict[QuadrantOut, FunctionOut] = Field(description="In w.")
    G: FunctionOut | dict[QuadrantOut, FunctionOut] = Field(description="In g2.")
    reference_angle: str
    terms: TermsOut | dict[QuadrantOut, TermsOut | None] | None = Field(
        description="Coefficients, if V is a finite sum of the known terms (on |g1| and |g3|)."
    )
    values: dict[QuadrantOut, QuadrantValuesOut] | None = Field(description="At the points that were sent.")


class NearestOut(ResponseModel):
    """The admissible polynomial nearest to one that is not, in the mean square over the sphere."""

    expression: str
    relative_squared_distance: str = Field(description="Mean of (V - nearest)² over that of V², exact.")


class NoticeOut(ResponseModel):
    """Something to know about the potential that is no fault."""

    code: str
    message: str
    pointer: str


class VerdictOut(ResponseModel):
    """Whether a potential admits the planar motions, and how that is known."""

    verdict: Literal["admissible", "inadmissible", "undecided"]
    proof: Literal["symbolic", "counterexample", "numeric"]
    energy: EnergyFormulaOut | None = Field(description="Null if it is not known or has no formula.")
    counterexample: CounterexampleOut | None
    evidence: EvidenceOut | None = Field(description="With proof `numeric`.")
    decomposition: DecompositionOut | None = Field(description="Of an admissible potential.")
    nearest: NearestOut | None = Field(description="Of a polynomial that is not admissible.")
    motions: list[MotionWindowOut] | None = Field(
        description="Every window of the motion that was sent; null if none was, or if there are no motions."
    )
    warnings: list[NoticeOut]
