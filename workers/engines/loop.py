"""The loop around a runner: it wakes by bells, and looks now and then."""

import contextlib
import logging
import selectors
import socket
import time
from typing import Protocol

from service.jobs.wakeup import WorkerLine
from service.storage.availability import is_away
from workers.engines.presence import Presence
from workers.runner import WATCH_SECONDS, Runner

logger = logging.getLogger(__name__)

_AWAY_SECONDS = 0.5
"""Until a database that is away is tried again."""


class Waker:
    """Ends the wait of the engine's loop, from other threads and from signal handlers."""

    def __init__(self) -> None:
        self._hear, self._ring = socket.socketpair()
        self._hear.setblocking(False)
        self._ring.setblocking(False)

    def __call__(self) -> None:
        """Wake the loop. A full buffer has woken it already; a closed one has nobody to wake."""
        with contextlib.suppress(OSError):
            self._ring.send(b".")

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._hear.fileno()

    def clear(self) -> None:
        """Forget what has been rung."""
        with contextlib.suppress(BlockingIOError):
            self._hear.recv(4096)

    def close(self) -> None:
        """Close both ends."""
        self._hear.close()
        self._ring.close()


class Announcements(Protocol):
    """Says that jobs were delivered."""

    def listen(self) -> None:
        """Begin to listen, if it is not done already."""
        ...

    def fileno(self) -> int:
        """Return the descriptor to select on; negative as long as nobody listens."""
        ...

    def clear(self) -> None:
        """Forget what has been said."""
        ...


class EngineLoop:
    """The loop of a worker.

    Parameters
    ----------
    runner, presence
        What does the work, and what says that it is there.
    waker
        The runner's ``wake``.
    line
        The bell of the API on this machine, if there is one. When it goes, the engine stops.
    announcements
        Of jobs from elsewhere, if anybody makes them.
    poll_seconds
        How often to look for jobs that nobody announced.
    grace_seconds
        How long running jobs may still finish after :meth:`stop`; then they are given back.
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
        """Claim nothing more; may be called from anywhere, also twice."""
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
                    # Once: it may stay away for hours, and is tried twice a second.
                    logger.exception("the database is away; trying again until it is back")
                self._is_away = True
                time.sleep(_AWAY_SECONDS)
            else:
                if self._is_away:
                    logger.warning("the database is back")
                self._is_away = False
                self._wait()
        try:
            self._runner.give_back()
        except Exception as fault:
            if not is_away(fault):
                raise
            logger.warning("the database is away: what was running comes back when its leases end")

    def _turn(self) -> None:
        """Do whatever there is to do, the finished jobs first: somebody waits for them."""
        self._tell(self._runner.collect(refill=self._stop_by is None))
        self._runner.keep_leases()
        self._presence.keep()
        if self._stop_by is None:
            if self._announcements is not None:
                # Before the look: what is delivered after it will be heard.
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
            logger.info("the service has gone, stopping")
            self._line.close()
            self.stop()
