"""Starts one worker process: gets its children ready, compiles in the background, and runs it to its end.

Warming has two stages, in each of which the children solve small problems, so that code is loaded. In the
first they get ready for most planar motions, and from then on the worker takes jobs. Where kernels are not
compiled yet, that is the plain way, and a task in the background compiles them. In the second stage, when
they are there, the fork server loads the rest, and each child is replaced by a new one, which has all of it;
only then is the worker warm. A motion by integration that comes earlier is computed too: its child loads what
it needs.

A worker whose children cannot be warmed says why in its log and takes jobs all the same: the fault may
concern one tier only, and each job tells its own faults. Killed children are replaced and warmed once more.

This module knows no database: :mod:`workers.process.worker`, which does, is loaded while the children start.
"""

import contextlib
import json
import logging
import os
import selectors
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError
from contextlib import suppress
from functools import partial
from typing import Protocol

from service.jobs.kernels import KERNELS, ClusterState, Kernels
from service.local.wakeup import WorkerSocket
from service.local.workers import worker_command
from service.sandbox import (
    Sandbox,
    SandboxCrashError,
    SandboxMemoryError,
    SandboxTimeoutError,
    cause_of_death,
)
from service.settings import Settings
from service.startup import StopAsked, keep_what_is_loaded, use_one_thread
from workers.process.pool import ChildrenPool, Pool
from workers.process.tasks import Call, WarmUp, WorkerTasks

logger = logging.getLogger(__name__)


PROGRESS_LOG_SECONDS = 10.0
"""How often the log tells how far it is."""
_POLL_SECONDS = 0.2
_TRIES = 3
_NOT_STARTED = 127
"""As a shell has it."""


class Waker:
    """Wakes the worker loop, from other threads and from signal handlers."""

    def __init__(self) -> None:
        self._hear, self._ring = socket.socketpair()
        self._hear.setblocking(False)
        self._ring.setblocking(False)

    def __call__(self) -> None:
        """Wake the loop. If the buffer is full, it has been woken already; if it is closed, it has ended."""
        with contextlib.suppress(OSError):
            self._ring.send(b".")

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._hear.fileno()

    def clear(self) -> None:
        """Discard pending wake-ups."""
        with contextlib.suppress(BlockingIOError):
            self._hear.recv(4096)

    def close(self) -> None:
        """Close both ends."""
        self._hear.close()
        self._ring.close()


class Compiling:
    """The compiling task of a worker, in a process of its own; ``wake`` is called when there is news of it.

    It is no child of the sandbox: compiling has neither the time limit nor the memory limit of a job. It ends
    with the worker, which holds the other end of its stdin; what it has compiled is there the next time.
    ``wake`` is called from another thread.
    """

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self.kernels: Kernels | None = None
        """How far they are; None if there is nothing to compile."""

    def expect(self) -> None:
        """Say that there is something to compile; :meth:`run` follows."""
        self.kernels = Kernels(0, KERNELS, None)

    def run(self, should_stop: Callable[[], bool]) -> str | None:
        """Compile until all is there; return why it is not. A machine has one such task: others wait.

        A task that is killed, as where memory runs out, is started again, twice at most, and goes on.
        """
        logger.info("kernels are compiled in the background; until then jobs are solved without them")
        self.expect()
        self._wake()
        for _ in range(_TRIES):
            code, said = self._try(should_stop)
            if code >= 0 or should_stop():
                break
            logger.warning("the task that compiles kernels %s", cause_of_death(code))
        fault = None if code == 0 else said or f"the task {cause_of_death(code)}"
        self.kernels = None if fault is None else Kernels(0, KERNELS, None, fault)
        self._wake()
        return None if fault is None else f"kernels are not compiled: {fault}"

    def _try(self, should_stop: Callable[[], bool]) -> tuple[int, str]:
        """Run the task once; return its exit code and what it said last."""
        try:
            # A group of its own, so that its second process ends with it.
            task = subprocess.Popen(
                worker_command("compile", in_background=True),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,
            )
        except OSError as fault:
            return _NOT_STARTED, f"the compiler cannot be started ({fault})"
        said: list[str] = []
        readers = [
            threading.Thread(target=self._read, args=(task,), daemon=True),
            threading.Thread(target=lambda: said.extend(task.stderr or ()), daemon=True),
        ]
        for reader in readers:
            reader.start()
        while task.poll() is None and not should_stop():
            time.sleep(_POLL_SECONDS)
        if task.returncode is None or task.returncode < 0:
            # Killed alone it leaves its second process behind, which has our pipes, too.
            with suppress(ProcessLookupError):
                os.killpg(task.pid, signal.SIGKILL)
        code = task.wait()
        for reader in readers:
            reader.join()
        for pipe in (task.stdin, task.stdout, task.stderr):
            if pipe is not None:
                pipe.close()
        return code, " ".join(said[-1:]).strip()

    def _read(self, task: "subprocess.Popen[str]") -> None:
        told_at = -PROGRESS_LOG_SECONDS
        for line in task.stdout or ():
            with suppress(ValueError, TypeError):
                self.kernels = Kernels.read(json.loads(line))
                if time.monotonic() >= told_at + PROGRESS_LOG_SECONDS:
                    told_at = time.monotonic()
                    logger.info("%s", self.kernels)
                    self._wake()


