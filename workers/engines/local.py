"""The engine for one machine: it wakes by a bell from the API, and looks now and then.

Nobody delivers ids here: the runner claims the oldest job of the table.
"""

import contextlib
import logging
import os
import selectors
import signal
import socket
import time
from types import FrameType

from sqlalchemy.exc import OperationalError

from service.jobs.wakeup import WorkerLine
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database import Database
from service.storage.job_store import SqlJobStore
from workers.runner import Computation, Limits, Runner

logger = logging.getLogger(__name__)

_WATCH_SECONDS = 0.3
"""How often cancellations are looked for while a job runs."""


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


class LocalEngine:
    """The loop around a runner.

    Parameters
    ----------
    runner
        What does the work.
    waker
        The runner's ``wake``.
    line
        The bell of the API on this machine, if there is one. When it goes, the engine stops.
    poll_seconds
        How often to look for jobs that nobody announced.
    grace_seconds
        How long running jobs may still finish after :meth:`stop`; then they are given back.
    """

    def __init__(
        self,
        runner: Runner,
        waker: Waker,
        line: WorkerLine | None,
        *,
        poll_seconds: float,
        grace_seconds: float,
    ) -> None:
        self._runner = runner
        self._waker = waker
        self._line = line
        self._poll_seconds = poll_seconds
        self._grace_seconds = grace_seconds
        self._stop_by: float | None = None

    def stop(self) -> None:
        """Claim nothing more; may be called from anywhere, also twice."""
        if self._stop_by is None:
            self._stop_by = time.monotonic() + self._grace_seconds
        self._waker()

    def run(self) -> None:
        """Work until stopped."""
        with selectors.DefaultSelector() as selector:
            selector.register(self._waker, selectors.EVENT_READ)
            if self._line is not None:
                selector.register(self._line, selectors.EVENT_READ)
            while not self._is_over():
                try:
                    self._turn()
                except OperationalError:
                    logger.exception("the database is away; trying again")
                    time.sleep(self._poll_seconds)
                else:
                    self._wait(selector)
        self._runner.give_back()

    def _turn(self) -> None:
        """Do whatever there is to do, the finished jobs first: somebody waits for them."""
        self._tell(self._runner.collect())
        self._runner.keep_leases()
        if self._stop_by is None:
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

    def _wait(self, selector: selectors.BaseSelector) -> None:
        if self._is_over():
            return
        timeout = min(self._poll_seconds, _WATCH_SECONDS) if self._runner.is_busy else self._poll_seconds
        for key, _ in selector.select(timeout):
            if key.fileobj is self._waker:
                self._waker.clear()
            elif self._line is not None and not self._line.is_open():
                logger.info("the service has gone, stopping")
                selector.unregister(self._line)
                self.stop()


def run_worker(computation: Computation, settings: Settings, *, slots: int, wake_fd: int | None) -> None:
    """Run one worker in this process until SIGTERM, SIGINT, or the end of the service that started it.

    ``wake_fd`` is the descriptor of a line from :class:`service.jobs.wakeup.Doorbell`.
    """
    # Slots share the cores already; and the stacks of idle threads would count as a job's memory.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    limits = Limits(
        lease_seconds=settings.lease_seconds,
        job_seconds=settings.job_seconds,
        memory_mb=settings.job_memory_mb,
        max_attempts=settings.max_attempts,
    )
    database = Database(settings.database_url)
    sandbox = Sandbox(slots, memory_mb=settings.job_memory_mb, preload=[computation.__module__])
    waker = Waker()
    line = None if wake_fd is None else WorkerLine(wake_fd)
    runner = Runner(SqlJobStore(database), sandbox, computation, slots=slots, limits=limits, wake=waker)
    engine = LocalEngine(
        runner, waker, line, poll_seconds=settings.poll_seconds, grace_seconds=settings.grace_seconds
    )

    def stop(number: int, frame: FrameType | None) -> None:
        engine.stop()

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    try:
        sandbox.start()
        logger.info("worker %s with %d slots", runner.name, slots)
        engine.run()
    finally:
        sandbox.close()
        database.close()
