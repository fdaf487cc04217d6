"""A real worker for the tests: ``python -m tests.workers.worker_process SLOTS [WAKE_FD]``.

Its clock is wrong by CLOCK_SHIFT seconds of its environment. With ``fork FD``
it makes such workers, each a fork of itself, whenever it is asked to: see
``forked_process.py``.
"""

import os
import sys
import time
from collections.abc import Sequence

from tests.workers.chores import TASKS


def shift_clock(seconds: float) -> None:
    """Let this process think that it is later than it is; clocks that only measure durations go on."""
    true_time, true_time_ns = time.time, time.time_ns
    time.time = lambda: true_time() + seconds
    time.time_ns = lambda: true_time_ns() + int(seconds * 1e9)


def work(arguments: Sequence[str]) -> None:
    # Here, since the fork server imports this module too: what only a worker needs takes a second to load.
    import logging  # noqa: PLC0415

    from service.settings import Settings  # noqa: PLC0415
    from workers.process.start import run_worker  # noqa: PLC0415

    shift_clock(float(os.environ["CLOCK_SHIFT"]))
    logging.basicConfig(level=logging.INFO)
    slots, *wake_fd = map(int, arguments)
    run_worker(TASKS, Settings(), slots=slots, wake_fd=wake_fd[0] if wake_fd else None)


def main() -> None:
    if sys.argv[1] != "fork":
        work(sys.argv[1:])
        return
    from tests.workers.forking import fork_whenever_asked  # noqa: PLC0415

    fork_whenever_asked(int(sys.argv[2]), work)


if __name__ == "__main__":
    main()
