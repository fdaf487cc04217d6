"""Which workers there are: each writes that it lives, as long as it does."""

from sqlalchemy import delete, select

from service.jobs.hosts import OtherHostError, WorkerProcess
from service.storage.clock import DatabaseNow, database_now
from service.storage.database import Database
from service.storage.operation_tables import WorkerRow

SILENT_LEASES = 3
"""A worker that has not been seen for so many leases is taken to be gone."""
FORGOTTEN_SECONDS = 86_400.0
"""After which the row of a worker that was killed is removed."""


class WorkerRegistry:
    """Registers workers. One method is one transaction."""

    def __init__(self, database: Database, *, lease_seconds: float) -> None:
        self._database = database
        self._silent_seconds = SILENT_LEASES * lease_seconds

    def enter(self, worker: WorkerProcess, *, alone: bool) -> None:
        """Register a worker that starts; ``alone``: only on a machine that has the database to itself.

        Raises
        ------
        OtherHostError
            A worker of another machine was there before, and lives.
        """
        self.see(worker)
        if not alone:
            return
        # Entered first and looked afterwards: of two that start at once, one sees the other at least.
        with self._database.read() as session:
            now = database_now(session)
            before = (
                select(WorkerRow)
                .where(WorkerRow.host != worker.host, WorkerRow.seen_at >= now - self._silent_seconds)
                .where(WorkerRow.slots > 0)  # a service without workers may be anywhere
                .order_by(WorkerRow.seen_at.desc())
                .limit(1)
            )
            other = session.scalar(before)
        if other is not None:
            self.leave(worker)
            raise OtherHostError(worker.host, other.host, now - other.seen_at)

    def see(self, worker: WorkerProcess) -> None:
        """Write that a worker lives, even if it had been forgotten; forget those that died long ago."""
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
            row.seen_at = now
            session.execute(delete(WorkerRow).where(WorkerRow.seen_at < DatabaseNow() - FORGOTTEN_SECONDS))

    def leave(self, worker: WorkerProcess) -> None:
        """Remove a worker that stops in order."""
        with self._database.write() as session:
            session.execute(delete(WorkerRow).where(WorkerRow.name == worker.name))
