"""Has kernels compiled in the background, by a process of its own, while the worker takes jobs.

It is no child of the sandbox: compiling has neither the time limit nor the memory limit of a job. It ends
with the worker, which holds the other end of its stdin; what it has compiled is there the next time.
"""

import json
import logging
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from contextlib import suppress

from service.jobs.kernels import KERNELS, Kernels
from service.local.worker_command import worker_command
from service.pools import cause_of_death

logger = logging.getLogger(__name__)

TELL_SECONDS = 10.0
"""How often the log tells how far it is."""
_LOOK_SECONDS = 0.2
_TRIES = 3
_NOT_STARTED = 127
"""As a shell has it."""


class Compiling:
    """The compiling task of a worker; ``wake`` is called, from another thread, when there is news of it."""

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
                worker_command("compile", "--in-background"),
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
            time.sleep(_LOOK_SECONDS)
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
        told_at = -TELL_SECONDS
        for line in task.stdout or ():
            with suppress(ValueError, TypeError):
                self.kernels = Kernels.read(json.loads(line))
                if time.monotonic() >= told_at + TELL_SECONDS:
                    told_at = time.monotonic()
                    logger.info("%s", self.kernels)
                    self._wake()
