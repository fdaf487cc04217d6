"""A sweep as it is stored, and what can be wrong with a request about one."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from service.jobs.states import JobState

POINTS_PER_JOB = 100
"""Points that a sweep has left count as one queued job by so many: they take about as long."""


def queued_as(points: int) -> int:
    """Return as how many queued jobs ``points`` of a sweep count."""
    return -(-points // POINTS_PER_JOB)


@dataclass(frozen=True, slots=True)
class SweepProgress:
    """How far a sweep has come. Instants are UTC by the database's clock."""

    id: str
    state: JobState
    """Never ``failed``: a point that cannot be computed is a point with a reason."""
    points: int
    done: int
    """Points that are stored, the refused ones among them."""
    refused: int
    point_seconds: float | None
    """Seconds of computing a point took in the chunk that was stored last."""
    remaining_seconds: float | None
    """Until the end, if it goes on as lately; None if it does not run, or too little has been seen."""
    priority: int
    key_id: str | None
    """Whose key submitted it."""
    created_at: datetime
    started_at: datetime | None
    """When the first chunk was taken."""
    finished_at: datetime | None


@dataclass(frozen=True, slots=True)
class SweepRecord(SweepProgress):
    """One sweep."""

    document: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class SweepPage:
    """Some sweeps without their documents, newest first, and how many there are in all."""

    sweeps: tuple[SweepProgress, ...]
    total: int


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
