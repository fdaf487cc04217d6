"""What a command has a child process compute: the command itself never loads the solvers.

They take a second or two to load. The fork server loads ``PRELOAD`` for its
children; a command that loaded them too would make its user wait, for nothing.
"""

from service.jobs.outcome import SolveOutcome

PRELOAD = ("workers.computation.compute",)
"""Modules for the fork server: what the functions here import when they are called."""


def solve_judged(document_json: str, report_json: str) -> SolveOutcome:
    """Call :func:`workers.computation.compute.solve_judged`."""
    from workers.computation.compute import solve_judged as solve  # noqa: PLC0415

    return solve(document_json, report_json)
