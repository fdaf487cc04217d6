"""The answers of /v1/solutions with functions, provenance and audits, and of the health checks."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.dynamics.numerics import ErrorKind
from service.schemas.replies.job import ClusterOut
from service.schemas.replies.response_model import ENDS_IN_WORDS, Columns, PageOut, ResponseModel
from service.schemas.replies.summary import StateName
from service.schemas.replies.verdict import KnownCaseOut, NoticeOut


class EstimateOut(ResponseModel):
    """A number and the bound of its absolute error."""

    value: float = Field(description="The number.")
    error: float = Field(
        description="Bound of the absolute error of the decimal that is written here, in the same unit."
    )


class EnclosureOut(ResponseModel):
    """A proven enclosure: the true number is within value ± radius."""

    value: str = Field(description="Middle, a decimal.")
    radius: str = Field(description="Proven bound of the distance from it, a decimal ≥ 0.")


class WindowOut(ResponseModel):
    """The part of the curve on which the motion takes place."""

    index: int = Field(description="Its number among the windows of the curve, from 0.")
    ends: tuple[str, str] = Field(
        description="What the motion does at the smallest and the largest |g1|: "
        + ", ".join(f"`{end}`: {words}" for end, words in ENDS_IN_WORDS.items())
        + "."
    )
    g1: tuple[float, float] = Field(description="g1, with its sign, at the two ends.")
    g2: tuple[float, float] = Field(description="Smallest and largest g2 of the northern arc.")


class AsymptoteOut(ResponseModel):
    """The limit of an aperiodic motion."""

    kind: Literal["equilibrium", "pole", "collision"] = Field(description="Kind of the limit.")
    time: EstimateOut | None = Field(description="Time at which it is reached; null if only in the limit.")
    rate: EstimateOut | None = Field(
        description="The distance decays like exp(-rate |t|), if it is exponential."
    )
    gamma: tuple[float, float, float] = Field(description="g1, g2, g3 at the limit.")


class AsymptotesOut(ResponseModel):
    """The states that an aperiodic motion comes from and goes to."""

    past: AsymptoteOut = Field(description="Where it comes from, backwards in time.")
    future: AsymptoteOut = Field(description="Where it goes.")


class DriftOut(ResponseModel):
    """The largest deviation of an integral from its value, over the requested samples."""

    drift: float = Field(description="Largest absolute departure.")


class EnclosedIntegralOut(ResponseModel):
    """An integral in the tier certified."""

    value: EnclosureOut = Field(description="Its proven value, of the exact state.")
    drift: float = Field(description="Largest absolute departure of the samples in doubles.")


class FurtherIntegralOut(ResponseModel):
    """A further integral, which bodies with A = B = 2C or 4C may have.

    For A = B = 2C it is `kovalevskaya` or `goriachev`, for A = B = 4C `goriachev_chaplygin`.
    """

    value: float = Field(description="At the first sample.")
    drift: float = Field(description="Largest absolute departure from it over the asked samples.")
    kind: Literal["general", "zero_areas"] = Field(
        description="Constant along every motion, or along those with zero areas integral."
    )


class PrecessionOut(ResponseModel):
    """Growth of the azimuths of two body axes about the space axis in one period.

    Enclosures in the tier certified.
    """

    psi1: EstimateOut | EnclosureOut = Field(description="Of the first principal axis; radians.")
    psi3: EstimateOut | EnclosureOut = Field(description="Of the third principal axis; radians.")


class StabilityOut(ResponseModel):
    """Whether small disturbances leave a periodic motion, or the plane of a planar one."""

    trace: float | EnclosureOut = Field(
        description="μ + 1/μ over the period of the six variables; an enclosure in the tier certified."
    )
    error: float = Field(description="Of the trace, or of the double nearest to an enclosed one.")
    multipliers: tuple[tuple[float, float], tuple[float, float]] = Field(
        description="μ and 1/μ as [real, imaginary]."
    )
    multipliers_error: float = Field(description="Bound of the absolute error of each multiplier.")
    verdict: Literal["stable", "unstable", "marginal"] = Field(
        description="Against leaving its plane the motion is linearly `stable` if |trace| < 2, `unstable` if"
        " > 2, `marginal` if the error does not tell."
    )
    proof: Literal["theorem", "estimate"] | None = Field(
        default=None,
        description="`theorem`: the trace is enclosed by balls, and the verdict with it. Null for solutions"
        " of earlier versions: an estimate.",
    )
    exponent: float = Field(description="Growth per unit time, log|μ| / T.")
    exponent_error: float = Field(description="Bound of the absolute error of the exponent.")
    closed_form_trace: EstimateOut | None = Field(
        description="The trace from Lamé's equation, where it applies: a second, independent value."
    )
    trusted_time: float | None = Field(
        description="Until about this time double precision keeps the problem's tolerance, in the tier"
        " certified that of the tier standard: what roundings grow to stays below it; null if beyond"
        " a million periods. If `error_kind` calls it a theorem: a rounding of the state at the beginning of"
        " every period, carried on by the equations of variation (the equations to first order), stays below"
        " it until this time, by enclosures of what one period and its parts do to neighbours. It does not"
        " bound what an integrator loses in its own steps."
    )


class CrossCheckOut(ResponseModel):
    """Comparison with a second, independent method."""

    method: str = Field(description="The second method.")
    disagreement: float = Field(description="Largest difference in any of the six variables.")
    horizon: float = Field(description="Largest |t| that was compared.")
    agrees: bool = Field(description="Whether the difference is within the errors that both claim.")


class GroupErrorOut(ResponseModel):
    """The error of variables that have one size."""

    absolute: float = Field(description="Largest absolute error of any of them over the asked times.")
    relative: float | None = Field(
        description="The same relative to their largest absolute value there; null where all of them are 0."
    )


class CostOut(ResponseModel):
    """Cost of the computation."""

    compute_seconds: float = Field(description="Seconds of the worker's clock.")
    examination_seconds: float | None = Field(
        default=None,
        description="Seconds that potential and motion were examined before the job was queued; next to"
        " nothing where the result of an earlier examination was kept. Null for motions from a state, which"
        " need none, and for solutions of earlier versions.",
    )


class ProvenanceOut(ResponseModel):
    """Version, numerics and machine that computed the solution."""

    version: str = Field(description="Of polhode.")
    numerics: int = Field(description="Numerics version: raised whenever a digit may change.")
    processor: str | None = Field(
        default=None,
        description="Architecture of the processor and the features that libraries choose their"
        " instructions by. Solutions of one problem have the same bits if all of their provenance is equal,"
        " else the same numbers within their errors. Null for solutions of earlier versions.",
    )
    libraries: str | None = Field(
        default=None, description="Versions of the libraries that computed; null like `processor`."
    )
    threads: int | None = Field(
        default=None,
        description="Threads among which products of matrices may have been divided: their last digits may"
        " depend on it; workers set 1. Null like `processor`, and where the library does not tell.",
    )
    way: Literal["compiled", "plain"] | None = Field(
        default=None,
        description="`compiled`: by kernels; `plain`: without them, since their code was not ready yet. Both"
        " keep the promises of the tier. Null for solutions of earlier versions: by kernels.",
    )


class SolutionOut(ResponseModel):
    """A solution without its arrays."""

    id: str = Field(description="Of the solution, a UUID.")
    job: str = Field(description="The job that computed it; later jobs may have reused it.")
    problem: dict[str, object] = Field(description="The document that was solved, as `ProblemIn`.")
    method: Literal["quadrature", "integration"] = Field(description="Method that computed the samples.")
    tier: str = Field(description="The tier of accuracy that computed them.")
    period: EstimateOut | EnclosureOut | None = Field(
        description="Of all six variables; an enclosure in the tier certified; null if not periodic or not"
        " known."
    )
    aperiodic: Literal["separatrix", "equilibrium", "collision", "pole"] | None = Field(
        description="Why a planar motion has no period."
    )
    asymptotes: AsymptotesOut | None = Field(description="Of an aperiodic motion.")
    energy: EstimateOut | EnclosureOut = Field(
        description="h, in the unit of moments over squared times; an enclosure in the tier certified."
    )
    window: WindowOut | None = Field(description="Of a planar motion.")
    invariants: dict[str, FurtherIntegralOut | EnclosedIntegralOut | DriftOut] | None = Field(
        description="If the outputs ask for them."
    )
    error: float = Field(description="Largest absolute error of any variable over the asked times.")
    errors: dict[str, GroupErrorOut] | None = Field(
        description="The errors of `omega` (p, q, r) and `gamma` (g1, g2, g3), with the orientation also of"
        " `quaternion`, `psi1` and `psi3`; empty without samples. Null for solutions of earlier"
        " versions."
    )
    error_kind: dict[str, ErrorKind] | None = Field(
        description="How each error is known, by the path of its number in this document: `theorem`: proved"
        " by balls that contain every value; `estimate`: counted rounding by rounding and term by term, but"
        " not proved; `difference`: independent computations were compared. `samples` are the six variables"
        " at the asked times, `function` is the function of time that any others come from, `orientation`"
        " the attitude. Null for solutions of earlier versions."
    )
    cross_check: CrossCheckOut | None = Field(description="With the method `both`.")
    stability: StabilityOut | None = Field(
        description="If the outputs ask for it and the motion is periodic."
    )
    precession: PrecessionOut | None = Field(
        description="Per period, if the outputs ask for the orientation of a periodic motion."
    )
    warnings: list[NoticeOut] = Field(description="Warnings about the solution; often empty.")
    conventions: list[str] = Field(description="Conventions chosen where the equations leave a choice.")
    known_cases: list[KnownCaseOut] = Field(
        description="Cases with names that the body and the field are; empty for those of earlier versions."
    )
    evidence: dict[str, float | int | str] = Field(
        description="What the solver measured about itself. With a function of time also `defect`, a bound of"
        " what it leaves of the equations of motion, integrated; `drift`, the largest departure of the"
        " energy, the areas integral or γ·γ from its value, between the samples too; `defect_covers`, the"
        " share of the time for which the bound is a theorem. No claimed error is below what these show. Of a"
        " classical case also `A`, `B`, `C`, the doubles nearest to the moments, some of which may follow"
        " from the case."
    )
    cost: CostOut = Field(description="Time of the computation.")
    provenance: ProvenanceOut = Field(description="Version, numerics and machine.")
    labels: dict[str, str] = Field(description="Its labels: values by their keys.")
    note: str | None = Field(description="What somebody wrote on it.")
    created_at: datetime = Field(description="When it was stored, UTC.")


class SolutionPageOut(PageOut[SolutionOut | Columns]):
    """Some of the solutions that match."""


class TrajectoryOut(ResponseModel):
    """Samples of a solution."""

    columns: dict[str, list[float]] = Field(
        description="Equally long columns by name: t, p, q, r, g1, g2, g3; with the orientation also"
        " q0, q1, q2, q3 (body to space), psi1, psi3. t is rounded to the nearest double; the others belong"
        " to the exact time that was asked."
    )
    error: float = Field(description="Bound of the absolute error of every number.")


class EnclosuresOut(ResponseModel):
    """Proven samples."""

    t: list[float] = Field(description="The times, each rounded to the nearest double.")
    times: list[EnclosureOut] = Field(
        description="Balls that contain the exact times, to which the columns belong: those of the problem;"
        " of times in periods, the multiples of the true period."
    )
    columns: dict[str, list[EnclosureOut]] = Field(
        description="p, q, r, g1, g2, g3; also q0 to q3, psi1 and psi3, if the outputs ask for the"
        " orientation and steps prove it."
    )


class HealthOut(ResponseModel):
    """The process serves."""

    status: Literal["ok"] = Field(description="Always `ok`; a process that is not says so with 503.")
    checks: dict[str, str] = Field(description="The checks, each `ok`; empty for /livez.")


class CompilingOut(ResponseModel):
    """Kernels that are compiled in the background; until they are ready jobs are solved without them."""

    done: int = Field(description="Kernels that are compiled, at the worker that has the fewest.")
    of: int = Field(description="All kernels.")
    seconds: float | None = Field(description="About how many seconds are left; null while nobody knows.")
    waits: str | None = Field(description="Why it has not begun yet; null once it has.")


class ReadinessOut(HealthOut):
    """The service accepts jobs."""

    workers: Literal["warm", "starting", "none"] = Field(
        description="`warm`: some worker computes any job at once, with all code loaded. `starting`: the "
        "workers that are there still load, and compute planar motions already or soon. "
        "`none`: jobs wait until a worker is started."
    )
    compiling: CompilingOut | None = Field(
        default=None,
        exclude_if=lambda compiling: compiling is None,
        description="How far the compiled code is that makes jobs fast; absent when all of it is there.",
    )
    cluster: ClusterOut | None = Field(
        default=None,
        exclude_if=lambda cluster: cluster is None,
        description="The Dask cluster on which workers compute; absent where they do so themselves.",
    )


class TwoDoublesOut(ResponseModel):
    """A number as the sum of two doubles, so that multiples of it cost no digits."""

    hi: float = Field(description="The double nearest to it.")
    lo: float = Field(description="What that leaves.")
    error: float = Field(description="Bound of the absolute error of the sum.")


class MotionFunctionOut(ResponseModel):
    """A motion as a function of time: in each piece a Chebyshev series for each column.

    The piece k maps the times from breaks[k] to breaks[k+1] onto x from -1 to 1; a column's value is the
    sum over n of coefficients[k][n][column] T_n(x).
    """

    columns: list[str] = Field(
        description="p, q, r, g1, g2, g3; with the orientation also psi1, psi3 and local_q0, ..., local_q3:"
        " the quaternion of the time within a period, about the vertical by what psi1 gained in earlier ones."
    )
    breaks: list[float] = Field(
        description="Ends of the pieces, growing; of a periodic motion from 0 to the period."
    )
    coefficients: list[list[list[float]]] = Field(description="By piece, degree and column.")
    period: TwoDoublesOut | None = Field(
        description="Times are reduced by its multiples; null: only times within breaks can be asked."
    )
    error: float = Field(description="Bound of the absolute error within breaks of columns not in errors.")
    errors: dict[str, float] = Field(description="The same for columns that have a bound of their own.")
    advances: dict[str, TwoDoublesOut] = Field(description="What columns that grow gain in each period.")


Records = dict[str, dict[str, object]]
"""Attributes of records, by the identifiers of the records."""

_SOLUTION, _ATTEMPT, _WORKER = (
    "polhode:solution/019f0000",
    "polhode:job/019f0001/attempt/1",
    "polhode:worker/h",
)


class ProvenanceGraphOut(ResponseModel):
    """Entities, activities and agents, and how they are related."""

    prefix: dict[str, str] = Field(
        description="What the prefixes of identifiers stand for.",
        examples=[{"polhode": "urn:polhode:provenance:"}],
    )
    entity: Records = Field(
        description="The problem, the kept result of its examination, the solution.",
        examples=[{_SOLUTION: {"prov:type": "polhode:Solution", "polhode:tier": "standard"}}],
    )
    activity: Records = Field(
        description="The examination, and each attempt at computing the solution.",
        examples=[{_ATTEMPT: {"prov:startTime": "2026-01-02T03:04:05Z", "polhode:numerics": 1}}],
    )
    agent: Records = Field(
        description="Workers, and the software with its versions.",
        examples=[{_WORKER: {"prov:label": "h"}}],
    )
    used: Records = Field(description="What each activity began with.")
    wasGeneratedBy: Records = Field(  # noqa: N815
        description="What each activity made.",
        examples=[{"_:generation1": {"prov:entity": _SOLUTION, "prov:activity": _ATTEMPT}}],
    )
    wasDerivedFrom: Records = Field(description="What each entity was made of.")  # noqa: N815
    wasAssociatedWith: Records = Field(  # noqa: N815
        description="Who or what carried each activity out.",
        examples=[{"_:association1": {"prov:activity": _ATTEMPT, "prov:agent": _WORKER}}],
    )


class DifferenceOut(ResponseModel):
    """The difference of two solutions in one number or column."""

    difference: float | None = Field(
        description="Largest absolute difference; null if one of the numbers is none."
    )
    allowed: float | None = Field(description="Sum of the errors that both claim.")
    share: float | None = Field(
        description="The difference in units of what is allowed, of columns the largest: up to 1 they agree."
        " Null if that is no number: then they do not."
    )


class AuditedOut(ResponseModel):
    """Method, tier, error and provenance of one of the two solutions."""

    method: str = Field(description="The method.")
    tier: str = Field(description="The tier of accuracy.")
    error: float = Field(description="Its claimed error of any variable.")
    provenance: ProvenanceOut | None = Field(description="Version, numerics and machine.")


class ComparisonOut(ResponseModel):
    """The comparison of a stored solution with the new one."""

    identical: bool = Field(description="All stored numbers are the same bits.")
    detail: str = Field(description="The result in words.")
    differences: dict[str, DifferenceOut] = Field(
        description="Of what both have: `period`, `energy`, `trace`, `psi1`, `psi3`, `function` (at 33"
        " times), `samples` (all that are stored). Empty if a stored part cannot be read or is missing."
    )
    stored: AuditedOut = Field(description="The audited solution.")
    found: AuditedOut = Field(description="The new solution.")


class AuditOut(ResponseModel):
    """An audit: a job that solves the problem of a solution again."""

    id: str = Field(description="Of the audit, and of its job: `/v1/jobs/{id}` has its attempts and events.")
    solution: str = Field(description="Id of the audited solution.")
    state: StateName = Field(description="Of the job.")
    verdict: Literal["agrees", "disagrees", "failed"] | None = Field(
        description="`agrees`: within the errors that both claim. `failed`: there is no second solution, see"
        " `error`. Null while the job is live or if it was cancelled."
    )
    found: str | None = Field(description="Id of the new solution, when succeeded.")
    comparison: ComparisonOut | None = Field(description="Of the two solutions, when succeeded.")
    error: dict[str, object] | None = Field(description="Why it failed: `code` and `detail`.")
    problem: dict[str, object] = Field(description="What is solved.")
    created_at: datetime = Field(description="When it was asked for, UTC.")
    finished_at: datetime | None = Field(description="When the job came to its final state.")


class AuditPageOut(PageOut[AuditOut | Columns]):
    """Some audits of a solution, newest first."""
