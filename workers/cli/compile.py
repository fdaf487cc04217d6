"""``python -m workers compile``: compiles the fast solvers before a job has to wait for it."""

import time

from rich.console import Console

from service.terminal import answer, say
from workers.sweeping.warming import WarmingError, warm_up


def compile_solvers() -> int:
    """Solve the problems that workers solve before their first job; return 0 if all are solved."""
    began = time.monotonic()
    # Shows nothing where stderr is not a terminal.
    with Console(stderr=True).status("compiling the solvers …"):
        try:
            warm_up()
        except WarmingError as fault:
            say(f"the solvers do not work here: {fault}")
            return 1
    answer(f"the solvers are ready after {time.monotonic() - began:.1f} s\n")
    return 0
