"""The summary of a solution: written by workers, stored as it is, and shown but for what a row adds.

:class:`service.schemas.replies.solution.SolutionOut` describes each field to clients. These are types alone:
stores and workers load no pydantic.
"""

from collections.abc import Mapping, Sequence
from typing import Literal, NotRequired, TypedDict

from service.schemas.reading.documents import Part

StateName = Literal["queued", "running", "succeeded", "failed", "cancelled"]
"""The states of jobs and sweeps."""


class EstimateSummary(TypedDict):
    """A number and the bound of its absolute error."""

    value: float
    error: float


class EnclosureSummary(TypedDict):
    """A proven enclosure: decimals of its middle and its radius."""

    value: str
    radius: str


class WindowSummary(TypedDict):
    """The part of the curve on which a planar motion takes place."""

    index: int
    ends: tuple[str, str]
    g1: tuple[float, float]
    g2: tuple[float, float]


class AsymptoteSummary(TypedDict):
    """The limit of an aperiodic motion."""

    kind: str
    time: EstimateSummary | None
    rate: EstimateSummary | None
    gamma: tuple[float, float, float]


class AsymptotesSummary(TypedDict):
    """The limits of an aperiodic motion backwards and forwards in time."""

    past: AsymptoteSummary
    future: AsymptoteSummary


class IntegralSummary(TypedDict):
    """The largest deviation of an integral, and of a further or a proven one its value."""

    drift: float
    value: NotRequired[float | EnclosureSummary]
    kind: NotRequired[str]


class GroupErrorSummary(TypedDict):
    """The error of variables that have one size."""

    absolute: float
    relative: float | None


class CrossCheckSummary(TypedDict):
    """Comparison with a second, independent method."""

    method: str
    disagreement: float
    horizon: float
    agrees: bool


class StabilitySummary(TypedDict):
    """Whether small disturbances leave the plane of the motion."""

    trace: float | EnclosureSummary
    error: float
    multipliers: Sequence[Sequence[float]]
    multipliers_error: float
    verdict: str
    proof: NotRequired[str]
    exponent: float
    exponent_error: float
    closed_form_trace: EstimateSummary | None
    trusted_time: float | None


class PrecessionSummary(TypedDict):
    """Growth of the azimuths of two body axes in one period."""

    psi1: EstimateSummary | EnclosureSummary
    psi3: EstimateSummary | EnclosureSummary


class NoticeSummary(TypedDict):
    """A warning, and the field that it is about."""

    code: str
    message: str
    pointer: str


class ProvenanceSummary(TypedDict):
    """The program and the machine that computed the solution; older ones lack what was added later."""

    version: str
    numerics: int
    processor: NotRequired[str]
    libraries: NotRequired[str]
    threads: NotRequired[int | None]
    way: NotRequired[str]


class CostSummary(TypedDict):
    """Seconds of the computation, and of the examination before it."""

    compute_seconds: float
    examination_seconds: NotRequired[float]


class KnownCaseSummary(TypedDict):
    """A case that has a name, and who found it."""

    name: str
    source: str


class SolutionSummary(TypedDict):
    """A solution without ids, labels and arrays; older ones lack what was added later."""

    problem: Part
    method: str
    tier: str
    period: EstimateSummary | EnclosureSummary | None
    aperiodic: str | None
    asymptotes: AsymptotesSummary | None
    energy: EstimateSummary | EnclosureSummary
    window: WindowSummary | None
    invariants: Mapping[str, IntegralSummary] | None
    error: float
    errors: NotRequired[Mapping[str, GroupErrorSummary]]
    error_kind: NotRequired[Mapping[str, str]]
    cross_check: CrossCheckSummary | None
    stability: StabilitySummary | None
    precession: PrecessionSummary | None
    conventions: Sequence[str]
    known_cases: NotRequired[Sequence[KnownCaseSummary]]
    warnings: Sequence[NoticeSummary]
    evidence: Mapping[str, float | int | str]
    provenance: NotRequired[ProvenanceSummary]
    cost: NotRequired[CostSummary]
