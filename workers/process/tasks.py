"""The functions that a worker's child processes run; the worker itself never imports the solvers.

The solvers and their libraries take a second or two to load. The fork server loads them
once for all children; the worker, which only manages leases and children, starts at once
and restarts quickly after it was killed.
"""

from typing import TYPE_CHECKING

from service.jobs.records import ChunkOutcome, Drawn, JobKind, Refused, SolveOutcome, StoredSolution
from workers.process.warming import WarmUp

if TYPE_CHECKING:  # the children that load this module need no database
    from workers.process.runner import Computations

PRELOAD = (
    "workers.computation.compute",
    "workers.sweeping.warming",
    "workers.process.preloaded",
)
"""Modules for the fork server: what the functions here import, and at last one that loads compiled code."""


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


def draw_atlas(document_json: str) -> Drawn | Refused:
    """Call :func:`workers.computation.atlases.draw_document`."""
    from workers.computation.atlases import draw_document  # noqa: PLC0415

    return draw_document(document_json)


def _warm_up_for_planar_motions() -> None:
    from workers.sweeping.warming import warm_up_for_first_jobs  # noqa: PLC0415

    warm_up_for_first_jobs()


def _ask_for_the_rest() -> None:
    from workers.process.template import ask_for_the_rest  # noqa: PLC0415

    ask_for_the_rest()


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
}
