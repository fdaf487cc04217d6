"""Waiting: for a wake-up from a test that has no event loop, and for what other processes do."""

import asyncio
import time
from collections.abc import Callable

from service.local.wakeup import WakeUpSocket


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


def wait_until(is_true: Callable[[], bool], *, seconds: float = 120.0) -> bool:
    """Say whether it came true before the patience was at an end."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if is_true():
            return True
        time.sleep(0.05)
    return False
