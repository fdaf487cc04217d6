"""Loads compiled code into the fork server of a worker, so that every child begins with it.

Unlike all other modules this one does its work when it is imported: to import modules is all that a fork
server can be told. Only a worker names it, as the last module to preload. Code that is not compiled yet is
left to the children, which can be killed: a fork server that compiles for minutes could not be stopped.

Numba looks for BLAS when it loads what compiled functions may call, and for that loads SciPy's linear
algebra. No kernel calls BLAS, so it is not found here: that is a tenth of the time in which a fork server
gets ready. SciPy is loaded later, with the integrators.
"""

import importlib
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from workers.process.tasks import accept_orders
from workers.sweeping.warming import is_compiled, warm_up_for_first_jobs

_LINEAR_ALGEBRA = "scipy.linalg"


@contextmanager
def _not_found(name: str) -> Iterator[None]:
    """Make an import of a module fail as if it were not installed, unless it is loaded already."""
    if name in sys.modules:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]  # what the import system documents for this
    try:
        yield
    finally:
        del sys.modules[name]


def _load_compiled_code() -> None:
    with _not_found(_LINEAR_ALGEBRA):
        registry = importlib.import_module("numba.core.registry")
        registry.cpu_target.target_context.refresh()
    warm_up_for_first_jobs()


accept_orders()
try:
    if is_compiled():
        _load_compiled_code()
except Exception as fault:  # the children warm up too, and their worker says what is wrong
    logging.getLogger(__name__).debug("nothing is loaded ahead: %s", fault)
