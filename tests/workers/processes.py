"""Start real workers, watch them and their children, and leave none behind."""

import contextlib
import functools
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from sqlalchemy import select
from sqlalchemy.exc import OperationalError

from service.local.wakeup import WakeUpSocket
from service.storage.database.database import Database
from service.storage.tables.jobs import JobRow
from tests.support.waiting import PATIENCE, process_ids, state_of, wait_until
from tests.workers.forked_process import ForkedProcess

ROOT = Path(__file__).parents[2]
OWN_NETWORK = ("unshare", "--net")


@functools.cache
def network_apart() -> tuple[str, ...]:
    """Return what a command begins with that gets a network of its own, nothing where that is not allowed.

    Files, the sockets of Postgres among them, are shared all the same.
    """
    if shutil.which("unshare") is None:
        return ()
    allowed = subprocess.run([*OWN_NETWORK, "true"], capture_output=True).returncode == 0
    return OWN_NETWORK if allowed else ()


def stop_between_transactions(worker: "Worker", url: str) -> None:
    """Stop a worker at a moment when it locks nothing that others need."""
    database = Database(f"{url}?timeout=0.1" if url.startswith("sqlite") else url)

    def is_caught() -> bool:
        worker.process.send_signal(signal.SIGSTOP)
        try:
            with database.write() as session:
                session.execute(select(JobRow.id).with_for_update(nowait=True))
        except OperationalError:
            worker.process.send_signal(signal.SIGCONT)
            return False
        return True

    wait_until(is_caught)
    database.close()


class Worker:
    """A worker in a process of its own, with a wake-up socket if it is given one."""

    def __init__(
        self,
        url: str,
        *,
        slots: int = 1,
        wake_up: WakeUpSocket | None = None,
        folder: Path = ROOT,
        clock_shift: float = 0.0,
        begins_with: Sequence[str] = (),
        **settings: object,
    ) -> None:
        chosen = {
            "lease_seconds": 1.0,
            "retry_seconds": 0.1,
            "poll_seconds": 0.1,
            "job_memory_mb": 300,
            **settings,
        }
        environment = {f"POLHODE_{name.upper()}": str(value) for name, value in chosen.items()}
        environment |= {"CLOCK_SHIFT": str(clock_shift), "PYTHONPATH": str(ROOT), "POLHODE_DATABASE_URL": url}
        environment = {**os.environ, **environment}
        theirs = None if wake_up is None else wake_up.new_socket()
        descriptors = [] if theirs is None else [theirs.fileno()]
        self.process: subprocess.Popen[bytes] | ForkedProcess
        has_own_network = begins_with == OWN_NETWORK
        if sys.platform != "linux" or (begins_with and not has_own_network):
            command = [sys.executable, "-m", "tests.workers.worker_process", str(slots)]
            self.process = subprocess.Popen(
                [*begins_with, *command, *map(str, descriptors)],
                cwd=folder,
                env=environment,
                pass_fds=descriptors,
                start_new_session=True,
            )
        else:
            self.process = ForkedProcess(
                [str(slots)],
                folder=folder,
                environment=environment,
                descriptors=descriptors,
                has_own_network=has_own_network,
            )
        if theirs is not None:
            theirs.close()

    def kill(self) -> None:
        """Kill the worker itself, and nothing else."""
        self.process.kill()
        self.process.wait()

    def terminate(self) -> int:
        """Ask it to stop; return its exit code."""
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(timeout=PATIENCE)

    def session(self) -> set[int]:
        """Return the ids of all living processes that this worker started, itself included."""
        return {pid for pid in process_ids() if self._owns(pid)}

    def _owns(self, pid: int) -> bool:
        state = state_of(pid)
        return state is not None and int(state[3]) == self.process.pid

    def clean_up(self) -> None:
        """Kill whatever is left of it."""
        for pid in self.session():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.process.wait()
