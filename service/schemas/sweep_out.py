"""Sweeps and their points, as clients see them."""

from datetime import datetime

from pydantic import Field

from service.schemas.job import StateName
from service.schemas.verdict import ResponseModel


class SweepStateOut(ResponseModel):
    """A sweep without its document."""

    id: str = Field(description="Of the sweep, a UUID; later sweeps have larger ones.")
    state: StateName = Field(
        description="Never `failed`: a point that cannot be computed is a point with a reason."
    )
    points: int = Field(description="Number of its points.")
    done: int = Field(description="Points that are stored, the refused ones among them.")
    refused: int = Field(description="Points that have a reason in place of a motion.")
    progress: float = Field(description="done / points.")
    point_seconds: float | None = Field(
        description="Seconds of computing a point took in the chunk stored last."
    )
    remaining_seconds: float | None = Field(
        description="Until the end, if it goes on as its latest chunks did; null if too little has been seen."
    )
    priority: int = Field(description="Larger first.")
    created_at: datetime = Field(description="When it was submitted, UTC.")
    started_at: datetime | None = Field(description="When a worker took its first points.")
    finished_at: datetime | None = Field(description="When it came to its final state.")


class SweepOut(SweepStateOut):
    """One sweep."""

    document: dict[str, object] = Field(description="The document as it was sent.")


class SweepPageOut(ResponseModel):
    """Some sweeps, newest first."""

    items: list[SweepStateOut] = Field(description="The sweeps, newest first.")
    total: int = Field(description="Sweeps that match in all.")
    limit: int = Field(description="Items on a page at most.")
    offset: int = Field(description="Items left out before this page.")


class PointPageOut(ResponseModel):
    """Some of the points that are done."""

    items: list[dict[str, object]] = Field(
        description="One object a point: `index`, a number for each axis by its pointer and for each kept"
        " number (null if the point has none), `outcome` (`solved` or a code), and the series as lists."
    )
    total: int = Field(description="Points that are done and match in all.")
    limit: int = Field(description="Items on a page at most.")
    offset: int = Field(description="Items left out before this page.")
    points: int = Field(description="Of the whole sweep.")
    done: int = Field(description="Points that are done; the others are missing here.")
