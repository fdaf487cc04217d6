"""Starts the children that compute verdicts, beside what else a service does at its start."""

import threading

from service.sandbox import Sandbox
from service.settings import Settings

VERDICT_WORKERS = 3
"""Child processes that compute verdicts; lists together, and each key, leave one of them free for others."""


class VerdictChildren:
    """The child processes that compute verdicts: they start at once, and :meth:`ready` waits for them.

    Their fork server loads the mathematics for a second. A service uses that second to load itself.
    """

    def __init__(self, settings: Settings) -> None:
        self._sandbox = Sandbox(
            VERDICT_WORKERS, memory_mb=settings.job_memory_mb, preload=("service.verdicts.formulas",)
        )
        self._starting = threading.Thread(target=self._sandbox.start, name="start of verdicts", daemon=True)
        self._starting.start()

    def ready(self) -> Sandbox:
        """Return the children when they are there."""
        self._starting.join()
        return self._sandbox

    def close(self) -> None:
        """Kill the children, also those that still start."""
        self._sandbox.close()
