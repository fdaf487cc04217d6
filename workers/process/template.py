"""Code that the fork server of a worker loads late: integrators, and all else that first jobs seldom need.

The fork server first loads what most planar motions need, so that first children work after half the time.
Then a child asks it, by a signal, to load the rest, and children forked later begin with all code loaded.
A signal, since a fork server takes no other orders: it only forks. Its handler runs between two forks, in
the only thread that there is.
"""

import importlib
import logging
import os
import signal
from types import FrameType

LATE = (
    "workers.solvers.integration.dop853",
    "workers.computation.atlases",
    "workers.process.preloaded_late",
)
"""They load SymPy, SciPy, and the rest of compiled code. A job that needs one earlier loads it."""

_server: int | None = None
"""The process id of the fork server, which its children inherit. A fork server is told by what it imports,
so that there is no object in which to keep it."""


def accept_orders() -> None:
    """Load the rest when a child asks for it. Called in a fork server, when it begins."""
    global _server
    signal.signal(signal.SIGUSR1, _load)
    _server = os.getpid()


def ask_for_the_rest() -> None:
    """Have the fork server load the rest before it forks again; outside of its children this does nothing."""
    # If the fork server has died, the parent is another process, which the signal might end.
    if _server is not None and os.getppid() == _server:
        os.kill(_server, signal.SIGUSR1)


def _load(_signal: int, _frame: FrameType | None) -> None:
    for name in LATE:
        try:
            importlib.import_module(name)
        except Exception as fault:  # children meet it too, and their worker says what is wrong
            logging.getLogger(__name__).debug("%s is not loaded ahead: %s", name, fault)
