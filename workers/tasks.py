"""What a worker has its children do, without loading it itself.

The solvers and their libraries take a second or two to load. The fork server
loads them once, and hands them to the children; the worker, which only leases
and watches, is there at once, and soon there again after it was killed.
"""

from service.jobs.outcome import ChunkOutcome, SolveOutcome
from service.jobs.states import JobKind
from workers.runner import Computations

PRELOAD = ("workers.computation", "workers.sweeping.chunk")
"""Modules for the fork server: what the functions here import when they are called."""


def solve_problem(document_json: str) -> SolveOutcome:
    """Call :func:`workers.computation.solve_document`."""
    from workers.computation import solve_document  # noqa: PLC0415

    return solve_document(document_json)


def solve_chunk(document_json: str) -> ChunkOutcome:
    """Call :func:`workers.sweeping.chunk.compute_chunk`."""
    from workers.sweeping.chunk import compute_chunk  # noqa: PLC0415

    return compute_chunk(document_json)


COMPUTATIONS: Computations = {JobKind.SOLVE: solve_problem, JobKind.CHUNK: solve_chunk}
