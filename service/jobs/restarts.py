"""When a worker process that ended is started again.

One that had worked is started again at once: its jobs wait for it. One that
dies again and again soon after its start would only burn processor time, so
the pauses grow.
"""

from dataclasses import dataclass

EARLY_SECONDS = 10.0
"""A process that ends sooner than this has died early. A start takes a second, ten on a busy machine."""
FIRST_PAUSE_SECONDS, LONGEST_PAUSE_SECONDS = 0.5, 15.0
"""Before the next start; doubled with each further early death in a row."""


@dataclass(frozen=True, slots=True)
class Restarts:
    """How often a process has ended by itself."""

    deaths: int = 0
    early_deaths: int = 0
    """Those in a row that came early, up to now."""

    def after_death(self, lived_seconds: float) -> "Restarts":
        """Return the counts after another death."""
        is_early = lived_seconds < EARLY_SECONDS
        return Restarts(self.deaths + 1, self.early_deaths + 1 if is_early else 0)

    @property
    def pause_seconds(self) -> float:
        """How long to wait before the next start."""
        if self.early_deaths == 0:
            return 0.0
        # Beyond the longest pause the exact power does not matter, and a float has a largest one.
        return min(FIRST_PAUSE_SECONDS * 2.0 ** min(self.early_deaths - 1, 32), LONGEST_PAUSE_SECONDS)


@dataclass(frozen=True, slots=True)
class WorkerStanding:
    """What is known of the worker process beside a service."""

    restarts: Restarts
    last_code: int | None = None
    """With which its last process ended; negative: the number of a signal. None: it could not be started."""
    seconds_to_start: float | None = None
    """Until it is started again; None while it runs."""

    @property
    def is_running(self) -> bool:
        """It runs, as far as is known."""
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
