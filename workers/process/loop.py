"""The main loop of a worker: runs jobs when woken, and polls at intervals."""

import contextlib
import logging
import selectors
import socket
import time
from typing import Protocol

from service.local.wakeup import WorkerLine
from service.storage.database.availability import is_away
from workers.process.presence import Presence
from workers.process.runner import WATCH_SECONDS, Runner

logger = logging.getLogger(__name__)

_AWAY_SECONDS = 0.5
"""Seconds between attempts while the database is unreachable."""


class Waker:
    """Wakes the worker loop, from other threads and from signal handlers."""

    def __init__(self) -> None:
        self._hear, self._ring = socket.socketpair()
        self._hear.setblocking(False)
        self._ring.setblocking(False)

    def __call__(self) -> None:
        """Wake the loop. If the buffer is full, it has been woken already; if it is closed, it has ended."""
        with contextlib.suppress(OSError):
            self._ring.send(b".")

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._hear.fileno()

    def clear(self) -> None:
        """Discard pending wake-ups."""
        with contextlib.suppress(BlockingIOError):
            self._hear.recv(4096)

    def close(self) -> None:
        """Close both ends."""
        self._hear.close()
        self._ring.close()


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
        poll_seconds: float,
        grace_seconds: float,
    ) -> None:
        self._runner = runner
        self._presence = presence
        self._waker = waker
        self._line = line
        self._announcements = announcements
        self._poll_seconds = poll_seconds
        self._grace_seconds = grace_seconds
        self._stop_by: float | None = None
        self._is_away = False

    def stop(self) -> None:
        """Claim nothing more; safe from any thread or signal handler, also repeatedly."""
        if self._stop_by is None:
            self._stop_by = time.monotonic() + self._grace_seconds
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
                    # Logged once: an outage may last for hours, with two attempts a second.
                    logger.exception("the database cannot be reached; trying again until it can")
                self._is_away = True
                time.sleep(_AWAY_SECONDS)
            else:
                if self._is_away:
                    logger.warning("the database can be reached again")
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
        self._presence.keep()
        if self._stop_by is None:
            if self._announcements is not None:
                # Listen before looking, so that no later delivery is missed.
                self._announcements.listen()
            self._runner.reconcile()
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
