"""The shared resources of the endpoints (stores, children, settings), made once by the application."""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Request

from service.api.events.watcher import EventWatcher
from service.api.heavy_reads import HeavyReads
from service.api.keys.idempotency import IdempotencyDesk
from service.api.keys.keyring import KeyRing
from service.api.keys.limits import LimitGuard
from service.api.prometheus import Metrics
from service.api.reading_threads import ReadingThreads, SharedAnswer
from service.api.verdicts.examined import Examiner
from service.api.verdicts.verdict_queue import VerdictQueue
from service.cache import Cache
from service.jobs.kernels import Kernels
from service.jobs.store import JobStore
from service.local.wakeup import Doorbell
from service.local.workers import WorkerStanding
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.database.remembered import Remembered
from service.storage.jobs.worker_registry import WorkersState
from service.storage.solutions.atlas_store import AtlasStore
from service.storage.solutions.audit_store import AuditStore
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.presence import ServicePresence


@dataclass(frozen=True, slots=True)
class Resources:
    """Stores, the queue of the children that compute verdicts, and the wake-up of local workers."""

    settings: Settings
    database: Database
    jobs: JobStore
    solutions: SolutionStore
    audits: AuditStore
    atlases: AtlasStore
    sweeps: SweepStore
    sandbox: Sandbox
    verdicts: VerdictQueue
    examiner: Examiner
    reading: ReadingThreads
    heavy: HeavyReads
    """Places for answers that compute or build much."""
    doorbell: Doorbell
    events: EventWatcher
    metrics: Metrics
    keys: KeyRing
    limits: LimitGuard
    idempotency: IdempotencyDesk
    answers: Cache[str, bytes]
    """Bytes of answers that were written before, by their entity tags: one names exactly one content."""
    remembered: Remembered
    presence: ServicePresence
    """Keeps the presence row of this service, and knows whether the database can be written to."""
    waiting: threading.BoundedSemaphore
    """Limits the number of clients that wait for their job, since each one polls the database."""
    metrics_text: SharedAnswer[bytes]
    """The answer of /metrics."""
    checks: SharedAnswer[tuple[dict[str, str], WorkersState, Kernels | None]]
    """The facts that /readyz answers with."""
    local_worker: Callable[[], WorkerStanding] | None
    """Returns the status of the worker process beside this service, if there is one."""


async def _resources(request: Request) -> Resources:
    resources = request.app.state.resources
    assert isinstance(resources, Resources)
    return resources


Inside = Annotated[Resources, Depends(_resources)]
"""The type of an endpoint's parameter that receives the resources."""
