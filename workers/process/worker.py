"""The loop of a worker, and its presence: it uses a database, runs jobs when woken, and polls at intervals.

The modules before it know no database: this one is loaded while the children start.
"""

import contextlib
import logging
import selectors
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sqlalchemy.exc import SQLAlchemyError

from service.jobs.kernels import ClusterState, Kernels, Outlook
from service.local.wakeup import WARM, WorkerSocket
from service.local.workers import WorkerProcess, new_worker_name, this_host
from service.logs import Complaints, about
from service.settings import Settings
from service.startup import StopAsked
from service.storage.database.availability import is_away
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.upkeep.presence import WorkerRegistry
from workers.process.pool import Pool
from workers.process.results import JobLimits
from workers.process.runner import WATCH_SECONDS, Runner
from workers.process.start import Readiness, Waker

if TYPE_CHECKING:
    from workers.process.notifications import Notifications

logger = logging.getLogger(__name__)


class Presence:
    """The presence row of one worker.

    Parameters
    ----------
    seconds
        How often it is renewed.
    alone
        Whether a worker of another host refuses this one.
    cluster
        The cluster on which it computes, if it does.
    """

    def __init__(
        self,
        registry: WorkerRegistry,
        worker: WorkerProcess,
        *,
        seconds: float,
        alone: bool,
        cluster: Callable[[], ClusterState | None] = lambda: None,
    ) -> None:
        self._cluster_now = cluster
        self._registry = registry
        self._worker = worker
        self._seconds = seconds
        self._alone = alone
        self._has_entered = False
        self._is_warm = False
        self._kernels: Kernels | None = None
        self._cluster: ClusterState | None = None
        self._due_at = 0.0

    def keep(self, *, is_warm: bool, kernels: Kernels | None) -> None:
        """Renew the row if it is time, or if it is news that this worker is warm, or how far kernels are.

        The first time raises what :meth:`~service.storage.upkeep.presence.WorkerRegistry.enter` raises.
        """
        if not self._has_entered:
            self._registry.enter(self._worker, alone=self._alone)
            self._has_entered = True
            logger.info("worker %s with %d slots", self._worker.name, self._worker.slots)
            self._due_at = time.monotonic() + self._seconds
        news = is_warm, kernels, self._cluster_now()
        if self.seconds_left() == 0.0 or news != (self._is_warm, self._kernels, self._cluster):
            self._is_warm, self._kernels, self._cluster = news
            self._registry.see(self._worker, is_warm=is_warm, kernels=kernels, cluster=self._cluster)
            self._due_at = time.monotonic() + self._seconds

    def outlook(self) -> Outlook:
        """Tell whether kernels are there, or will be, here or at another worker that shares the queue."""
        if self._kernels is None:
            return "there"
        is_in_vain = self._kernels.fault is not None and not self._registry.may_have_kernels()
        return "never" if is_in_vain else "coming"

    def seconds_left(self) -> float:
        """Return how long :meth:`keep` has nothing to do."""
        return max(0.0, self._due_at - time.monotonic())

    def end(self) -> None:
        """Remove the row; if the database is unreachable, the row expires later."""
        with contextlib.suppress(SQLAlchemyError):
            self._registry.leave(self._worker)


_AWAY_SECONDS = 0.5
"""Seconds between attempts while the database is unreachable."""


