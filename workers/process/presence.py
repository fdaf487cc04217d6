"""Keeps a presence row in the database while this worker is alive."""

import contextlib
import logging
import time

from sqlalchemy.exc import SQLAlchemyError

from service.jobs.kernels import Kernels, Outlook
from service.local.hosts import WorkerProcess
from service.storage.jobs.worker_registry import WorkerRegistry

logger = logging.getLogger(__name__)


class Presence:
    """The presence row of one worker.

    Parameters
    ----------
    seconds
        How often it is renewed.
    alone
        Whether a worker of another host refuses this one.
    """

    def __init__(
        self, registry: WorkerRegistry, worker: WorkerProcess, *, seconds: float, alone: bool
    ) -> None:
        self._registry = registry
        self._worker = worker
        self._seconds = seconds
        self._alone = alone
        self._has_entered = False
        self._is_warm = False
        self._kernels: Kernels | None = None
        self._due_at = 0.0

    def keep(self, *, is_warm: bool, kernels: Kernels | None) -> None:
        """Renew the row if it is time, or if it is news that this worker is warm, or how far kernels are.

        The first time raises what :meth:`~service.storage.jobs.worker_registry.WorkerRegistry.enter` raises.
        """
        if not self._has_entered:
            self._registry.enter(self._worker, alone=self._alone)
            self._has_entered = True
            logger.info("worker %s with %d slots", self._worker.name, self._worker.slots)
            self._due_at = time.monotonic() + self._seconds
        if self.seconds_left() == 0.0 or is_warm is not self._is_warm or kernels != self._kernels:
            self._registry.see(self._worker, is_warm=is_warm, kernels=kernels)
            self._is_warm, self._kernels = is_warm, kernels
            self._due_at = time.monotonic() + self._seconds

    def outlook(self) -> Outlook:
        """Tell whether kernels are there, or will be, here or at another worker that shares the queue."""
        if self._kernels is None:
            return "there"
        is_in_vain = self._kernels.fault is not None and not self._registry.may_have_kernels()
        return "never" if is_in_vain else "coming"

    def seconds_left(self) -> float:
        """Return how long :meth:`keep` has nothing to do."""
        return max(0.0, self._due_at - time.monotonic())

    def end(self) -> None:
        """Remove the row; if the database is unreachable, the row expires later."""
        with contextlib.suppress(SQLAlchemyError):
            self._registry.leave(self._worker)
