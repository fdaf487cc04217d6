"""Waiting: for a wake-up from a test that has no event loop, and for what other processes do.

A process may end between any two looks at it: what is read of one in /proc is read here.
"""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from service.local.wakeup import WakeUpSocket

PATIENCE = 120.0
"""Seconds until a test gives up: what has not happened by then never will, however busy the machine."""

T = TypeVar("T")


def wait_for(
    wake_up: WakeUpSocket,
    job_id: str,
    *,
    is_finished: Callable[[], bool],
    timeout: float,
    is_new: bool = False,
) -> bool:
    async def look() -> bool:
        return is_finished()

    return asyncio.run(wake_up.wait_for(job_id, is_finished=look, timeout=timeout, is_new=is_new))


def wait_until(condition: Callable[[], T], patience: float = PATIENCE) -> T:
    """Return the first truth of ``condition``."""
    deadline, pause = time.monotonic() + patience, 0.01
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise AssertionError("waited in vain")
        time.sleep(pause)
        # To look costs processor time, which what is waited for may need.
        pause = min(1.2 * pause, 0.06)
    return value


def process_ids() -> list[int]:
    return [int(folder.name) for folder in Path("/proc").iterdir() if folder.name.isdigit()]


def state_of(process: int) -> list[str] | None:
    """Return the fields of a process behind its name: state, parent, group, session; None if it has ended."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):  # before it is opened, or before it is read
        return None
    return None if fields[0] == "Z" else fields


def is_alive(process: int) -> bool:
    return state_of(process) is not None
