"""A real worker for the tests: ``python -m tests.workers.worker_process SLOTS [WAKE_FD]``."""

import logging
import sys

from service.settings import Settings
from tests.workers.chores import do_chore
from workers.engines.local import run_worker

if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    slots, *wake_fd = map(int, sys.argv[1:])
    run_worker(do_chore, Settings(), slots=slots, wake_fd=wake_fd[0] if wake_fd else None)
