"""Axes of sweeps: values that the service computes."""

from collections.abc import Mapping
from dataclasses import dataclass

from polhode.documents.quantities import Exact, written
from polhode.errors import WrongArgumentError


@dataclass(frozen=True, slots=True)
class Span:
    """Values between two ends, as a section of a sweep's document."""

    section: Mapping[str, object]


def linspace(first: Exact, last: Exact, count: int) -> Span:
    """Return ``count`` equidistant values, both ends included."""
    return _span("linspace", first, last, count)


def logspace(first: Exact, last: Exact, count: int) -> Span:
    """Return ``count`` values with equal ratios from ``first`` > 0 to ``last`` > 0, both ends included."""
    return _span("logspace", first, last, count)


def uniform(first: Exact, last: Exact, count: int, *, seed: int) -> Span:
    """Return ``count`` random values; the same seed brings the same ones."""
    return Span({**_span("uniform", first, last, count).section, "seed": seed})


def axis_section(values: object) -> Mapping[str, object]:
    """Return the section for the values of an axis: a span, or a list, range or array of numbers.

    Raises
    ------
    WrongArgumentError
        It is neither.
    """
    if isinstance(values, Span):
        return values.section
    listed = written(values)
    if not isinstance(listed, list):
        raise WrongArgumentError(
            f"{values!r} is no axis; a list, an array, or linspace(lo, hi, n) is accepted"
        )
    return {"values": listed}


def _span(kind: str, first: Exact, last: Exact, count: int) -> Span:
    return Span({kind: [written(first), written(last), count]})
