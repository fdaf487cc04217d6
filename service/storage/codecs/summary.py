"""Extracts the numbers of a solution that have database columns from its documents."""

import math
from collections.abc import Mapping
from fractions import Fraction
from typing import TypedDict

from service.schemas.reading.documents import Part

FIRST_PASSAGE = "first_pole_passage"
"""In the evidence: the time until which a motion needs none of its conventions."""
PROVEN_SAMPLES = "proven_samples"
"""In the evidence, and the code of a warning: how samples were enclosed that have no other origin."""


class SummaryColumns(TypedDict):
    """Values of the columns; None where a solution has no such number."""

    family: str | None
    method: str | None
    tier: str | None
    A: float | None
    C: float | None
    period: float | None
    energy: float | None
    error: float | None
    B: float | None
    lambda_: float | None
    drift: float | None
    trace: float | None
    seconds: float | None
    stability: str | None
    aperiodic: str | None


def summary_columns(problem: Part, summary: Part) -> SummaryColumns:
    """Return the columns of a solution, from its canonical problem and its summary."""
    return SummaryColumns(
        family=_word(_at(problem, "potential", "type")),
        method=_word(_at(summary, "method")),
        tier=_word(_at(summary, "tier")),
        A=_number(_at(problem, "body", "A")),
        C=_number(_at(problem, "body", "C")),
        period=_number(_at(summary, "period", "value")),
        energy=_number(_at(summary, "energy", "value")),
        error=_number(_at(summary, "error")),
        B=_number(_at(problem, "body", "B")),
        lambda_=_number(_at(problem, "motion", "lambda")),
        drift=_largest_drift(_at(summary, "invariants")),
        trace=_number(_middle(_at(summary, "stability", "trace"))),
        seconds=_number(_at(summary, "cost", "compute_seconds")),
        stability=_word(_at(summary, "stability", "verdict")),
        aperiodic=_word(_at(summary, "aperiodic")),
    )


def _largest_drift(invariants: object) -> float | None:
    if not isinstance(invariants, Mapping):
        return None
    drifts = [_number(_at(each, "drift")) for each in invariants.values()]
    return max((drift for drift in drifts if drift is not None), default=None)


def _at(document: object, *keys: str) -> object:
    for key in keys:
        if not isinstance(document, Mapping):
            return None
        document = document.get(key)
    return document


def _middle(value: object) -> object:
    """Return a number itself, or the middle of an enclosure."""
    return _at(value, "value") if isinstance(value, Mapping) else value


def _word(value: object) -> str | None:
    return value if isinstance(value, str) else None


def _number(value: object) -> float | None:
    """Return a JSON number, or the exact number in a string, rounded to a double."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(Fraction(value) if isinstance(value, str) else value)
    except (ValueError, OverflowError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) else None
