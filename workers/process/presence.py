"""Keeps a presence row in the database while this worker is alive."""

import contextlib
import time

from sqlalchemy.exc import SQLAlchemyError

from service.local.hosts import WorkerProcess
from service.storage.jobs.worker_registry import WorkerRegistry


class Presence:
    """The presence row of one worker.

    Parameters
    ----------
    seconds
        How often it is renewed.
    """

    def __init__(self, registry: WorkerRegistry, worker: WorkerProcess, *, seconds: float) -> None:
        self._registry = registry
        self._worker = worker
        self._seconds = seconds
        self._is_warm = False
        self._due_at = 0.0

    def begin(self, *, alone: bool) -> None:
        """Insert the row; ``alone`` raises :class:`~service.local.hosts.OtherHostError` for another host."""
        self._registry.enter(self._worker, alone=alone)
        self._due_at = time.monotonic() + self._seconds

    def keep(self, *, is_warm: bool) -> None:
        """Renew the row if it is time, or if it is news that this worker is warm."""
        if self.seconds_left() == 0.0 or is_warm is not self._is_warm:
            self._registry.see(self._worker, is_warm=is_warm)
            self._is_warm = is_warm
            self._due_at = time.monotonic() + self._seconds

    def seconds_left(self) -> float:
        """Return how long :meth:`keep` has nothing to do."""
        return max(0.0, self._due_at - time.monotonic())

    def end(self) -> None:
        """Remove the row; if the database is unreachable, the row expires later."""
        with contextlib.suppress(SQLAlchemyError):
            self._registry.leave(self._worker)