WARM_UP_SECONDS = 120.0
"""Loading everything takes some seconds, more on a busy machine; nothing is compiled here."""


class Warming:
    """Starts the children of a sandbox and has each call what warms it, in threads of its own.

    Parameters
    ----------
    warm_up
        What to call. None: there is nothing to warm.
    slots
        The number of children.
    wake
        Called from another thread when a stage is over.
    """

    def __init__(
        self, sandbox: Sandbox, warm_up: WarmUp | None, *, slots: int, wake: Callable[[], None]
    ) -> None:
        self._sandbox = sandbox
        self._warm_up = warm_up
        self._slots = slots
        self._wake = wake
        self.compiling = Compiling(wake)
        """The task that compiles meanwhile."""
        self._is_begun = threading.Event()
        self._goes_on = threading.Event()
        self._is_over = threading.Event()

    def start(self) -> None:
        """Begin; without anything to warm this only starts the children."""
        if self._warm_up is None:
            self._sandbox.start()
            self._is_begun.set()
            self._is_over.set()
            return
        threading.Thread(target=self._run, args=(self._warm_up,), name="warming", daemon=True).start()

    def go_on(self) -> None:
        """Allow the second stage: until the service serves, it needs the processors itself."""
        self._goes_on.set()

    def may_take_jobs(self) -> bool:
        """Tell whether the first stage is over."""
        return self._is_begun.is_set()

    def is_over(self) -> bool:
        """Tell whether both stages are over."""
        return self._is_over.is_set()

    def kernels(self) -> Kernels | None:
        """Return how far kernels are compiled; None if there is nothing to compile."""
        return self.compiling.kernels

    def cluster(self) -> None:
        """Jobs are computed here."""

    def _run(self, warm_up: WarmUp) -> None:
        began = time.monotonic()
        # This waits until the fork server has loaded its modules; only then does the time of a call begin.
        self._sandbox.start()
        faults = self._in_every_child(warm_up.first)
        # Before the first job, since the way of a sweep depends on it.
        is_compiled = warm_up.is_compiled is None or self._tells(warm_up.is_compiled)
        if not is_compiled:
            self.compiling.expect()
        self._is_begun.set()
        self._wake()
        if warm_up.rest is not None:
            self._goes_on.wait()
            fault = None if is_compiled else self.compiling.run(lambda: self._sandbox.is_closed)
            faults += [] if fault is None else [fault]
            faults += self._in_new_children(warm_up.order, warm_up.rest)
        seconds = round(time.monotonic() - began, 3)
        if not self._sandbox.is_closed:
            for fault in sorted(set(faults)):
                logger.warning("not warm, and taking jobs all the same: %s", fault)
            if not faults:
                logger.info("warm after %.1f s", seconds, extra={"fields": {"seconds": seconds}})
        self._is_over.set()
        self._wake()

    def _tells(self, is_compiled: Callable[[], bool]) -> bool:
        """Tell whether some child says so; one that cannot say anything does not."""
        answers = list[bool]()
        _at_once([lambda: answers.append(self._sandbox.run(is_compiled, seconds=WARM_UP_SECONDS))])
        return any(answers)

    def _in_every_child(self, call: Call) -> list[str]:
        warm = partial(self._sandbox.run, call, seconds=WARM_UP_SECONDS)
        return _at_once([partial(warm, slot=k) for k in range(self._slots)])

    def _in_new_children(self, order: Call | None, call: Call) -> list[str]:
        ordering = [] if order is None else [lambda: self._sandbox.run(order, seconds=WARM_UP_SECONDS)]
        return _at_once(ordering) + _at_once([partial(self._replace, k, call) for k in range(self._slots)])

    def _replace(self, slot: int, call: Call) -> None:
        try:
            self._sandbox.replace(slot, call, seconds=WARM_UP_SECONDS)
        except SandboxCrashError:  # perhaps killed from outside
            self._sandbox.replace(slot, call, seconds=WARM_UP_SECONDS)


