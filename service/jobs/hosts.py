"""Machines that work on one database."""

import os
import secrets
import socket
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class WorkerProcess:
    """A worker, as others see it."""

    name: str
    host: str
    engine: str
    slots: int


class OtherHostError(Exception):
    """The local engine serves one machine, and another one is at work on the database."""

    def __init__(self, host: str, other: str, silent_seconds: float) -> None:
        super().__init__(
            f"{other} works on this database (seen {silent_seconds:.0f} s ago) and this is {host}: the local "
            "engine serves one machine. Stop the workers there, or let Postgres deliver the jobs: "
            "POLHODE_ENGINE=procrastinate, for the service and on every machine"
        )


def this_host() -> str:
    """Return the name of this machine and the beginning of its boot's id: names alone are given twice."""
    boot = ""
    with suppress(OSError):  # only Linux has it
        boot = "/" + Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii")[:8]
    return socket.gethostname()[:200] + boot


def new_worker_name(host: str) -> str:
    """Return a name that no other worker has had."""
    return f"{host[:64]}:{os.getpid()}:{secrets.token_hex(4)}"
