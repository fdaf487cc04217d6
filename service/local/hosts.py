"""Names this machine and its workers, and refuses a second machine with the local engine."""

import os
import secrets
import socket
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
            "engine serves one machine. Stop the workers there, or let Postgres deliver the jobs: "
            "POLHODE_ENGINE=procrastinate, for the service and on every machine"
        )


def this_host() -> str:
    """Return the host name and the beginning of the boot id: host names alone are not unique."""
    boot = ""
    with suppress(OSError):  # only Linux has it
        boot = "/" + Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")[:8]
    return socket.gethostname()[:200] + boot


def new_worker_name(host: str) -> str:
    """Return a unique name for a worker."""
    return f"{host[:64]}:{os.getpid()}:{secrets.token_hex(4)}"
