"""Warms the children of a worker before it takes jobs: each solves small problems, so that code is loaded.

A worker whose children cannot be warmed says why in its log and takes jobs all the same: the fault may
concern one tier only, and each job tells its own faults. Killed children are replaced and warmed once more.
"""

import logging
import threading
import time
from collections.abc import Callable

from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError

logger = logging.getLogger(__name__)

LIMIT_SECONDS = 600.0
"""Compiling everything takes a minute or two, several on a busy machine."""


class Warming:
    """Starts the children of a sandbox and has each call ``warm_up``, in threads of its own.

    Parameters
    ----------
    warm_up
        A module-level function that solves problems, in a child. None: there is nothing to warm.
    slots
        The number of children.
    wake
        Called from another thread when this is over.
    """

    def __init__(
        self, sandbox: Sandbox, warm_up: Callable[[], None] | None, *, slots: int, wake: Callable[[], None]
    ) -> None:
        self._sandbox = sandbox
        self._warm_up = warm_up
        self._slots = slots
        self._wake = wake
        self._over = threading.Event()

    def start(self) -> None:
        """Begin; without anything to warm this only starts the children."""
        if self._warm_up is None:
            self._sandbox.start()
            self._over.set()
            return
        threading.Thread(target=self._run, args=(self._warm_up,), name="warming", daemon=True).start()

    def is_over(self) -> bool:
        """Tell whether jobs may be taken."""
        return self._over.is_set()

    def _run(self, warm_up: Callable[[], None]) -> None:
        began = time.monotonic()
        # This waits until the fork server has loaded its modules; only then does the time of a call begin.
        self._sandbox.start()
        faults: list[str] = []
        threads = [
            threading.Thread(target=self._warm_one, args=(warm_up, faults), name=f"warming {k}", daemon=True)
            for k in range(self._slots)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        seconds = round(time.monotonic() - began, 3)
        if not self._sandbox.is_closed:
            for fault in sorted(set(faults)):
                logger.warning("not warm, and taking jobs all the same: %s", fault)
            if not faults:
                logger.info("warm after %.1f s", seconds, extra={"fields": {"seconds": seconds}})
        self._over.set()
        self._wake()

    def _warm_one(self, warm_up: Callable[[], None], faults: list[str]) -> None:
        # Every call goes to the child with the fewest, hence one to each.
        try:
            self._sandbox.run(warm_up, seconds=LIMIT_SECONDS)
        except SandboxTimeoutError:
            faults.append(f"not finished after {LIMIT_SECONDS:g} s")
        except SandboxMemoryError:
            faults.append("more memory needed than one job may take")
        except SandboxCrashError as fault:
            faults.append(str(fault))
        except Exception as fault:
            faults.append(f"{type(fault).__name__}: {fault}")
