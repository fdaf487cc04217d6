"""Sweeps and their points, as clients see them."""

from datetime import datetime

from pydantic import Field

from service.schemas.job import StateName
from service.schemas.verdict import ResponseModel


class SweepStateOut(ResponseModel):
    """A sweep without its document."""

    id: str
    state: StateName = Field(
        description="Never `failed`: a point that cannot be computed is a point with a reason."
    )
    points: int
    done: int = Field(description="Points that are stored, the refused ones among them.")
    refused: int = Field(description="Points that have a reason in place of a motion.")
    progress: float = Field(description="done / points.")
    point_seconds: float | None = Field(
        description="Seconds of computing a point took in the chunk stored last."
    )
    remaining_seconds: float | None = Field(
        description="Until the end, if it goes on as it has since the start; null if that cannot be said."
    )
    priority: int
    created_at: datetime
    started_at: datetime | None
    finished_at: datetime | None


class SweepOut(SweepStateOut):
    """One sweep."""

    document: dict[str, object] = Field(description="The document as it was sent.")


class SweepPageOut(ResponseModel):
    """Some sweeps, newest first."""

    items: list[SweepStateOut]
    total: int = Field(description="Sweeps that match in all.")
    limit: int
    offset: int


class PointPageOut(ResponseModel):
    """Some of the points that are done."""

    items: list[dict[str, object]] = Field(
        description="One object a point: `index`, a number for each axis by its pointer and for each kept"
        " number (null if the point has none), `outcome` (`solved` or a code), and the series as lists."
    )
    total: int = Field(description="Points that are done and match in all.")
    limit: int
    offset: int
    points: int = Field(description="Of the whole sweep.")
    done: int = Field(description="Points that are done; the others are missing here.")
