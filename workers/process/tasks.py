"""The functions that a worker's child processes run; the worker itself never imports the solvers.

The solvers and their libraries take a second or two to load. The fork server loads them once for all
children; the worker, which only manages leases and children, starts at once and restarts quickly after it
was killed.

The fork server first loads what most planar motions need, so that first children work after half the time.
Then a child asks it, by a signal, to load the rest (integrators, and all else that first jobs seldom need),
and children forked later begin with all code loaded. A signal, since a fork server takes no other orders: it
only forks. Its handler runs between two forks, in the only thread that there is.
"""

import importlib
import logging
import os
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import TYPE_CHECKING

from service.jobs.records import ChunkOutcome, JobKind, JobResult, Refused, SolveOutcome, StoredSolution

if TYPE_CHECKING:  # the children that load this module need no database
    from workers.process.pool import Computations

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


@dataclass(frozen=True, slots=True)
class WorkerTasks:
    """The computations of a worker, and the preparations for them."""

    computations: "Computations"
    name: str
    """``module:attribute`` of this, by which other processes find it."""
    preload: Sequence[str] = ()
    """Modules that the computations need, beside their own."""
    warm_up: WarmUp | None = None
    """Functions that its children call before and after it begins to take jobs."""

    def modules(self) -> list[str]:
        """Return the names of all modules that children need."""
        return [*(computation.__module__ for computation in self.computations.values()), *self.preload]


PRELOAD = (
    "workers.computation.compute",
    "workers.sweeping.warming",
    "workers.process.preloaded",
)
"""Modules for the fork server: what the functions here import, and at last one that loads compiled code."""
LATE = ("workers.solvers.integration.dop853", "workers.computation.atlases")
"""Modules for it that come late: they load SymPy and SciPy. A job that needs one earlier loads it."""

_server: int | None = None
"""The process id of the fork server, which its children inherit. A fork server is told by what it imports,
so that there is no object in which to keep it."""


def solve_problem(
    document_json: str, windows_json: str = "", audited: StoredSolution | None = None
) -> SolveOutcome:
    """Call :func:`workers.computation.compute.solve_document`, or of an audit ``audit_document``."""
    if audited is not None:
        from workers.computation.audit import audit_document  # noqa: PLC0415

        return audit_document(document_json, windows_json, audited)
    from workers.computation.compute import solve_document  # noqa: PLC0415

    return solve_document(document_json, windows_json)


def solve_examined(document_json: str, report_json: str) -> SolveOutcome:
    """Call :func:`workers.computation.compute.solve_judged`."""
    from workers.computation.compute import solve_judged  # noqa: PLC0415

    return solve_judged(document_json, report_json)


def solve_chunk(document_json: str) -> ChunkOutcome:
    """Call :func:`workers.sweeping.chunk.compute_chunk`."""
    from workers.sweeping.chunk import compute_chunk  # noqa: PLC0415

    return compute_chunk(document_json)


def draw_atlas(document_json: str) -> JobResult | Refused:
    """Call :func:`workers.computation.atlases.draw_document`."""
    from workers.computation.atlases import draw_document  # noqa: PLC0415

    return draw_document(document_json)


def study(document_json: str, *tell: Callable[[float], None]) -> JobResult | Refused:
    """Call :func:`workers.computation.studies.study_document`."""
    from workers.computation.studies import study_document  # noqa: PLC0415

    return study_document(document_json, *tell)


def _warm_up_for_planar_motions() -> None:
    from workers.sweeping.warming import warm_up_for_first_jobs  # noqa: PLC0415

    warm_up_for_first_jobs()


def accept_orders() -> None:
    """Load the rest when a child asks for it. Called in a fork server, when it begins."""
    global _server
    signal.signal(signal.SIGUSR1, _load_the_rest)
    _server = os.getpid()


def _load_the_rest(_signal: int, _frame: FrameType | None) -> None:
    try:
        for name in LATE:
            importlib.import_module(name)
        from workers.sweeping.warming import is_compiled, warm_up_before_forks  # noqa: PLC0415

        if is_compiled():
            warm_up_before_forks()
    except Exception as fault:  # children meet it too, and their worker says what is wrong
        logging.getLogger(__name__).debug("the rest is not loaded ahead: %s", fault)


def _ask_for_the_rest() -> None:
    """Have the fork server load the rest before it forks again; outside of its children this does nothing."""
    # If the fork server has died, the parent is another process, which the signal might end.
    if _server is not None and os.getppid() == _server:
        os.kill(_server, signal.SIGUSR1)


def _warm_up_for_all() -> None:
    from workers.sweeping.warming import warm_up  # noqa: PLC0415

    warm_up()


def _is_compiled() -> bool:
    from workers.sweeping.warming import is_compiled  # noqa: PLC0415

    return is_compiled()


WARM_UP = WarmUp(_warm_up_for_planar_motions, _ask_for_the_rest, _warm_up_for_all, _is_compiled)
"""First what the fork server has loaded by then; then all, after it has loaded the integrators too."""
COMPUTATIONS: "Computations" = {
    JobKind.SOLVE: solve_problem,
    JobKind.CHUNK: solve_chunk,
    JobKind.ATLAS: draw_atlas,
    JobKind.STUDY: study,
}
TASKS = WorkerTasks(COMPUTATIONS, "workers.process.tasks:TASKS", PRELOAD, WARM_UP)
"""The computations of a worker."""
