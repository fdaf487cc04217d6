"""The states of a job, and the table of legal moves between them."""

from enum import StrEnum


class JobKind(StrEnum):
    """Kinds of jobs, by what is computed."""

    SOLVE = "solve"
    """The solution of one problem."""
    CHUNK = "chunk"
    """Some neighbouring points of a sweep."""
    ATLAS = "atlas"
    """All planar motions over a range of λ."""


SUBMITTED = frozenset({JobKind.SOLVE, JobKind.ATLAS})
"""Kinds that clients submit, show, cancel and delete as a job; a chunk is a part of its sweep."""


class JobState(StrEnum):
    """The state of a job."""

    QUEUED = "queued"
    """Waits for a worker."""
    RUNNING = "running"
    """One worker holds its lease."""
    SUCCEEDED = "succeeded"
    """Its solution is in the database."""
    FAILED = "failed"
    """Its error says why."""
    CANCELLED = "cancelled"
    """A client asked for it; what a worker still computes is discarded."""


ALLOWED: dict[JobState, frozenset[JobState]] = {
    JobState.QUEUED: frozenset({JobState.RUNNING, JobState.CANCELLED}),
    JobState.RUNNING: frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED, JobState.QUEUED}),
    JobState.SUCCEEDED: frozenset(),
    JobState.FAILED: frozenset(),
    JobState.CANCELLED: frozenset(),
}
"""The only legal moves. RUNNING returns to QUEUED when its worker is lost or stops."""

FINISHED: frozenset[JobState] = frozenset(state for state, moves in ALLOWED.items() if not moves)
"""Final states."""


def sources(target: JobState) -> tuple[JobState, ...]:
    """Return the states from which ``target`` may be reached; every UPDATE of a state checks them."""
    return tuple(state for state, moves in ALLOWED.items() if target in moves)


class AttemptOutcome(StrEnum):
    """The ways in which an attempt at a job can end."""

    SUCCEEDED = "succeeded"
    FAILED = "failed"
    """The computation failed, or reached its limit of time or memory: a retry would end the same way."""
    LOST = "lost"
    """The child died that computed it, or the whole worker, which had only this one; only this is counted."""
    RETURNED = "returned"
    """It went back to the queue, and may not have begun: its worker was asked to stop, a job that it took
    together took long, or the worker died, which had it with others. After a death it is computed alone."""
    CANCELLED = "cancelled"


def after_loss(losses: int, max_attempts: int) -> JobState:
    """Return the next state of a job that has lost ``losses`` workers, this one included."""
    return JobState.QUEUED if losses < max_attempts else JobState.FAILED


MOST_DOUBTS = 8
"""How often a job is returned from lost workers without being counted, since they had others beside it.

Jobs in other children of a worker may be to blame. A limit, since a worker may never have only this one.
"""
LONGEST_PAUSE_SECONDS = 60.0
JITTER = 0.2
"""Random fraction added to a pause, so that jobs lost together do not come back together."""


def pause_after(losses: int, first_seconds: float, spread: float) -> float:
    """Return how long a job waits that has lost ``losses`` workers: twice as long each time.

    The first time it does not wait: the worker may have been killed for any reason.
    ``spread`` is a random number from -1 to 1.
    """
    if losses < 2:
        return 0.0
    # The exponent is bounded: 2**losses could be too large for a double.
    pause = min(first_seconds * 2.0 ** min(losses - 2, 60), LONGEST_PAUSE_SECONDS)
    return pause * (1.0 + JITTER * spread)
