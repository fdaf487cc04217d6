"""Starts the children that compute verdicts, beside what else a service does at its start."""

import os
import threading
from multiprocessing import resource_tracker

from service.sandbox import Sandbox
from service.settings import Settings

LEAST_CHILDREN, MOST_CHILDREN = 3, 17


def verdict_children() -> int:
    """Return the number of child processes that compute verdicts.

    There is one for each processor that this process may use, so that lists are examined on all of them, and
    one more, since lists together, and each key, leave one free for others. Each takes 30 MB.
    """
    try:
        processors = len(os.sched_getaffinity(0))
    except AttributeError:  # only Linux has it
        processors = os.cpu_count() or 1
    return min(max(LEAST_CHILDREN, processors + 1), MOST_CHILDREN)


class VerdictChildren:
    """The child processes that compute verdicts: they start at once, and :meth:`ready` waits for them.

    Their fork server loads the mathematics for a second. A service uses that second to load itself.
    """

    def __init__(self, settings: Settings) -> None:
        self._sandbox = Sandbox(
            verdict_children(), memory_mb=settings.job_memory_mb, preload=("service.verdicts.formulas",)
        )
        # After the sandbox, which has Python's helpers import nothing from the working folder.
        _track_quietly()
        self._starting = threading.Thread(target=self._sandbox.start, name="start of verdicts", daemon=True)
        self._starting.start()

    def ready(self) -> Sandbox:
        """Return the children when they are there."""
        self._starting.join()
        return self._sandbox

    def close(self) -> None:
        """Kill the children, also those that still start."""
        self._sandbox.close()


def _track_quietly() -> None:
    """Start the process that removes the semaphores of this one, without its warning.

    A service that is stopped at its start leaves them to it, which is what it is for and worries nobody.
    """
    name = "PYTHONWARNINGS"
    before = os.environ.get(name)
    os.environ[name] = ",".join(filter(None, (before, "ignore:resource_tracker")))
    try:
        resource_tracker.ensure_running()
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
