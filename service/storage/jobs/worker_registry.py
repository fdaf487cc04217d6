"""Keeps a row for each live worker, refreshed by its heartbeat."""

from typing import Literal

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from service.jobs.kernels import ClusterState, Kernels
from service.local.worker_process import OtherHostError, WorkerProcess
from service.storage.database.database import Database
from service.storage.database.revisions import refuse_unknown
from service.storage.database.rows import database_now
from service.storage.tables.base import DatabaseNow
from service.storage.tables.operations import WorkerRow

SILENT_LEASES = 3
"""A worker that was silent for so many lease times counts as gone."""
FORGOTTEN_SECONDS = 86_400.0
"""The row of a killed worker is removed after this silence."""

WorkersState = Literal["warm", "starting", "none"]
"""Some worker has loaded all its code; there are only workers that still load; there is no worker."""


class WorkerRegistry:
    """Registers workers. One method is one transaction."""

    def __init__(self, database: Database, *, lease_seconds: float) -> None:
        self._database = database
        self._silent_seconds = SILENT_LEASES * lease_seconds

    def enter(self, worker: WorkerProcess, *, alone: bool) -> None:
        """Register a starting worker; ``alone`` refuses it if another machine uses the database.

        Raises
        ------
        OtherHostError
            A worker of another machine is registered and alive.
        UnknownRevisionError
            A later version has changed the database.
        """
        refuse_unknown(self._database.engine)
        self.see(worker, is_warm=False)
        if not alone:
            return
        # Insert first, then look: of two that start at once, at least one sees the other.
        with self._database.read() as session:
            now = database_now(session)
            before = (
                select(WorkerRow)
                .where(WorkerRow.host != worker.host, WorkerRow.seen_at >= now - self._silent_seconds)
                .where(WorkerRow.slots > 0)  # a service without workers may be on any machine
                .order_by(WorkerRow.seen_at.desc())
                .limit(1)
            )
            other = session.scalar(before)
        if other is not None:
            self.leave(worker)
            raise OtherHostError(worker.host, other.host, now - other.seen_at)

    def see(
        self,
        worker: WorkerProcess,
        *,
        is_warm: bool,
        kernels: Kernels | None = None,
        cluster: ClusterState | None = None,
    ) -> None:
        """Refresh the row of a worker, or insert it again; remove rows of workers that died long ago.

        ``kernels`` are how far these are compiled; None if there is nothing to compile. A worker that uses a
        ``cluster`` has as many slots as there are threads, and one while there are none.
        """
        with self._database.write() as session:
            now = database_now(session)
            row = session.get(WorkerRow, worker.name)
            if row is None:
                row = WorkerRow(
                    name=worker.name,
                    host=worker.host,
                    engine=worker.engine,
                    slots=worker.slots,
                    started_at=now,
                )
                session.add(row)
            row.seen_at, row.is_warm = now, is_warm
            row.kernels = None if kernels is None else kernels.document()
            row.cluster = None if cluster is None else cluster.document()
            if cluster is not None:
                row.slots = max(1, cluster.threads)
            session.execute(delete(WorkerRow).where(WorkerRow.seen_at < DatabaseNow() - FORGOTTEN_SECONDS))

    def state(self) -> WorkersState:
        """Return whether some worker that is alive is warm."""
        with self._database.read() as session:
            alive = WorkerRow.seen_at >= database_now(session) - self._silent_seconds
            found = session.scalars(
                select(WorkerRow.is_warm).where(alive, WorkerRow.slots > 0).distinct()
            ).all()
        return "warm" if any(found) else "starting" if found else "none"

    def kernels(self) -> list[Kernels]:
        """Return how far the workers that are alive and compile are with it."""
        return [each for each in self._all_kernels() if each is not None]

    def may_have_kernels(self) -> bool:
        """Tell whether a worker that is alive has all kernels, or still compiles."""
        return any(each is None or each.fault is None for each in self._all_kernels())

    def clusters(self) -> list[ClusterState]:
        """Return the clusters that workers use, each once: as the worker says that has most threads there."""
        with self._database.read() as session:
            return clusters_of(session, database_now(session) - self._silent_seconds)

    def _all_kernels(self) -> list[Kernels | None]:
        with self._database.read() as session:
            alive = WorkerRow.seen_at >= database_now(session) - self._silent_seconds
            stored = session.scalars(select(WorkerRow.kernels).where(alive, WorkerRow.slots > 0)).all()
        return [None if each is None else Kernels.read(each) for each in stored]

    def leave(self, worker: WorkerProcess) -> None:
        """Remove the row of a worker that shuts down."""
        with self._database.write() as session:
            session.execute(delete(WorkerRow).where(WorkerRow.name == worker.name))


def clusters_of(session: Session, since: float) -> list[ClusterState]:
    """Return the clusters of workers seen since an instant, each once, the one with most threads last."""
    stored = session.scalars(select(WorkerRow.cluster).where(WorkerRow.seen_at >= since)).all()
    states = sorted((ClusterState.read(each) for each in stored if each is not None), key=lambda s: s.threads)
    return [*{state.scheduler: state for state in states}.values()]
