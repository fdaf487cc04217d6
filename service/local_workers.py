"""The worker process that a service runs beside itself on the same machine."""

import logging
import os
import subprocess
import sys
import threading
import time

from service.jobs.wakeup import Doorbell
from service.settings import Settings

logger = logging.getLogger(__name__)

FIRST_PAUSE_SECONDS, LONGEST_PAUSE_SECONDS = 0.5, 30.0
"""Before a worker process that died is started again; doubled each time it dies young."""


class LocalWorkers:
    """The worker process of a service: started, started again if it dies, stopped at the end.

    It has a session of its own, so that Ctrl-C in a terminal reaches only the
    service, which then stops it in order. If the service is killed, the worker
    hears its bell's line break, and stops.
    """

    def __init__(self, settings: Settings, doorbell: Doorbell) -> None:
        self._settings = settings
        self._doorbell = doorbell
        self._stopping = threading.Event()
        self._process = self._start()
        self._keeper = threading.Thread(target=self._keep, name="keeper of workers", daemon=True)
        self._keeper.start()

    def expect_end(self) -> None:
        """Start no other process when this one ends. Safe in a signal handler."""
        self._stopping.set()

    def stop(self) -> None:
        """Let running jobs finish within the time of grace, then make sure."""
        self._stopping.set()
        self._process.terminate()
        self._keeper.join(self._settings.grace_seconds + 5.0)
        if self._keeper.is_alive():
            self._process.kill()
            self._keeper.join()

    def _start(self) -> "subprocess.Popen[bytes]":
        line = self._doorbell.new_line()
        with line:
            options = ["--slots", str(self._settings.workers), "--wake-fd", str(line.fileno())]
            return subprocess.Popen(
                worker_command("run", *options),
                pass_fds=[line.fileno()],
                env=worker_environment(self._settings),
                start_new_session=True,
            )

    def _keep(self) -> None:
        pause = FIRST_PAUSE_SECONDS
        while True:
            began = time.monotonic()
            code = self._process.wait()
            if self._stopping.is_set():
                return
            if time.monotonic() - began > LONGEST_PAUSE_SECONDS:
                pause = FIRST_PAUSE_SECONDS
            logger.warning("the worker process ended with code %s; starting another in %g s", code, pause)
            if self._stopping.wait(pause):
                return
            pause = min(2.0 * pause, LONGEST_PAUSE_SECONDS)
            self._process = self._start()
            if self._stopping.is_set():
                # It was asked to stop between the check and the start.
                self._process.terminate()


def worker_command(*arguments: str) -> list[str]:
    """Return the command line of a worker. ``-P``: a ``workers.py`` in the working folder is not imported."""
    return [sys.executable, "-P", "-m", "workers", *arguments]


def worker_environment(settings: Settings) -> dict[str, str]:
    """Return a worker's environment. Options are seen by other users, and a URL may hold a password."""
    log = {"POLHODE_LOG_FORMAT": settings.log_format, "POLHODE_LOG_LEVEL": settings.log_level}
    chosen = {name: value for name, value in log.items() if value is not None}
    return {**os.environ, "POLHODE_DATABASE_URL": settings.database_url, **chosen}
