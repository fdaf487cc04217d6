"""Decides when a worker process that ended is started again.

A process that ran for a while, or has worked, is restarted at once, since its jobs wait.
One that dies repeatedly before it can work would only waste processor time, so the
pauses grow.
"""

from dataclasses import dataclass

EARLY_SECONDS = 10.0
"""A process that ends sooner than this has died early. A start takes a second, ten on a busy machine."""
FIRST_PAUSE_SECONDS, LONGEST_PAUSE_SECONDS = 0.5, 15.0
"""Before the next start; doubled with each further early death in a row."""


@dataclass(frozen=True, slots=True)
class Restarts:
    """Counts of the times that a process has ended by itself."""

    deaths: int = 0
    early_deaths: int = 0
    """Consecutive early deaths up to now."""

    def after_death(self, lived_seconds: float, *, has_worked: bool) -> "Restarts":
        """Return the counts after another death."""
        is_early = lived_seconds < EARLY_SECONDS and not has_worked
        return Restarts(self.deaths + 1, self.early_deaths + 1 if is_early else 0)

    @property
    def pause_seconds(self) -> float:
        """Seconds to wait before the next start."""
        if self.early_deaths == 0:
            return 0.0
        # Beyond the longest pause the exact power does not matter, and a float has a largest one.
        return min(FIRST_PAUSE_SECONDS * 2.0 ** min(self.early_deaths - 1, 32), LONGEST_PAUSE_SECONDS)


@dataclass(frozen=True, slots=True)
class WorkerStanding:
    """The status of the worker process beside a service."""

    restarts: Restarts
    last_code: int | None = None
    """Exit code of its last process; negative: the number of a signal. None: it could not be started."""
    seconds_to_start: float | None = None
    """Until it is started again; None while it runs."""

    @property
    def is_running(self) -> bool:
        """It runs, or has not failed yet."""
        return self.seconds_to_start is None

    def __str__(self) -> str:
        if self.seconds_to_start is None:
            return "ok"
        ended = "could not be started" if self.last_code is None else f"ended with code {self.last_code}"
        often = f", {self.restarts.early_deaths} times in a row soon after its start"
        return (
            f"the worker process {ended}{often if self.restarts.early_deaths > 1 else ''}; "
            f"it is started again in {self.seconds_to_start:.1f} s"
        )
