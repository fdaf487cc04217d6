"""A worker process: its name, its host, its command line and its environment."""

import json
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from service.settings import Settings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path


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
