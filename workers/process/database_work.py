"""A worker's use of its database: it is present there, and computes its jobs."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.local.hosts import WorkerProcess, new_worker_name, this_host
from service.local.wakeup import WorkerLine
from service.logs import about
from service.sandbox import Sandbox
from service.settings import Settings
from service.stopping import StopAsked
from service.storage.database.database import Database
from service.storage.jobs.dispatching import dispatcher_of
from service.storage.jobs.job_store import SqlJobStore
from service.storage.jobs.worker_registry import WorkerRegistry
from workers.process.limits import JobLimits
from workers.process.loop import EngineLoop
from workers.process.presence import Presence
from workers.process.runner import Computations, Runner
from workers.process.waker import Waker
from workers.process.warming import Warming

if TYPE_CHECKING:
    from workers.process.procrastinate import Notifications

PRESENT_SECONDS = 10.0
"""Largest time between refreshes of the presence row: a third of the time after which it expires."""


@dataclass(frozen=True, slots=True)
class Equipment:
    """The parts of a worker that exist before it knows its database."""

    sandbox: Sandbox
    warming: Warming
    waker: Waker
    line: WorkerLine | None
    stop: StopAsked


def use_database(computations: Computations, settings: Settings, slots: int, equipment: Equipment) -> None:
    """Be present in the database, and compute its jobs until stopped.

    Raises
    ------
    OtherHostError, UnknownRevisionError
        See :func:`workers.process.worker.run_worker`.
    """
    host = settings.host_name or this_host()
    worker = WorkerProcess(new_worker_name(host), host, settings.engine, slots)
    database = Database(settings.database_url)
    registry = WorkerRegistry(database, lease_seconds=settings.lease_seconds)
    seconds = min(settings.lease_seconds, PRESENT_SECONDS)
    presence = Presence(registry, worker, seconds=seconds, alone=settings.engine == "local")
    try:
        with about(worker=worker.name):
            _loop(computations, settings, worker, presence, database, equipment)
    finally:
        presence.end()
        database.close()


def _loop(
    computations: Computations,
    settings: Settings,
    worker: WorkerProcess,
    presence: Presence,
    database: Database,
    equipment: Equipment,
) -> None:
    limits = JobLimits(
        lease_seconds=settings.lease_seconds,
        job_seconds=settings.job_seconds,
        memory_mb=settings.job_memory_mb,
        max_attempts=settings.max_attempts,
        retry_seconds=settings.retry_seconds,
    )
    runner = Runner(
        SqlJobStore(database, dispatcher_of(settings)),
        equipment.sandbox,
        computations,
        name=worker.name,
        slots=worker.slots,
        limits=limits,
        wake=equipment.waker,
        outlook=presence.outlook,
    )
    notifications = _notifications(database) if settings.engine == "procrastinate" else None
    loop = EngineLoop(
        runner,
        presence,
        equipment.waker,
        line=equipment.line,
        announcements=notifications,
        takes_jobs=equipment.warming.may_take_jobs,
        is_warm=equipment.warming.is_over,
        kernels=equipment.warming.kernels,
        poll_seconds=settings.poll_seconds,
        grace_seconds=settings.grace_seconds,
    )
    equipment.stop.tell(loop.stop)
    equipment.stop.urge(loop.stop_at_once)
    try:
        loop.run()
    finally:
        if notifications is not None:
            notifications.close()


def _notifications(database: Database) -> "Notifications":
    from workers.process.procrastinate import Notifications  # noqa: PLC0415

    return Notifications(database.engine)
