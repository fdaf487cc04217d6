"""Waiting for the doorbell from a test that has no event loop."""

import asyncio
from collections.abc import Callable

from service.jobs.wakeup import Doorbell


def wait_for(doorbell: Doorbell, job_id: str, *, is_finished: Callable[[], bool], timeout: float) -> bool:
    async def look() -> bool:
        return is_finished()

    return asyncio.run(doorbell.wait_for(job_id, is_finished=look, timeout=timeout))
