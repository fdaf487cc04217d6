"""Solutions and catalogues of them, as clients see them."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.schemas.verdict import ResponseModel


class EstimateOut(ResponseModel):
    """A number and the bound of its absolute error."""

    value: float
    error: float


class WindowOut(ResponseModel):
    """Where on the curve the motion takes place."""

    index: int
    ends: tuple[str, str]
    g1: tuple[float, float]
    g2: tuple[float, float]


class AsymptoteOut(ResponseModel):
    """What an aperiodic motion runs into."""

    kind: Literal["equilibrium", "pole", "collision"]
    time: EstimateOut | None = Field(description="When it is there; null if in the limit of t only.")
    rate: EstimateOut | None = Field(description="The distance dies out like exp(-rate |t|), if it does.")
    gamma: tuple[float, float, float] = Field(description="g1, g2, g3 there.")


class AsymptotesOut(ResponseModel):
    """Where an aperiodic motion comes from and where it goes."""

    past: AsymptoteOut
    future: AsymptoteOut


class DriftOut(ResponseModel):
    """The largest departure of an integral from its value, over the asked samples."""

    drift: float


class CrossCheckOut(ResponseModel):
    """What a second, independent method says."""

    method: str
    disagreement: float
    horizon: float = Field(description="Largest |t| that was compared.")
    agrees: bool


class CostOut(ResponseModel):
    """What the computation took."""

    compute_seconds: float


class ProvenanceOut(ResponseModel):
    """What computed the solution."""

    version: str
    numerics: int


class SolutionOut(ResponseModel):
    """A solution without its arrays."""

    id: str
    job: str = Field(description="The job that computed it; later jobs may have reused it.")
    problem: dict[str, object]
    method: Literal["quadrature", "integration"]
    tier: str
    period: EstimateOut | None = Field(description="Of all six variables; null if not periodic or not known.")
    aperiodic: Literal["separatrix", "equilibrium", "collision", "pole"] | None = Field(
        description="Why a planar motion has no period."
    )
    asymptotes: AsymptotesOut | None = Field(default=None, description="Of an aperiodic motion.")
    energy: EstimateOut
    window: WindowOut | None
    invariants: dict[str, DriftOut] | None = Field(description="If the outputs ask for them.")
    error: float = Field(description="Largest absolute error of any variable over the asked times.")
    cross_check: CrossCheckOut | None
    stability: None = Field(description="Not computed by this version.")
    conventions: list[str] = Field(description="Choices made where the equations leave one.")
    evidence: dict[str, float | int | str] = Field(description="What the solver measured about itself.")
    cost: CostOut
    provenance: ProvenanceOut
    created_at: datetime


class SolutionPageOut(ResponseModel):
    """Some of the solutions that match."""

    items: list[SolutionOut]
    total: int = Field(description="Solutions that match in all.")
    limit: int
    offset: int


class TrajectoryOut(ResponseModel):
    """Samples of a solution."""

    columns: dict[str, list[float]] = Field(
        description="Equally long columns by name: t, p, q, r, g1, g2, g3."
    )
    error: float = Field(description="Bound of the absolute error of every number.")


class FamilyOut(ResponseModel):
    """A family of potentials."""

    type: str = Field(description="The potential's `type`.")
    title: str
    potential: str = Field(description="V, as a formula.")
    conditions: list[str]
    parameters: dict[str, str]
    source: str
    example: dict[str, object] = Field(description="A problem that can be sent to /v1/jobs.")


class FamiliesOut(ResponseModel):
    """The catalogue."""

    items: list[FamilyOut]


class HealthOut(ResponseModel):
    """The process serves."""

    status: Literal["ok"]
    checks: dict[str, str]
