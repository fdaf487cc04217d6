"""A computation that complains, and a worker of its own that writes JSON about it."""

import warnings

from service.jobs.records import JobKind, SolveOutcome
from service.logs import start_logging
from service.settings import Settings
from workers.process.start import run_worker
from workers.process.tasks import WorkerTasks


def complain(document: str) -> SolveOutcome:
    """Warn, then fail."""
    warnings.warn("odd", stacklevel=1)
    raise RuntimeError("a fault of ours")


def run() -> None:
    """Work until stopped."""
    start_logging("json", "info")
    run_worker(WorkerTasks({JobKind.SOLVE: complain}, "complaining:TASKS"), Settings(), slots=1, wake_fd=None)