class EngineLoop:
    """The loop of a worker.

    Parameters
    ----------
    runner, presence
        The runner of jobs, and the worker's presence row.
    waker
        The runner's ``wake``.
    service
        The wake-up socket of the service that started this worker, if any. When it closes, the loop stops.
    announcements
        Notifications of delivered jobs, if the engine has them.
    readiness
        What the children have loaded, or how far the pool is otherwise.
    poll_seconds
        How often to poll for jobs that were not announced.
    grace_seconds
        How long running jobs may still finish after :meth:`stop`; then they are queued again.
    """

    def __init__(
        self,
        runner: Runner,
        presence: Presence,
        waker: Waker,
        *,
        service: WorkerSocket | None,
        announcements: "Notifications | None",
        readiness: Readiness,
        poll_seconds: float,
        grace_seconds: float,
    ) -> None:
        self._runner = runner
        self._presence = presence
        self._waker = waker
        self._service = service
        self._announcements = announcements
        self._readiness = readiness
        self._poll_seconds = poll_seconds
        self._grace_seconds = grace_seconds
        self._stop_by: float | None = None
        self._is_away = False
        self._complaints = Complaints(logger)
        self._has_told = False

    def stop(self) -> None:
        """Claim nothing more; safe from any thread or signal handler, also repeatedly."""
        if self._stop_by is None:
            self._stop_by = time.monotonic() + self._grace_seconds
        self._waker()

    def stop_at_once(self) -> None:
        """Return running jobs to the queue, instead of waiting for their end; safe as :meth:`stop` is."""
        self._stop_by = time.monotonic()
        self._waker()

    def run(self) -> None:
        """Work until stopped."""
        while not self._is_over():
            try:
                self._turn()
            except Exception as fault:
                if not is_away(fault):
                    raise
                if not self._is_away:
                    # Not at each attempt: an outage may last for hours. Nor at each outage: where only some
                    # writes fail, such as on a full disk, every second turn is one.
                    self._complaints.tell("the database cannot be reached; trying again until it can", fault)
                self._is_away = True
                time.sleep(_AWAY_SECONDS)
            else:
                if self._is_away:
                    self._complaints.tell("the database can be reached again")
                self._is_away = False
                self._wait()
        try:
            self._runner.give_back()
        except Exception as fault:
            if not is_away(fault):
                raise
            logger.warning(
                "the database cannot be reached: running jobs are queued again when their leases end"
            )

    def _turn(self) -> None:
        """Do all pending work, finished jobs first, since clients may wait for them."""
        self._tell(self._runner.collect(refill=self._stop_by is None))
        self._runner.keep_leases()
        # In this order: a worker that is warm takes jobs.
        is_warm = self._readiness.is_over()
        takes_jobs = self._readiness.may_take_jobs()
        self._presence.keep(is_warm=is_warm, kernels=self._readiness.kernels())
        if is_warm and not self._has_told and self._service is not None:
            self._service.tell(WARM)
        self._has_told = is_warm
        if self._stop_by is None:
            if takes_jobs and self._announcements is not None:
                # Listen before looking, so that no later delivery is missed.
                self._announcements.listen()
            self._runner.reconcile()
            if takes_jobs:
                self._tell(self._runner.fill())

    def _tell(self, finished: list[str]) -> None:
        if self._service is not None:
            for job_id in finished:
                self._service.tell(job_id)

    def _is_over(self) -> bool:
        if self._stop_by is None:
            return False
        return not self._runner.is_busy or time.monotonic() >= self._stop_by

    def _wait(self) -> None:
        if self._is_over():
            return
        timeout = min(self._poll_seconds, self._presence.seconds_left())
        if self._runner.is_busy:
            timeout = min(timeout, WATCH_SECONDS)
        with selectors.PollSelector() as selector:
            for source in (self._waker, self._service, self._announcements):
                if source is not None and source.fileno() >= 0:
                    selector.register(source, selectors.EVENT_READ)
            heard = [key.fileobj for key, _ in selector.select(timeout)]
        if self._waker in heard:
            self._waker.clear()
        if self._announcements in heard and self._announcements is not None:
            self._announcements.clear()
        if self._service in heard and self._service is not None and not self._service.is_open():
            logger.info("the service has ended, stopping")
            self._service.close()
            self.stop()


PRESENT_SECONDS = 10.0
"""Largest time between refreshes of the presence row: a third of the time after which it expires."""


@dataclass(frozen=True, slots=True)
class Equipment:
    """The parts of a worker that exist before it knows its database."""

    pool: Pool
    readiness: Readiness
    waker: Waker
    service: WorkerSocket | None
    stop: StopAsked


def use_database(settings: Settings, slots: int, equipment: Equipment) -> None:
    """Be present in the database, and compute its jobs until stopped.

    Raises
    ------
    OtherHostError, UnknownRevisionError
        See :func:`workers.process.start.run_worker`.
    """
    host = settings.host_name or this_host()
    worker = WorkerProcess(new_worker_name(host), host, settings.engine, slots)
    database = Database(settings.database_url, announces_jobs=settings.engine == "postgres")
    registry = WorkerRegistry(database, lease_seconds=settings.lease_seconds)
    seconds = min(settings.lease_seconds, PRESENT_SECONDS)
    presence = Presence(
        registry,
        worker,
        seconds=seconds,
        alone=settings.engine == "local",
        cluster=equipment.readiness.cluster,
    )
    try:
        with about(worker=worker.name):
            _loop(settings, worker, presence, database, equipment)
    finally:
        presence.end()
        database.close()


def _loop(
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
        JobStore(database), equipment.pool, name=worker.name, limits=limits, outlook=presence.outlook
    )
    notifications = None
    if database.announces_jobs:
        from workers.process.notifications import Notifications  # noqa: PLC0415

        notifications = Notifications(database.engine)
    loop = EngineLoop(
        runner,
        presence,
        equipment.waker,
        service=equipment.service,
        announcements=notifications,
        readiness=equipment.readiness,
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
