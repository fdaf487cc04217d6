"""Runs one worker process, from its settings to its shutdown."""

import selectors
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.collector import keep_what_is_loaded
from service.local.wakeup import WorkerLine
from service.sandbox import Sandbox
from service.settings import Settings
from service.stopping import StopAsked
from workers.computation.threads import use_one_thread
from workers.process.waker import Waker
from workers.process.warming import Warming, WarmUp

if TYPE_CHECKING:
    from workers.process.runner import Computations


@dataclass(frozen=True, slots=True)
class WorkerTasks:
    """The computations of a worker, and the preparations for them."""

    computations: "Computations"
    preload: Sequence[str] = ()
    """Modules that the computations need, beside their own."""
    warm_up: WarmUp | None = None
    """Functions that its children call before and after it begins to take jobs."""


def run_worker(tasks: WorkerTasks, settings: Settings, *, slots: int, wake_fd: int | None) -> None:
    """Run one worker in this process until SIGTERM, SIGINT, or the end of the service that started it.

    ``wake_fd`` is the descriptor of a wake-up socket from :class:`service.local.wakeup.Doorbell`. With one,
    the children start and warm up while the service still migrates the database.

    Raises
    ------
    OtherHostError
        The engine is for one machine, and another machine uses the database.
    UnknownRevisionError
        A later version has changed the database, perhaps since the service that starts this worker began.
    """
    use_one_thread()
    modules = [*(computation.__module__ for computation in tasks.computations.values()), *tasks.preload]
    line = None if wake_fd is None else WorkerLine(wake_fd)
    sandbox = Sandbox(slots, memory_mb=settings.job_memory_mb, preload=modules)
    waker = Waker()
    # From here on the end needs a clean-up.
    with StopAsked() as stop:
        stop.tell(waker)
        warming = Warming(sandbox, tasks.warm_up, slots=slots, wake=waker)
        try:
            warming.start()
            # Not at the top: the children start while this process loads what the database needs.
            from workers.process.database_work import Equipment, use_database  # noqa: PLC0415

            keep_what_is_loaded()
            if line is None or _is_database_ready(line, waker, stop):
                warming.go_on()
                equipment = Equipment(sandbox, warming, waker, line, stop)
                use_database(tasks.computations, settings, slots, equipment)
        finally:
            sandbox.close()
            if line is not None:
                line.close()
            waker.close()


def _is_database_ready(line: WorkerLine, waker: Waker, stop: StopAsked) -> bool:
    """Wait for the first message of the service; False if the end comes before."""
    with selectors.PollSelector() as selector:
        for bell in (line, waker):
            selector.register(bell, selectors.EVENT_READ)
        while not stop.is_asked:
            heard = [key.fileobj for key, _ in selector.select()]
            if line in heard:
                return line.is_open()
            waker.clear()
    return False
