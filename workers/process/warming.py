"""Warms the children of a worker in two stages: each solves small problems, so that code is loaded.

In the first stage the children get ready for most planar motions, and from then on the worker takes jobs.
Where kernels are not compiled yet, that is the plain way, and a task in the background compiles them.
In the second stage, when they are there, the fork server loads the rest, and each child is replaced by a new
one, which has all of it; only then is the worker warm. A motion by integration that comes earlier is computed
too: its child loads what it needs.

A worker whose children cannot be warmed says why in its log and takes jobs all the same: the fault may
concern one tier only, and each job tells its own faults. Killed children are replaced and warmed once more.
"""

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

from service.jobs.kernels import Kernels
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from workers.process.compiling import Compiling

logger = logging.getLogger(__name__)

LIMIT_SECONDS = 120.0
"""Loading everything takes some seconds, more on a busy machine; nothing is compiled here."""

_QUEUE_SECONDS = 5.0
"""How long the call of one child waits for those of the others to be queued."""

Call = Callable[[], None]


@dataclass(frozen=True, slots=True)
class WarmUp:
    """Module-level functions that children call."""

    first: Call
    """Each child, before the worker takes jobs."""
    order: Call | None = None
    """Some child, when all have called the first: has the fork server load the rest."""
    rest: Call | None = None
    """Each child that is forked after that, before it replaces an older one. None: there is one stage."""
    is_compiled: Callable[[], bool] | None = None
    """Some child, before the second stage: whether there is nothing to compile. None: there never is."""


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
        told = list[bool]()
        _at_once([lambda: told.append(self._sandbox.run(is_compiled, seconds=LIMIT_SECONDS))])
        return any(told)

    def _in_every_child(self, call: Call) -> list[str]:
        # Each goes to the child with the fewest calls: if all are queued before one ends, each gets one.
        are_queued = threading.Barrier(self._slots)

        def wait_for_others(_: Future[None]) -> None:
            with suppress(threading.BrokenBarrierError):
                are_queued.wait(_QUEUE_SECONDS)
            are_queued.abort()  # a call that is repeated waits for nobody

        warm_one = partial(self._sandbox.run, call, seconds=LIMIT_SECONDS, submitted=wait_for_others)
        return _at_once([warm_one] * self._slots)

    def _in_new_children(self, order: Call | None, call: Call) -> list[str]:
        faults = [] if order is None else _at_once([lambda: self._sandbox.run(order, seconds=LIMIT_SECONDS)])
        return faults + _at_once([partial(self._replace, k, call) for k in range(self._slots)])

    def _replace(self, slot: int, call: Call) -> None:
        try:
            self._sandbox.replace(slot, call, seconds=LIMIT_SECONDS)
        except SandboxCrashError:  # perhaps killed from outside
            self._sandbox.replace(slot, call, seconds=LIMIT_SECONDS)


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
        faults.append(f"not finished after {LIMIT_SECONDS:g} s")
    except SandboxMemoryError:
        faults.append("more memory needed than one job may take")
    except SandboxCrashError as fault:
        faults.append(str(fault))
    except CancelledError:
        faults.append("the children were stopped")
    except Exception as fault:
        faults.append(f"{type(fault).__name__}: {fault}")
