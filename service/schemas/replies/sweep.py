"""The answers of /v1/sweeps, and those of facets and statistics."""

from datetime import datetime
from typing import Literal

from pydantic import Field

from service.schemas.replies.response_model import Columns, PageOut, ResponseModel
from service.schemas.replies.solution import ProvenanceOut
from service.schemas.replies.summary import StateName


class SweepStateOut(ResponseModel):
    """A sweep without its document."""

    id: str = Field(description="Of the sweep, a UUID; later sweeps have larger ones.")
    state: StateName = Field(
        description="Never `failed`: a point that cannot be computed has a reason as its outcome."
    )
    points: int = Field(description="Number of its points.")
    done: int = Field(description="Points that are stored, the refused ones among them.")
    refused: int = Field(description="Points without a solution, whose outcome is a reason.")
    progress: float = Field(description="done / points.")
    point_seconds: float | None = Field(
        description="Seconds of computing a point took in the chunk stored last."
    )
    remaining_seconds: float | None = Field(
        description="Estimated time to the end at the speed of the latest chunks; null if too few have ended."
    )
    priority: int = Field(description="Larger first.")
    labels: dict[str, str] = Field(description="Its labels: values by their keys.")
    note: str | None = Field(description="What somebody wrote on it.")
    created_at: datetime = Field(description="When it was submitted, UTC.")
    started_at: datetime | None = Field(description="When a worker took its first points.")
    finished_at: datetime | None = Field(description="When it came to its final state.")
    way: Literal["compiled", "plain"] | None = Field(
        description="How all of its points are computed: by kernels, or without them since it is sooner done"
        " so than these are compiled. Chosen when a worker takes its first points; null until then. A sweep"
        " that is `compiled` waits for kernels that are not ready; `/readyz` shows how far they are. A"
        " `plain` one with a point that only kernels may solve becomes `compiled`, and begins again."
    )


class SweepProvenanceOut(ProvenanceOut):
    """Version, numerics and machine that computed some points of a sweep, and the hosts that are so."""

    hosts: list[str] = Field(description="Their names, in the order in which they brought a first chunk.")


class SweepOut(SweepStateOut):
    """One sweep."""

    document: dict[str, object] = Field(description="The document as it was sent.")
    provenances: list[SweepProvenanceOut] = Field(
        description="What has computed its points. One: they have the bits of single jobs there. Several: the"
        " hosts are unlike, and last digits may depend on which of them computed a point, within the claimed"
        " errors. Chunks of earlier versions have none."
    )


class SweepPageOut(PageOut[SweepStateOut | Columns]):
    """Some sweeps, newest first."""


class PointPageOut(PageOut[dict[str, object]]):
    """Some of the computed points."""

    items: list[dict[str, object]] = Field(
        description="One object a point: `index`, a number for each axis by its pointer and for each kept"
        " number (null if the point has none), `outcome` (`solved` or a code), and the series as lists."
    )
    total: int | None = Field(
        description="Number of computed points that match; null with `after`, unless `count=exact`."
    )
    points: int = Field(description="Of the whole sweep.")
    done: int = Field(description="Points computed so far; the others are missing here.")


class GridAxisOut(ResponseModel):
    """One of the axes of a matrix."""

    pointer: str = Field(description="The number that varies along it.")
    values: list[float] = Field(description="Its values, as doubles.")


class GridPlaceOut(ResponseModel):
    """A place on an axis that is neither rows nor columns."""

    pointer: str = Field(description="The number that is held there.")
    index: int = Field(description="The place, from 0.")
    value: float = Field(description="The number there, as a double.")


class GridOut(ResponseModel):
    """A kept number of a sweep as a matrix."""

    of: str = Field(description="The name of the number.")
    axes: list[GridAxisOut] = Field(
        description="That of the rows and that of the columns; of a single axis that of the columns."
    )
    at: list[GridPlaceOut] = Field(description="The places on the other axes.")
    indices: list[int] = Field(
        description="Of the points: [first, step from row to row, step from column to column]."
    )
    rows: list[list[float | None]] = Field(description="The numbers; null where a point has none.")
    outcomes: list[list[str | None]] = Field(
        description="`solved`, or the code of the reason; null where a point is not computed yet."
    )
    points: int = Field(description="Of the matrix.")
    done: int = Field(description="Points of the matrix that are computed so far.")


class FacetValueOut(ResponseModel):
    """One value of a fact."""

    value: float | str | bool | None = Field(description="The value; null for what has none.")
    count: int = Field(description="How often it occurs.")


class FacetOut(ResponseModel):
    """The values of a fact."""

    by: str = Field(description="The fact.")
    values: list[FacetValueOut] = Field(description="The most frequent first.")
    others: int = Field(description="How many have a value that is not listed.")


class FacetsOut(ResponseModel):
    """Counts of the values of some facts."""

    facets: list[FacetOut] = Field(description="In the order that was asked for.")


class HistogramOut(ResponseModel):
    """Numbers counted in equally wide bins."""

    edges: list[float] = Field(
        description="Ends of the bins: each goes from one up to the next without it, the last one with it."
    )
    counts: list[int] = Field(description="Numbers in each bin; one fewer than edges.")


class StatisticOut(ResponseModel):
    """A number, over all that matches or over a group of it."""

    of: str = Field(description="The number.")
    group: float | str | bool | None = Field(
        description="The value of `by`; null without `by`, or where there is no value."
    )
    rows: int = Field(description="How many match, with or without the number.")
    count: int = Field(description="How many have the number.")
    min: float | None = Field(description="The smallest; null if none has the number.")
    quartiles: tuple[float, float, float] | None = Field(
        description="The smallest numbers that a quarter, half and three quarters of them do not exceed."
    )
    max: float | None = Field(description="The largest; null if none has the number.")
    histogram: HistogramOut | None = Field(description="With `bins`.")


class StatisticsOut(ResponseModel):
    """Statistics of some numbers."""

    items: list[StatisticOut] = Field(description="Each number, group by group, the largest group first.")


class SlowPart(ResponseModel):
    """A part of a query that takes long over many rows."""

    pointer: str = Field(description="The parameter.")
    why: str = Field(description="The reason, in words.")


class QueryEstimateOut(ResponseModel):
    """The parts of a query that take long, without its answer."""

    slow: list[SlowPart] = Field(
        description="Empty where no part is known to be slow, whatever the number of rows; a condition on a"
        " number of the problem without a column that very many rows meet may still take seconds."
    )
    seconds: float = Field(description="After so long a query is stopped.")


class RefusedItemOut(ResponseModel):
    """A problem of a list that would be refused."""

    index: int = Field(description="Its place in the list, from 0.")
    problem: dict[str, object] = Field(description="The problem document that it would be refused with.")


class CostEstimateOut(ResponseModel):
    """The expected cost of a sweep, a problem or a list, of which nothing is computed or stored."""

    points: int = Field(description="Points of the sweep; problems that would be queued.")
    tier: str | None = Field(description="Tier that computes them; null for a list with several.")
    seconds: float = Field(
        description="Seconds of one worker: two need half of them. An estimate, no bound: for usual documents"
        " within a factor of three."
    )
    bytes: int = Field(description="Stored bytes, about.")
    slow: list[SlowPart] = Field(description="The parts of the document that make it slow; 20 at most.")
    ready_in: float | None = Field(
        description="Seconds until all kernels are compiled, which the estimate takes for granted; null where"
        " nothing is compiled, or nobody knows yet."
    )
    refused: list[RefusedItemOut] = Field(description="The problems of a list that would be refused.")
