"""The life of a job is a table."""

from enum import StrEnum


class JobKind(StrEnum):
    """What a job computes."""

    SOLVE = "solve"
    """The solution of one problem."""
    CHUNK = "chunk"
    """Some neighbouring points of a sweep."""


class JobState(StrEnum):
    """Where a job is in its life."""

    QUEUED = "queued"
    """Waits for a worker."""
    RUNNING = "running"
    """One worker holds its lease."""
    SUCCEEDED = "succeeded"
    """Its solution is in the database."""
    FAILED = "failed"
    """Its error says why."""
    CANCELLED = "cancelled"
    """Somebody asked for it; whatever a worker still computes is thrown away."""


ALLOWED: dict[JobState, frozenset[JobState]] = {
    JobState.QUEUED: frozenset({JobState.RUNNING, JobState.CANCELLED}),
    JobState.RUNNING: frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED, JobState.QUEUED}),
    JobState.SUCCEEDED: frozenset(),
    JobState.FAILED: frozenset(),
    JobState.CANCELLED: frozenset(),
}
"""The only legal moves. RUNNING returns to QUEUED when its worker is lost or stops."""

FINISHED: frozenset[JobState] = frozenset(state for state, moves in ALLOWED.items() if not moves)
"""States that nothing leaves."""


def sources(target: JobState) -> tuple[JobState, ...]:
    """Return the states from which ``target`` may be reached: the guard of every stored move."""
    return tuple(state for state, moves in ALLOWED.items() if target in moves)


class AttemptOutcome(StrEnum):
    """How one try at a job ended."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    """The computation itself, or a limit of time or memory: trying again would give the same."""
    LOST = "lost"
    """The child or the whole worker died; only this is tried again, and counted."""
    RETURNED = "returned"
    """The worker was asked to stop and gave the job back."""
    CANCELLED = "cancelled"


def after_loss(losses: int, max_attempts: int) -> JobState:
    """Return where a job goes that has lost ``losses`` workers, this one included."""
    return JobState.QUEUED if losses < max_attempts else JobState.FAILED


LONGEST_PAUSE_SECONDS = 60.0
JITTER = 0.2
"""Part of a pause by which it is shorter or longer, so that jobs lost together do not come back together."""


def pause_after(losses: int, first_seconds: float, spread: float) -> float:
    """Return how long a job waits that has lost ``losses`` workers: twice as long each time.

    ``spread`` is a random number from -1 to 1.
    """
    # The exponent is bounded: 2**losses could be too large for a double.
    pause = min(first_seconds * 2.0 ** min(losses - 1, 60), LONGEST_PAUSE_SECONDS)
    return pause * (1.0 + JITTER * spread)
