"""The limits of one job."""

from dataclasses import dataclass
from typing import TypedDict


class _Retries(TypedDict):
    max_attempts: int
    retry_seconds: float


@dataclass(frozen=True, slots=True)
class JobLimits:
    """Limits of one job, and the length of a lease."""

    lease_seconds: float
    job_seconds: float
    memory_mb: int
    max_attempts: int
    retry_seconds: float

    def retries(self) -> _Retries:
        """Return the limits for lost jobs, for the store."""
        return {"max_attempts": self.max_attempts, "retry_seconds": self.retry_seconds}
