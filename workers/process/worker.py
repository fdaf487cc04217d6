"""Runs one worker process, from its settings to its shutdown."""

import logging
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

from service.local.hosts import WorkerProcess, new_worker_name, this_host
from service.local.wakeup import WorkerLine
from service.logs import about
from service.sandbox import Sandbox
from service.settings import Settings
from service.stopping import StopAsked
from service.storage.database.database import Database
from service.storage.database.revisions import refuse_newer
from service.storage.jobs.dispatching import dispatcher_of
from service.storage.jobs.job_store import SqlJobStore
from service.storage.jobs.worker_registry import WorkerRegistry
from workers.process.loop import EngineLoop, Waker
from workers.process.presence import Presence
from workers.process.runner import Computations, JobLimits, Runner

if TYPE_CHECKING:
    from workers.process.procrastinate import Notifications

logger = logging.getLogger(__name__)

PRESENT_SECONDS = 10.0
"""Largest time between refreshes of the presence row: a third of the time after which it expires."""


def run_worker(
    computations: Computations,
    settings: Settings,
    *,
    slots: int,
    wake_fd: int | None,
    preload: Sequence[str] = (),
) -> None:
    """Run one worker in this process until SIGTERM, SIGINT, or the end of the service that started it.

    ``wake_fd`` is the descriptor of a wake-up socket from :class:`service.local.wakeup.Doorbell`;
    ``preload`` are modules that the computations need, beside their own.

    Raises
    ------
    OtherHostError
        The engine is for one machine, and another machine uses the database.
    NewerSchemaError
        A later version has changed the database, perhaps since the service that starts this worker began.
    """
    # Slots share the cores already, and the stacks of idle threads would count as a job's memory.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    host = settings.host_name or this_host()
    worker = WorkerProcess(new_worker_name(host), host, settings.engine, slots)
    database = Database(settings.database_url)
    registry = WorkerRegistry(database, lease_seconds=settings.lease_seconds)
    presence = Presence(registry, worker, seconds=min(settings.lease_seconds, PRESENT_SECONDS))
    try:
        refuse_newer(database.engine)
        # From here on the end needs a clean-up.
        with StopAsked() as stop:
            presence.begin(alone=settings.engine == "local")
            try:
                with about(worker=worker.name):
                    logger.info("worker %s with %d slots", worker.name, slots)
                    _work(worker, presence, computations, settings, database, wake_fd, stop, preload)
            finally:
                presence.end()
    finally:
        database.close()


def _work(
    worker: WorkerProcess,
    presence: Presence,
    computations: Computations,
    settings: Settings,
    database: Database,
    wake_fd: int | None,
    stop: StopAsked,
    preload: Sequence[str],
) -> None:
    limits = JobLimits(
        lease_seconds=settings.lease_seconds,
        job_seconds=settings.job_seconds,
        memory_mb=settings.job_memory_mb,
        max_attempts=settings.max_attempts,
        retry_seconds=settings.retry_seconds,
    )
    modules = [*(computation.__module__ for computation in computations.values()), *preload]
    sandbox = Sandbox(worker.slots, memory_mb=settings.job_memory_mb, preload=modules)
    waker = Waker()
    store = SqlJobStore(database, dispatcher_of(settings))
    runner = Runner(
        store, sandbox, computations, name=worker.name, slots=worker.slots, limits=limits, wake=waker
    )
    notifications = _notifications(database) if settings.engine == "procrastinate" else None
    loop = EngineLoop(
        runner,
        presence,
        waker,
        line=None if wake_fd is None else WorkerLine(wake_fd),
        announcements=notifications,
        poll_seconds=settings.poll_seconds,
        grace_seconds=settings.grace_seconds,
    )

    stop.tell(loop.stop)
    try:
        if not stop.is_asked:
            sandbox.start()
        loop.run()
    finally:
        sandbox.close()
        if notifications is not None:
            notifications.close()


def _notifications(database: Database) -> "Notifications":
    from workers.process.procrastinate import Notifications  # noqa: PLC0415

    return Notifications(database.engine)
