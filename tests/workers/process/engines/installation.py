"""One installation: a database, an engine, and workers on several hosts."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection, text

from service.jobs.store import Dispatcher
from service.local.wakeup import Doorbell
from service.settings import Settings
from service.storage.database.database import Database
from service.storage.jobs.dispatching import dispatcher_of
from service.storage.jobs.job_store import SqlJobStore
from service.storage.jobs.procrastinate_dispatcher import QUEUE, TASK
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from tests.workers.processes import Worker, network_apart

HOUR = 3600.0


class Installation:
    """What the tests of engines need to know of one."""

    def __init__(self, url: str, engine: str, folder: Path) -> None:
        self.engine = engine
        self.folder = folder
        self.database = Database(url)
        self.dispatcher: Dispatcher[Connection] = dispatcher_of(Settings(database_url=url, engine=engine))
        self.jobs = SqlJobStore(self.database, self.dispatcher)
        self.solutions = SolutionStore(self.database)
        self.sweeps = SweepStore(self.database, self.dispatcher)
        self.bell = Doorbell()
        self._url = url
        self._workers: list[Worker] = []

    def start_worker(self, host: int = 1, **options: object) -> Worker:
        """Start a worker as if on a machine of its own: process group, folder, name, clock, and network if
        that is allowed.

        The local engine serves one machine; there, hosts differ by the folder only.
        """
        folder = self.folder / f"host-{host}"
        folder.mkdir(exist_ok=True)
        is_local = self.engine == "local"
        chosen = {
            "folder": folder,
            "engine": self.engine,
            "host_name": "the-host" if is_local else f"host-{host}",
            # Before, at, and after the time of the database.
            "clock_shift": (host % 3 - 1) * HOUR,
            "doorbell": self.bell if is_local else None,
            "begins_with": () if is_local else network_apart(),
            **options,
        }
        self._workers.append(Worker(self._url, **chosen))
        return self._workers[-1]

    def deliver_again(self, job_id: str) -> None:
        """Deliver a job once more than needed."""
        if self.engine == "procrastinate":
            statement = text(
                "INSERT INTO procrastinate_jobs (queue_name, task_name, args) "
                "VALUES (:queue, :task, jsonb_build_object('job', CAST(:job AS text)))"
            )
            with self.database.write() as session:
                session.execute(statement, {"queue": QUEUE, "task": TASK, "job": job_id})
        self.bell.ring()

    def lose_deliveries(self) -> None:
        """Forget what was delivered and not yet taken."""
        if self.engine == "procrastinate":
            with self.database.write() as session:
                session.execute(text("DELETE FROM procrastinate_jobs"))

    def count(self, table: str) -> int:
        """Return the number of rows; of a table that this engine does not have, 0."""
        if table.startswith("procrastinate") and self.engine != "procrastinate":
            return 0
        with self.database.read() as session:
            return session.scalars(text(f"SELECT count(*) FROM {table}")).one()

    def close(self) -> None:
        """Kill the workers, close the rest."""
        for worker in self._workers:
            worker.clean_up()
        self.bell.close()
        self.database.close()


@contextmanager
def installed(url: str, engine: str, folder: Path) -> Iterator[Installation]:
    """Set up an installation on a migrated database, and clear it away."""
    installation = Installation(url, engine, folder)
    try:
        yield installation
    finally:
        installation.close()
