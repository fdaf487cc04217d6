"""Starts, restarts and stops the worker process that a service runs on its own machine."""

import logging
import subprocess
import threading
import time
from collections.abc import Callable

from service.local.restarts import Restarts, WorkerStanding
from service.local.wakeup import Doorbell
from service.local.worker_command import worker_command, worker_environment
from service.settings import Settings

logger = logging.getLogger(__name__)


class LocalWorkers:
    """The worker process of a service: started, started again if it dies, stopped at the end.

    It has a session of its own, so that Ctrl-C in a terminal reaches only the
    service, which then shuts it down. If the service is killed, the worker sees
    its wake-up socket closed, and stops.

    Raises
    ------
    OSError
        The system cannot start the first process.
    """

    def __init__(self, settings: Settings, doorbell: Doorbell) -> None:
        self._settings = settings
        self._doorbell = doorbell
        self._stopping = threading.Event()
        self._restarts = Restarts()
        self._last_code: int | None = None
        self._starts_at: float | None = None
        self._has_worked = threading.Event()
        """The process that runs has finished a job, or is warm."""
        self._process = self._start()
        self._keeper = threading.Thread(target=self._keep, name="keeper of workers", daemon=True)
        self._keeper.start()

    def standing(self) -> WorkerStanding:
        """Return whether the process runs, and how often it has died. Thread-safe."""
        starts_at = self._starts_at
        left = None if starts_at is None else max(0.0, starts_at - time.monotonic())
        return WorkerStanding(self._restarts, self._last_code, left)

    def expect_end(self) -> None:
        """Start no other process when this one ends. Safe in a signal handler."""
        self._stopping.set()

    def stop(self, urged: Callable[[Callable[[], None]], None] | None = None) -> None:
        """Let running jobs finish within the grace period, then kill the process if it is still there.

        ``urged`` is given what has the process return its jobs at once.
        """
        self._stopping.set()
        self._process.terminate()
        if urged is not None:
            urged(self._process.terminate)
        self._keeper.join(self._settings.grace_seconds + 5.0)
        if self._keeper.is_alive():
            self._process.kill()
            self._keeper.join()

    def forgo(self) -> None:
        """Let a worker end that was not told yet that it may use the database, without a word of its own."""
        self._stopping.set()
        self._doorbell.close()
        self._keeper.join(self._settings.grace_seconds + 5.0)
        if self._keeper.is_alive():
            self._process.kill()
            self._keeper.join()

    def _start(self) -> "subprocess.Popen[bytes]":
        self._has_worked = threading.Event()
        line = self._doorbell.new_line(self._has_worked.set)
        with line:
            options = ["--slots", str(self._settings.workers), "--wake-fd", str(line.fileno())]
            return subprocess.Popen(
                worker_command("run", *options),
                pass_fds=[line.fileno()],
                env=worker_environment(self._settings),
                start_new_session=True,
            )

    def _keep(self) -> None:
        began = time.monotonic()
        while True:
            code = self._process.wait()
            if self._stopping.is_set() or not self._start_again(code, time.monotonic() - began):
                return
            began = time.monotonic()
            if self._stopping.is_set():
                # It was asked to stop between the check and the start.
                self._process.terminate()

    def _start_again(self, code: int | None, lived_seconds: float) -> bool:
        """Start another process, after a pause if there must be one; return False if it is to stop."""
        while True:
            self._last_code = code
            self._restarts = self._restarts.after_death(lived_seconds, has_worked=self._has_worked.is_set())
            pause = self._restarts.pause_seconds
            self._starts_at = time.monotonic() + pause
            logger.warning("%s", self.standing())
            if self._stopping.wait(pause):
                return False
            try:
                self._process = self._start()
            except OSError as fault:
                # No memory, processes or descriptors left: a later start may succeed.
                logger.warning("the worker process could not be started: %s", fault)
                code, lived_seconds = None, 0.0
            else:
                self._starts_at = None
                return True
