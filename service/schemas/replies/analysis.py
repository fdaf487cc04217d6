"""The answers of facets and statistics."""

from pydantic import Field

from service.schemas.replies.response_model import ResponseModel


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
