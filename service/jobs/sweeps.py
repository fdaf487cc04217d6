"""Records of a stored sweep, and errors of requests about one."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from service.jobs.states import JobState
from service.schemas.query.conditions import Value
from service.schemas.reading.marks import Marks

POINTS_PER_JOB = 100
"""So many unfinished points of a sweep count as one queued job, since they take about as long."""


def queued_as(points: int) -> int:
    """Return the number of queued jobs that ``points`` of a sweep count as."""
    return -(-points // POINTS_PER_JOB)


@dataclass(frozen=True, slots=True)
class SweepProgress:
    """A stored sweep and its progress. Instants are UTC by the database's clock."""

    id: str
    state: JobState
    """Never ``failed``: a point that cannot be computed is a point with a reason."""
    points: int
    done: int
    """Points that are stored, the refused ones among them."""
    refused: int
    point_seconds: float | None
    """Seconds of computing per point, in the chunk that was stored last."""
    remaining_seconds: float | None
    """Estimated seconds to the end; None if the sweep does not run, or too few chunks have ended."""
    priority: int
    key_id: str | None
    """Id of the key that submitted it."""
    created_at: datetime
    started_at: datetime | None
    """When its first chunk was claimed."""
    finished_at: datetime | None
    way: str | None
    """The way to compute all its points, ``compiled`` or ``plain``; None until its first chunk is claimed."""
    marks: Marks


@dataclass(frozen=True, slots=True)
class SweepRecord(SweepProgress):
    """One sweep."""

    document: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class SweepPage:
    """Some sweeps without their documents, in the order that was asked for."""

    sweeps: tuple[SweepProgress, ...]
    total: int | None
    """How many there are in all, if that was wanted."""
    values: tuple[tuple[Value | None, ...], ...] = ()
    """The wanted columns of each, in place of the sweeps."""
    next: tuple[Value | None, ...] | None = None
    """Where the following page begins; None if there is none."""


class SweepNotFoundError(LookupError):
    """There is no sweep of that id."""

    def __init__(self, sweep_id: str) -> None:
        super().__init__(f"there is no sweep {sweep_id}")
        self.sweep_id = sweep_id


class SweepFinishedError(Exception):
    """A sweep that has succeeded cannot be cancelled."""

    def __init__(self, sweep_id: str, state: JobState) -> None:
        super().__init__(
            f"sweep {sweep_id} has already {state}: only queued and running sweeps can be cancelled"
        )
        self.sweep_id, self.state = sweep_id, state
