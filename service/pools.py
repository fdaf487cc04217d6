"""Helpers for pebble's pools: the faults of processes around a child, and stopping a pool."""

import contextlib
import signal
from concurrent.futures.process import BrokenProcessPool

from pebble import ProcessPool

BREAKAGES = (OSError, EOFError, RuntimeError, BrokenProcessPool)
"""Raised by starting a child, or passing it a call, when the processes around it have died."""


def stop(pool: ProcessPool) -> None:
    """Kill the children of a pool, and wait for its threads."""
    with contextlib.suppress(*BREAKAGES):
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()


def cause_of_death(exit_code: int) -> str:
    """Return in words how a process ended."""
    if exit_code >= 0:
        return f"ended with code {exit_code}"
    with contextlib.suppress(ValueError):
        return f"died of {signal.Signals(-exit_code).name}"
    return f"died of signal {-exit_code}"
