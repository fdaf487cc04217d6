"""Solves the problem of a stored solution again, and tells how the two compare."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from math import isfinite

from service.jobs.records import Refused, SolveOutcome, StoredSolution
from workers.computation.comparison import Comparison, Sameness, compare_solutions
from workers.computation.compute import solve_document, way_to_repeat

_TOLD = ("method", "tier", "error", "provenance")
"""Facts that are reported of both solutions."""


def audit_document(document_json: str, windows_json: str, stored: StoredSolution) -> SolveOutcome:
    """Solve the problem in ``document_json`` and compare its solution with the ``stored`` one.

    Otherwise the same as :func:`workers.computation.compute.solve_document`.
    """
    outcome = solve_document(document_json, windows_json, way_to_repeat(stored))
    if isinstance(outcome, Refused):
        return outcome
    comparison = compare_solutions(stored, outcome)
    return replace(outcome, comparison=_document(comparison, stored.summary, outcome.summary))


def _document(
    comparison: Comparison, stored: Mapping[str, object], found: Mapping[str, object]
) -> dict[str, object]:
    return {
        "verdict": "disagrees" if comparison.sameness is Sameness.DIFFERENT else "agrees",
        "identical": comparison.sameness is Sameness.IDENTICAL,
        "detail": comparison.detail,
        "differences": {
            name: {part: _number(number) for part, number in asdict(difference).items()}
            for name, difference in comparison.differences.items()
        },
        "stored": {name: stored.get(name) for name in _TOLD},
        "found": {name: found.get(name) for name in _TOLD},
    }


def _number(number: float) -> float | None:
    """Return what JSON can hold: a damaged array may hold what is no number."""
    return number if isfinite(number) else None
