"""The main loop of a worker: runs jobs when woken, and polls at intervals."""

import logging
import selectors
import time
from collections.abc import Callable
from typing import Protocol

from service.jobs.kernels import Kernels
from service.local.wakeup import WARM, WorkerLine
from service.logs import Complaints
from service.storage.database.availability import is_away
from workers.process.presence import Presence
from workers.process.runner import WATCH_SECONDS, Runner
from workers.process.waker import Waker

logger = logging.getLogger(__name__)

_AWAY_SECONDS = 0.5
"""Seconds between attempts while the database is unreachable."""


class Announcements(Protocol):
    """Announces delivered jobs."""

    def listen(self) -> None:
        """Start listening, if not listening already."""
        ...

    def fileno(self) -> int:
        """Return the descriptor to select on; negative while not listening."""
        ...

    def clear(self) -> None:
        """Discard pending announcements."""
        ...


class EngineLoop:
    """The loop of a worker.

    Parameters
    ----------
    runner, presence
        The runner of jobs, and the worker's presence row.
    waker
        The runner's ``wake``.
    line
        The wake-up socket of the service that started this worker, if any. When it closes, the loop stops.
    announcements
        Notifications of delivered jobs, if the engine has them.
    takes_jobs
        Whether jobs may be taken: the children have loaded what planar motions need. Once true it stays true.
    is_warm
        Whether the children have loaded all that jobs need. Once true it stays true.
    kernels
        How far these are compiled; None if there is nothing to compile.
    poll_seconds
        How often to poll for jobs that were not announced.
    grace_seconds
        How long running jobs may still finish after :meth:`stop`; then they are queued again.
    """

    def __init__(
        self,
        runner: Runner,
        presence: Presence,
        waker: Waker,
        *,
        line: WorkerLine | None,
        announcements: Announcements | None,
        takes_jobs: Callable[[], bool],
        is_warm: Callable[[], bool],
        kernels: Callable[[], Kernels | None],
        poll_seconds: float,
        grace_seconds: float,
    ) -> None:
        self._runner = runner
        self._presence = presence
        self._waker = waker
        self._line = line
        self._announcements = announcements
        self._takes_jobs = takes_jobs
        self._is_warm = is_warm
        self._kernels = kernels
        self._poll_seconds = poll_seconds
        self._grace_seconds = grace_seconds
        self._stop_by: float | None = None
        self._is_away = False
        self._complaints = Complaints(logger)
        self._has_told = False

    def stop(self) -> None:
        """Claim nothing more; safe from any thread or signal handler, also repeatedly."""
        if self._stop_by is None:
            self._stop_by = time.monotonic() + self._grace_seconds
        self._waker()

    def stop_at_once(self) -> None:
        """Return running jobs to the queue, instead of waiting for their end; safe as :meth:`stop` is."""
        self._stop_by = time.monotonic()
        self._waker()

    def run(self) -> None:
        """Work until stopped."""
        while not self._is_over():
            try:
                self._turn()
            except Exception as fault:
                if not is_away(fault):
                    raise
                if not self._is_away:
                    # Not at each attempt: an outage may last for hours. Nor at each outage: where only some
                    # writes fail, such as on a full disk, every second turn is one.
                    self._complaints.tell("the database cannot be reached; trying again until it can", fault)
                self._is_away = True
                time.sleep(_AWAY_SECONDS)
            else:
                if self._is_away:
                    self._complaints.tell("the database can be reached again")
                self._is_away = False
                self._wait()
        try:
            self._runner.give_back()
        except Exception as fault:
            if not is_away(fault):
                raise
            logger.warning(
                "the database cannot be reached: running jobs are queued again when their leases end"
            )

    def _turn(self) -> None:
        """Do all pending work, finished jobs first, since clients may wait for them."""
        self._tell(self._runner.collect(refill=self._stop_by is None))
        self._runner.keep_leases()
        # In this order: a worker that is warm takes jobs.
        is_warm = self._is_warm()
        takes_jobs = self._takes_jobs()
        self._presence.keep(is_warm=is_warm, kernels=self._kernels())
        if is_warm and not self._has_told and self._line is not None:
            self._line.tell(WARM)
        self._has_told = is_warm
        if self._stop_by is None:
            if takes_jobs and self._announcements is not None:
                # Listen before looking, so that no later delivery is missed.
                self._announcements.listen()
            self._runner.reconcile()
            if takes_jobs:
                self._tell(self._runner.fill())

    def _tell(self, finished: list[str]) -> None:
        if self._line is not None:
            for job_id in finished:
                self._line.tell(job_id)

    def _is_over(self) -> bool:
        if self._stop_by is None:
            return False
        return not self._runner.is_busy or time.monotonic() >= self._stop_by

    def _wait(self) -> None:
        if self._is_over():
            return
        timeout = min(self._poll_seconds, self._presence.seconds_left())
        if self._runner.is_busy:
            timeout = min(timeout, WATCH_SECONDS)
        with selectors.PollSelector() as selector:
            for bell in (self._waker, self._line, self._announcements):
                if bell is not None and bell.fileno() >= 0:
                    selector.register(bell, selectors.EVENT_READ)
            heard = [key.fileobj for key, _ in selector.select(timeout)]
        if self._waker in heard:
            self._waker.clear()
        if self._announcements in heard and self._announcements is not None:
            self._announcements.clear()
        if self._line in heard and self._line is not None and not self._line.is_open():
            logger.info("the service has ended, stopping")
            self._line.close()
            self.stop()
