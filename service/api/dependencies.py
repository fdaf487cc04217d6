"""The shared resources of the endpoints (stores, children, settings), made once by the application.

Documents are parsed in threads of their own. Parsing is pure Python: more threads do not
speed it up, they only take the interpreter from the event loop. A document of a megabyte
may take a second, so large ones are parsed one at a time, and small ones do not wait for
them.
"""

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Generic, TypeVar, TypeVarTuple

from anyio import CapacityLimiter, to_thread
from fastapi import Depends, Request

from service.api.events.watcher import EventWatcher
from service.api.heavy_reads import HeavyReads
from service.api.keys.access import KeyRing
from service.api.keys.idempotency import IdempotencyGuard
from service.api.keys.limits import LimitGuard
from service.api.prometheus import Metrics
from service.api.verdicts.examiner import Examiner
from service.api.verdicts.verdict_queue import VerdictQueue
from service.cache import Cache
from service.jobs.kernels import ClusterState, Kernels
from service.local.wakeup import WakeUpSocket
from service.local.workers import WorkerStanding
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database.cached_reads import CachedReads
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.solutions.result_store import AuditStore, ResultStore
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.presence import ServicePresence, WorkersState

Checks = tuple[dict[str, str], WorkersState, Kernels | None, ClusterState | None]
"""The faults of the parts, the workers, the kernels that they lack, the cluster on which they compute."""

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")

LARGE_BYTES = 50_000
"""Larger documents are read one after the other."""
_SMALL_AT_ONCE = 4


class ReadingThreads:
    """The threads in which documents are read, off the event loop."""

    def __init__(self) -> None:
        self._small, self._large = CapacityLimiter(_SMALL_AT_ONCE), CapacityLimiter(1)

    async def run(self, size: int, function: Callable[[*Arguments], T], *arguments: *Arguments) -> T:
        """Return ``function(*arguments)``, which reads a document of ``size`` bytes."""
        limiter = self._large if size > LARGE_BYTES else self._small
        return await to_thread.run_sync(function, *arguments, limiter=limiter)


class SharedAnswer(Generic[T]):
    """Makes something for all that ask for it, never twice at the same time: it costs as much for many.

    Parameters
    ----------
    threads
        Of its own, so that it is made although all others are busy.
    """

    def __init__(self, make: Callable[[], T], threads: CapacityLimiter) -> None:
        self._make, self._threads = make, threads
        self._making: asyncio.Task[T] | None = None

    async def get(self) -> T:
        """Return what is being made, or is made now."""
        if self._making is None:
            self._making = asyncio.create_task(to_thread.run_sync(self._make, limiter=self._threads))
            self._making.add_done_callback(self._forget)
        # Whoever asked first may leave: the others still wait for it.
        return await asyncio.shield(self._making)

    def _forget(self, made: asyncio.Task[T]) -> None:
        self._making = None
        if not made.cancelled():
            made.exception()  # whoever waits is told; if nobody does, it is no fault


@dataclass(frozen=True, slots=True)
class Resources:
    """Stores, the queue of the children that compute verdicts, and the wake-up of local workers."""

    settings: Settings
    database: Database
    jobs: JobStore
    solutions: SolutionStore
    audits: AuditStore
    results: ResultStore
    """Atlases, and answers of studies."""
    sweeps: SweepStore
    sandbox: Sandbox
    verdicts: VerdictQueue
    examiner: Examiner
    reading: ReadingThreads
    heavy: HeavyReads
    """Places for answers that compute or build much."""
    wake_up: WakeUpSocket
    events: EventWatcher
    metrics: Metrics
    keys: KeyRing
    limits: LimitGuard
    idempotency: IdempotencyGuard
    answers: Cache[str, bytes]
    """Bytes of answers that were written before, by their entity tags: one names exactly one content."""
    reads: CachedReads
    presence: ServicePresence
    """Keeps the presence row of this service, and knows whether the database can be written to."""
    waiting: threading.BoundedSemaphore
    """Limits the number of clients that wait for their job, since each one polls the database."""
    metrics_text: SharedAnswer[bytes]
    """The answer of /metrics."""
    checks: SharedAnswer[Checks]
    """The facts that /readyz answers with."""
    local_worker: Callable[[], WorkerStanding] | None
    """Returns the status of the worker process beside this service, if there is one."""


async def _resources(request: Request) -> Resources:
    resources: Resources = request.app.state.resources
    return resources


Inside = Annotated[Resources, Depends(_resources)]
"""The type of an endpoint's parameter that receives the resources."""
