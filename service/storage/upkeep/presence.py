"""Keeps a row in the database for each live service and worker, and lists who else uses the database.

The row of a worker is refreshed by its heartbeat, the row of a service by a thread. The same write shows
whether the database can be written to: a reader does not notice a full or read-only disk.
"""

import contextlib
import logging
import os
import sqlite3
import threading
import time
from collections.abc import Callable
from typing import Literal

from sqlalchemy import Connection, delete, insert, inspect, select, update
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from service.jobs.kernels import ClusterState, Kernels
from service.local.workers import OtherHostError, WorkerProcess, new_worker_name, this_host
from service.logs import Complaints
from service.storage.database.availability import is_postgres_error
from service.storage.database.database import Database
from service.storage.database.migration import refuse_unknown
from service.storage.database.rows import database_now
from service.storage.tables.base import DatabaseNow, table_of
from service.storage.tables.operations import WorkerRow

logger = logging.getLogger(__name__)


SEEN_SECONDS = 5.0
"""How often a service refreshes its presence row."""
GONE_SECONDS = 30.0
"""A service or worker that was silent for so long counts as gone. Workers write every 10 s."""
SERVICE = "service"
"""The engine name in the row of a service, which has no slots."""
_RETRY_SECONDS = 1.0
"""Pause after a write that failed."""
_STOP_SECONDS = 2.0
"""How long a shutdown waits to remove the row; else the row expires."""

_workers = table_of(WorkerRow)


class ServicePresence:
    """A thread that refreshes the presence row of this service.

    Parameters
    ----------
    host
        What this machine is called; its own name if None.
    is_only
        Whether no other service should use the database: a warning says that one does.
    seconds
        Between two writes.
    clock
        Of durations, in seconds.
    """

    def __init__(
        self,
        database: Database,
        *,
        host: str | None = None,
        is_only: bool = False,
        seconds: float = SEEN_SECONDS,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._database = database
        self._host = host or this_host()
        self._name = new_worker_name(self._host)
        self._is_only = is_only
        self._seconds = seconds
        self._clock = clock
        # On a full disk some writes succeed and others do not.
        self._complaints = Complaints(logger)
        self._fault: str | None = None
        self._began_at: float | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="presence", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def fault(self) -> str | None:
        """Return why the database cannot be written to; None if no reason is known. Never waits."""
        if self._database.file is not None and (fault := self._database.file.fault()):
            return fault
        began_at = self._began_at
        if began_at is not None and self._clock() - began_at > self._seconds:
            return f"a write has been waiting for {self._clock() - began_at:.0f} s"
        return self._fault

    def write(self) -> None:
        """Write the presence row once, and remember whether that succeeded."""
        self._began_at = self._clock()
        try:
            self._see()
            self._shrink_log()
        except SQLAlchemyError as fault:
            reason = _reason(fault)
            if self._fault is None:
                self._complaints.tell(f"nothing can be written to the database: {reason}", kind="away")
            self._fault = reason
        else:
            if self._fault is not None:
                self._complaints.tell("the database can be written to again")
            self._fault = None
        finally:
            self._began_at = None

    def close(self) -> None:
        """Stop, and remove the row; if that takes too long, the row is left to expire."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(_STOP_SECONDS)

    def _keep(self) -> None:
        if self._is_only:
            self._tell_of_others()
        while not self._stopping.is_set():
            self.write()
            self._stopping.wait(self._seconds if self._fault is None else min(self._seconds, _RETRY_SECONDS))
        with contextlib.suppress(SQLAlchemyError), self._database.write_rows(is_work=False) as connection:
            connection.execute(delete(_workers).where(_workers.c.name == self._name))

    def _tell_of_others(self) -> None:
        # What is wrong with the database the first write tells.
        with contextlib.suppress(SQLAlchemyError), self._database.read_rows() as connection:
            for host, process, seconds in _services(connection):
                # A name is given again where a machine or a container has restarted, and so is a number.
                if host == self._host and (process == os.getpid() or not _is_alive(process)):
                    continue
                logger.warning(
                    "another service uses this database: process %d of %s (seen %.0f s ago). Workers of "
                    "either compute the jobs of both, but each counts requests and waiting clients by itself",
                    *(process, host, max(seconds, 0.0)),
                )

    def _shrink_log(self) -> None:
        if self._database.file is not None:
            # That it is in use, or gone, is seen elsewhere.
            with contextlib.suppress(sqlite3.Error):
                self._database.file.shrink_log()

    def _see(self) -> None:
        with self._database.write_rows(is_work=False) as connection:
            here = _workers.c.name == self._name
            if not connection.execute(update(_workers).where(here).values(seen_at=DatabaseNow())).rowcount:
                row = {"name": self._name, "host": self._host, "engine": SERVICE, "slots": 0}
                connection.execute(
                    insert(_workers).values(**row, started_at=DatabaseNow(), seen_at=DatabaseNow())
                )


def who_is_present(connection: Connection) -> list[str]:
    """Return, in words, which services and workers use a database at this time.

    A row with a time in the future counts too, unless it is so far ahead that
    the clock must have been set back since.
    """
    if not inspect(connection).has_table(_workers.name):
        return []
    silence = (DatabaseNow() - _workers.c.seen_at).label("silence")
    statement = select(_workers.c.host, _workers.c.slots, silence).order_by(silence)
    return [
        f"{'a worker' if slots else 'a service'} of {host} (seen {max(seconds, 0.0):.0f} s ago)"
        for host, slots, seconds in connection.execute(statement)
        if abs(seconds) <= GONE_SECONDS
    ]


def _services(connection: Connection) -> list[tuple[str, int, float]]:
    """Return host, process and seconds of silence of each service that uses a database."""
    silence = (DatabaseNow() - _workers.c.seen_at).label("silence")
    statement = select(_workers.c.host, _workers.c.name, silence).where(_workers.c.engine == SERVICE)
    return [
        (host, int(name.rsplit(":", 2)[1]), seconds)
        for host, name, seconds in connection.execute(statement)
        if abs(seconds) <= GONE_SECONDS
    ]


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True  # somebody else's
    return True


def _reason(fault: SQLAlchemyError) -> str:
    """Return the database's message without the address that a driver may add, which is private."""
    said = getattr(fault, "orig", None)
    has_code = is_postgres_error(said) and said.sqlstate is not None
    if isinstance(said, sqlite3.Error) or has_code:
        return str(said).splitlines()[0]
    return "it does not answer"


def forget_everybody(connection: Connection) -> None:
    """Remove all rows: in a restored backup they are of the time when it was made."""
    connection.execute(delete(_workers))


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
