"""Starts, restarts and stops the worker process that a service runs on its own machine.

A process that ran for a while, or has worked, is restarted at once, since its jobs wait. One that dies
repeatedly before it can work would only waste processor time, so the pauses grow.

What any worker process has is here too: its name, its host, its command line, its environment, its folder of
compiled code. Commands that need no settings use this too: it loads none.
"""

import json
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from service.local.wakeup import WakeUpSocket

if TYPE_CHECKING:
    from service.settings import Settings


@dataclass(frozen=True, slots=True)
class WorkerProcess:
    """The identity of a worker."""

    name: str
    host: str
    engine: str
    slots: int


class OtherHostError(Exception):
    """Another machine uses the database, and the local engine serves one machine only."""

    def __init__(self, host: str, other: str, silent_seconds: float) -> None:
        super().__init__(
            f"{other} works on this database (seen {silent_seconds:.0f} s ago) and this is {host}: the local "
            "engine serves one machine. Stop the workers there, or let Postgres announce the jobs: "
            "POLHODE_ENGINE=postgres, for the service and on every machine"
        )


def this_host() -> str:
    """Return the host name and the beginning of the boot id: host names alone are not unique."""
    boot = ""
    with suppress(OSError):  # only Linux has it
        boot = "/" + Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")[:8]
    return os.uname().nodename[:200] + boot


def own_host() -> str:
    """Return the name by which the settings call this host, else its own; for processes without settings."""
    return os.environ.get("POLHODE_HOST_NAME") or this_host()


def new_worker_name(host: str) -> str:
    """Return a unique name for a worker."""
    return f"{host[:64]}:{os.getpid()}:{os.urandom(4).hex()}"


def worker_command(name: str, **options: object) -> list[str]:
    """Return the command line for a command of a worker, its options as JSON; paths are text there.

    ``-P``: a ``workers.py`` in the working folder is not imported.
    """
    return [sys.executable, "-P", "-m", "workers", name, json.dumps(options, default=str)]


def worker_environment(settings: "Settings") -> dict[str, str]:
    """Return a worker's environment. URLs may hold passwords, and other users see command-line options."""
    log = {"POLHODE_LOG_FORMAT": settings.log_format, "POLHODE_LOG_LEVEL": settings.log_level}
    chosen = {name: value for name, value in log.items() if value is not None}
    return {**os.environ, "POLHODE_DATABASE_URL": settings.database_url, **chosen}


FOLDER_VARIABLE = "NUMBA_CACHE_DIR"
"""Names another folder for compiled code; what is in it is run, so nobody else may be able to write to it."""


def own_folder() -> Path | None:
    """Return the folder of compiled code, made where it is missing; None if there is a reason against it."""
    folder = _base() / "compiled"
    return folder if why_no_folder() is None else None


def why_no_folder() -> str | None:
    """Return what is wrong with the folder, and what to do; None if it can be used."""
    folder = _base() / "compiled"
    advice = f"set {FOLDER_VARIABLE} to a folder of your own"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.stat()
    except OSError as fault:
        return f"{folder} cannot be made ({fault.strerror}): {advice}"
    if about.st_uid not in (0, os.getuid()) or about.st_mode & 0o022:
        return f"others can write to {folder}, and what is in it is run: {advice}, or chmod 700 that one"
    # One that only root writes to, as that of an image, is good for what is in it.
    if not os.access(folder, os.W_OK) and not any(folder.glob("ready-*")):
        return f"{folder} cannot be written to: {advice}"
    return None


def _base() -> Path:
    named = os.environ.get(FOLDER_VARIABLE)
    if named:
        return Path(named)
    caches = os.environ.get("XDG_CACHE_HOME")
    # The method of Path raises where nobody knows a home.
    home = os.path.expanduser("~")  # noqa: PTH111
    return (Path(caches) if caches else Path(home, ".cache")) / "polhode"


logger = logging.getLogger(__name__)


EARLY_SECONDS = 10.0
"""A process that ends sooner than this has died early. A start takes a second, ten on a busy machine."""
FIRST_PAUSE_SECONDS, LONGEST_PAUSE_SECONDS = 0.5, 15.0
"""Before the next start; doubled with each further early death in a row."""


@dataclass(frozen=True, slots=True)
class Restarts:
    """Counts of the times that a process has ended by itself."""

    deaths: int = 0
    early_deaths: int = 0
    """Consecutive early deaths up to now."""

    def after_death(self, lived_seconds: float, *, has_worked: bool) -> "Restarts":
        """Return the counts after another death."""
        is_early = lived_seconds < EARLY_SECONDS and not has_worked
        return Restarts(self.deaths + 1, self.early_deaths + 1 if is_early else 0)

    @property
    def pause_seconds(self) -> float:
        """Seconds to wait before the next start."""
        if self.early_deaths == 0:
            return 0.0
        # Beyond the longest pause the exact power does not matter, and a float has a largest one.
        return min(FIRST_PAUSE_SECONDS * 2.0 ** min(self.early_deaths - 1, 32), LONGEST_PAUSE_SECONDS)


@dataclass(frozen=True, slots=True)
class WorkerStanding:
    """The status of the worker process beside a service."""

    restarts: Restarts
    last_code: int | None = None
    """Exit code of its last process; negative: the number of a signal. None: it could not be started."""
    seconds_to_start: float | None = None
    """Until it is started again; None while it runs."""

    @property
    def is_running(self) -> bool:
        """It runs, or has not failed yet."""
        return self.seconds_to_start is None

    def __str__(self) -> str:
        if self.seconds_to_start is None:
            return "ok"
        ended = "could not be started" if self.last_code is None else f"ended with code {self.last_code}"
        often = f", {self.restarts.early_deaths} times in a row soon after its start"
        return (
            f"the worker process {ended}{often if self.restarts.early_deaths > 1 else ''}; "
            f"it is started again in {self.seconds_to_start:.1f} s"
        )


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

    def __init__(self, settings: "Settings", wake_up: WakeUpSocket) -> None:
        self._settings = settings
        self._wake_up = wake_up
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
        self._wake_up.close()
        self._keeper.join(self._settings.grace_seconds + 5.0)
        if self._keeper.is_alive():
            self._process.kill()
            self._keeper.join()

    def _start(self) -> "subprocess.Popen[bytes]":
        self._has_worked = threading.Event()
        line = self._wake_up.new_socket(self._has_worked.set)
        with line:
            return subprocess.Popen(
                worker_command("run", slots=self._settings.workers, wake_fd=line.fileno()),
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
