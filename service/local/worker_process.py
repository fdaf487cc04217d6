"""A worker process: its name, its host, its command line, its environment, its folder of compiled code."""

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
