"""What every endpoint works with, made once by the app."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from anyio import CapacityLimiter
from fastapi import Depends, Request

from service.api.exposition import Metrics
from service.api.keyring import KeyRing
from service.api.limits import Limits
from service.api.reading_threads import ReadingThreads
from service.api.verdict_queue import VerdictQueue
from service.jobs.restarts import WorkerStanding
from service.jobs.store import JobStore
from service.jobs.wakeup import Doorbell
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database import Database
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.presence import ServicePresence


@dataclass(frozen=True, slots=True)
class Resources:
    """Stores, the children that reach verdicts, and the bell of the local workers."""

    settings: Settings
    database: Database
    jobs: JobStore
    solutions: SolutionStore
    sweeps: SweepStore
    sandbox: Sandbox
    verdicts: VerdictQueue
    reading: ReadingThreads
    doorbell: Doorbell
    metrics: Metrics
    keys: KeyRing
    limits: Limits
    presence: ServicePresence
    """Writes that this service is there, and knows whether it could."""
    waiting: threading.BoundedSemaphore
    """Places for clients that wait for their job: each looks into the database now and then."""
    checking: CapacityLimiter
    """Threads of /readyz alone."""
    local_worker: Callable[[], WorkerStanding] | None
    """Tells how the worker process beside this service does, if there is one."""


async def _resources(request: Request) -> Resources:
    resources = request.app.state.resources
    assert isinstance(resources, Resources)
    return resources


Inside = Annotated[Resources, Depends(_resources)]
"""The type of an endpoint's parameter that receives the resources."""
