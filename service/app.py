"""Builds the HTTP application, and starts and stops the threads and child processes that it owns."""

import logging
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from anyio import CapacityLimiter, to_thread
from fastapi import FastAPI

from service.api.dependencies import ReadingThreads, Resources, SharedAnswer
from service.api.events.poller import ChangePoller
from service.api.events.watcher import EventWatcher
from service.api.heavy_reads import HeavyReads
from service.api.keys.access import KeyRing
from service.api.keys.idempotency import IdempotencyGuard
from service.api.keys.limits import LimitGuard
from service.api.prometheus import Metrics
from service.api.routes.events import documents_of
from service.api.routes.installation import checks_of
from service.api.routing import install
from service.api.verdicts.examiner import CachedExaminations, Examiner
from service.api.verdicts.verdict_queue import VerdictQueue
from service.cache import Cache
from service.local.wakeup import WakeUpSocket
from service.local.workers import WorkerStanding
from service.sandbox import Sandbox
from service.settings import Settings
from service.storage.database.cached_reads import CachedReads
from service.storage.database.database import Database
from service.storage.examinations import ExaminationStore
from service.storage.jobs.job_store import JobStore
from service.storage.jobs.rows import ChangeReader
from service.storage.keys import IdempotencyStore, KeyStore
from service.storage.solutions.result_store import AuditStore, ResultStore
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from service.storage.upkeep.presence import SILENT_LEASES, ServicePresence
from service.storage.upkeep.retention import DAY_SECONDS, Retention
from service.storage.upkeep.statistics import Statistics
from service.verdicts.starting import VerdictChildren, verdict_children
from service.versions import version_of

logger = logging.getLogger(__name__)


_ANSWER_BYTES = 8_000_000
"""Answers that are kept as they were sent."""
_MONITORING = 2
"""Threads for /readyz and /metrics, so that these are answered although all other threads are busy."""


def create_app(
    settings: Settings,
    *,
    wake_up_socket: WakeUpSocket | None = None,
    sandbox: Sandbox | None = None,
    local_worker: Callable[[], WorkerStanding] | None = None,
) -> FastAPI:
    """Return the application on a migrated database.

    A caller that starts local workers passes ``wake_up_socket``, one that already has a
    sandbox passes ``sandbox``, and the caller closes them; without them the application
    makes its own, and wake_ups no workers. ``local_worker`` returns the status of the
    local worker process.
    """
    wake_up = wake_up_socket or WakeUpSocket()

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        database = Database(settings.database_url, announces_jobs=settings.engine == "postgres")
        children = sandbox or VerdictChildren(settings).ready()
        statistics = Statistics(database, seen_seconds=SILENT_LEASES * settings.lease_seconds)
        keys = KeyStore(database)
        days = settings.samples_days
        ring, reads = KeyRing(keys), CachedReads(database)
        answers = IdempotencyStore(database)
        older_than_seconds = None if days is None else days * DAY_SECONDS
        retention = Retention(database, answers, older_than_seconds=older_than_seconds)
        presence = ServicePresence(database, host=settings.host_name, is_only=settings.engine == "local")
        examinations = ExaminationStore(database)
        kept = CachedExaminations(examinations)
        sweeps = SweepStore(database)
        poller = ChangePoller(ChangeReader(database), sweeps, documents_of(database, settings))
        events = EventWatcher(poller, capacity=settings.event_streams)
        wake_up.when_anything(events.wake, events.stop)
        verdicts = VerdictQueue(children, settings, children=verdict_children())
        heavy = HeavyReads(settings, make_room=lambda: bool(app.state.close_one_unread()))
        metrics = Metrics(statistics, version=version_of("polhode"), local_worker=local_worker, kept=kept)
        monitoring = CapacityLimiter(_MONITORING)
        app.state.resources = Resources(
            settings=settings,
            database=database,
            jobs=JobStore(database),
            solutions=SolutionStore(database),
            audits=AuditStore(database),
            results=ResultStore(database),
            sweeps=sweeps,
            sandbox=children,
            verdicts=verdicts,
            examiner=Examiner(verdicts, kept, examinations),
            reading=ReadingThreads(),
            heavy=heavy,
            wake_up=wake_up,
            events=events,
            metrics=metrics,
            metrics_text=SharedAnswer(metrics.text, monitoring),
            checks=SharedAnswer(lambda: checks_of(app.state.resources), monitoring),
            keys=ring,
            limits=LimitGuard(settings, keys),
            idempotency=IdempotencyGuard(answers),
            answers=Cache(_ANSWER_BYTES, len),
            reads=reads,
            presence=presence,
            waiting=threading.BoundedSemaphore(settings.waiting_places),
            local_worker=local_worker,
        )
        presence.start()
        events.start()
        if database.file is not None and (warning := database.file.mode_warning()):
            logger.warning("%s", warning)
        try:
            yield
        finally:
            await events.close()
            await to_thread.run_sync(heavy.close, limiter=CapacityLimiter(1))
            presence.close()
            retention.close()
            await to_thread.run_sync(verdicts.close, limiter=CapacityLimiter(1))
            if sandbox is None:
                children.close()
            ring.close()
            reads.close()
            database.close()
            if wake_up_socket is None:
                wake_up.close()

    # /docs is a page of our own: FastAPI's pages load scripts from other hosts. So is /openapi.json.
    app = FastAPI(title="polhode", lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)
    # A server that has a gate for its connections puts its own there.
    app.state.close_one_unread = lambda: False
    install(app)
    return app