def _at_once(calls: list[Call]) -> list[str]:
    """Make the calls in threads of their own; return their faults."""
    faults: list[str] = []
    threads = [
        threading.Thread(target=_note_fault, args=(call, faults), name=f"warming {k}", daemon=True)
        for k, call in enumerate(calls)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return faults


def _note_fault(call: Call, faults: list[str]) -> None:
    try:
        call()
    except SandboxTimeoutError:
        faults.append(f"not finished after {WARM_UP_SECONDS:g} s")
    except SandboxMemoryError:
        faults.append("more memory needed than one job may take")
    except SandboxCrashError as fault:
        faults.append(str(fault))
    except CancelledError:
        faults.append("the children were stopped")
    except Exception as fault:
        faults.append(f"{type(fault).__name__}: {fault}")


def run_worker(tasks: WorkerTasks, settings: Settings, *, slots: int, wake_fd: int | None) -> None:
    """Run one worker in this process until SIGTERM, SIGINT, or the end of the service that started it.

    ``wake_fd`` is the descriptor of a wake-up socket from
    :class:`service.local.wakeup.WakeUpSocket`. With one,
    the children start and warm up while the service still migrates the database.

    Raises
    ------
    OtherHostError
        The engine is for one machine, and another machine uses the database.
    UnknownRevisionError
        A later version has changed the database, perhaps since the service that starts this worker began.
    """
    use_one_thread()
    service = None if wake_fd is None else WorkerSocket(wake_fd)
    waker = Waker()
    # From here on the end needs a clean-up.
    with StopAsked() as stop:
        stop.tell(waker)
        start = _start_cluster if settings.pool == "dask" else _start_children
        pool, readiness, close = start(tasks, settings, slots, waker)
        try:
            # Not at the top: the children start while this process loads what the database needs.
            from workers.process.worker import Equipment, use_database  # noqa: PLC0415

            keep_what_is_loaded()
            if service is None or _is_database_ready(service, waker, stop):
                readiness.go_on()
                use_database(settings, slots, Equipment(pool, readiness, waker, service, stop))
        finally:
            close()
            if service is not None:
                service.close()
            waker.close()


class Readiness(Protocol):
    """The questions of a worker before it takes jobs."""

    def go_on(self) -> None:
        """Allow all preparations."""
        ...

    def may_take_jobs(self) -> bool:
        """Tell whether jobs may be taken. Once true it stays true."""
        ...

    def is_over(self) -> bool:
        """Tell whether all that jobs need is there."""
        ...

    def kernels(self) -> Kernels | None:
        """Return how far these are compiled; None if there is nothing to compile."""
        ...

    def cluster(self) -> ClusterState | None:
        """Return the cluster on which jobs are computed; None if they are here."""
        ...


_Started = tuple[Pool, Readiness, Callable[[], None]]
"""A pool, whether it is ready, and what ends it."""


def _start_children(tasks: WorkerTasks, settings: Settings, slots: int, waker: Waker) -> _Started:
    sandbox = Sandbox(slots, memory_mb=settings.job_memory_mb, preload=tasks.modules())
    warming = Warming(sandbox, tasks.warm_up, slots=slots, wake=waker)
    warming.start()
    return ChildrenPool(sandbox, tasks.computations, slots=slots, wake=waker), warming, sandbox.close


def _start_cluster(tasks: WorkerTasks, settings: Settings, _slots: int, waker: Waker) -> _Started:
    from workers.process.cluster import DaskPool, log_as_others  # noqa: PLC0415  # most have no Dask
    from workers.process.messages import refuse_pickles  # noqa: PLC0415
    from workers.process.remote import ALIVE_SECONDS  # noqa: PLC0415

    assert settings.dask_scheduler is not None
    log_as_others()
    refuse_pickles()
    pool = DaskPool(
        settings.dask_scheduler,
        tasks.name,
        memory_mb=settings.job_memory_mb,
        silent_seconds=max(settings.lease_seconds, 3 * ALIVE_SECONDS),
        wake=waker,
    )
    return pool, pool, pool.close


def _is_database_ready(service: WorkerSocket, waker: Waker, stop: StopAsked) -> bool:
    """Wait for the first message of the service; False if the end comes before."""
    with selectors.PollSelector() as selector:
        for source in (service, waker):
            selector.register(source, selectors.EVENT_READ)
        while not stop.is_asked:
            heard = [key.fileobj for key, _ in selector.select()]
            if service in heard:
                return service.is_open()
            waker.clear()
    return False
