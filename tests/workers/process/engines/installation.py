"""One installation: a database, an engine, and workers on several hosts."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import text

from service.local.wakeup import WakeUpSocket
from service.storage.database.database import Database
from service.storage.jobs.job_store import JobStore
from service.storage.jobs.queue import announce
from service.storage.solutions.solution_store import SolutionStore
from service.storage.sweeps.sweep_store import SweepStore
from tests.workers.processes import Worker, network_apart

HOUR = 3600.0


class Installation:
    """What the tests of engines need to know of one."""

    def __init__(self, url: str, engine: str, folder: Path) -> None:
        self.engine = engine
        self.folder = folder
        self.url = url
        self.database = Database(url, announces_jobs=engine == "postgres")
        self.jobs = JobStore(self.database)
        self.solutions = SolutionStore(self.database)
        self.sweeps = SweepStore(self.database)
        self.wake_up = WakeUpSocket()
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
            "wake_up": self.wake_up if is_local else None,
            "begins_with": () if is_local else network_apart(),
            **options,
        }
        self._workers.append(Worker(self.url, **chosen))
        return self._workers[-1]

    def announce_again(self) -> None:
        """Announce jobs once more than needed."""
        with self.database.write_rows() as connection:
            announce(self.database, connection)
        self.wake_up.notify()

    def count(self, table: str) -> int:
        """Return the number of rows."""
        with self.database.read() as session:
            return session.scalars(text(f"SELECT count(*) FROM {table}")).one()

    def close(self) -> None:
        """Kill the workers, close the rest."""
        for worker in self._workers:
            worker.clean_up()
        self.wake_up.close()
        self.database.close()


@contextmanager
def installed(url: str, engine: str, folder: Path) -> Iterator[Installation]:
    """Set up an installation on a migrated database, and clear it away."""
    installation = Installation(url, engine, folder)
    try:
        yield installation
    finally:
        installation.close()
