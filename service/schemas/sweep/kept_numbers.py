"""The closed list of numbers that a sweep can keep of each point, read from the point's solution."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.exact import exact_number
from service.dynamics.problem import Output

Document = Mapping[str, object]


@dataclass(frozen=True, slots=True)
class KeptNumber:
    """The place of a number in a solution, and the output it needs."""

    path: tuple[str, ...]
    output: Output | None
    meaning: str


def _estimate(name: str, path: tuple[str, ...], output: Output | None, meaning: str) -> dict[str, KeptNumber]:
    """Return a number and the bound of its error."""
    return {
        name: KeptNumber((*path, "value"), output, meaning),
        f"{name}.error": KeptNumber((*path, "error"), output, f"bound of the error of {name}"),
    }


def _drift(name: str) -> dict[str, KeptNumber]:
    meaning = f"largest deviation of the {name} integral over the requested samples"
    return {f"invariants.{name}.drift": KeptNumber(("invariants", name, "drift"), "invariants", meaning)}


def _integral(name: str, author: str) -> dict[str, KeptNumber]:
    meaning = f"integral of {author}, where there is one"
    number = KeptNumber(("invariants", name, "value"), "invariants", meaning)
    return {f"invariants.{name}": number, **_drift(name)}


def _stability(name: str, error: str, meaning: str) -> dict[str, KeptNumber]:
    return {
        f"stability.{name}": KeptNumber(("stability", name), "stability", meaning),
        f"stability.{name}.error": KeptNumber(
            ("stability", error), "stability", f"bound of the error of stability.{name}"
        ),
    }


NUMBERS: Mapping[str, KeptNumber] = {
    **_estimate("period", ("period",), None, "period of all six variables"),
    **_estimate("energy", ("energy",), None, "energy h"),
    "error": KeptNumber(("error",), None, "largest error of any variable over the asked times"),
    **_drift("energy"),
    **_drift("geometric"),
    **_drift("areas"),
    **_integral("kovalevskaya", "Kovalevskaya"),
    **_integral("goriachev", "Goriachev"),
    **_integral("goriachev_chaplygin", "Goriachev and Chaplygin"),
    **_stability("trace", "error", "μ + 1/μ over the period"),
    **_stability("exponent", "exponent_error", "log|μ| / T"),
    "stability.trusted_time": KeptNumber(
        ("stability", "trusted_time"), "stability", "how long integration in doubles keeps the tolerance"
    ),
    **_estimate("precession.psi1", ("precession", "psi1"), "orientation", "growth of psi1 per period"),
    **_estimate("precession.psi3", ("precession", "psi3"), "orientation", "growth of psi3 per period"),
    "cross_check.disagreement": KeptNumber(
        ("cross_check", "disagreement"), None, "between the two methods, where the method is both"
    ),
}
"""The names accepted in ``keep``. A point without the number (aperiodic, refused, ...) has null."""

DEFAULT_KEEP = ("period", "energy", "error")


def kept_numbers(solution: Document, names: Sequence[str]) -> list[float]:
    """Return these numbers of a solution's document; NaN for missing ones.

    Certified decimals are rounded to doubles; the error then covers the rounding too.
    """
    return [_number(solution, NUMBERS[name].path) for name in names]


def _number(solution: Document, path: tuple[str, ...]) -> float:
    *parents, field = path
    found: object = solution
    for part in parents:
        if not isinstance(found, Mapping):
            return math.nan
        found = found.get(part)
    if not isinstance(found, Mapping):
        return math.nan
    value = found.get(field)
    if field == "error" and "radius" in found:
        return _error_of_rounded(found)
    if isinstance(value, str):
        return float(exact_number(value))
    return float(value) if isinstance(value, int | float) else math.nan


def _error_of_rounded(enclosure: Document) -> float:
    """Return the bound of the error of a certified decimal's double, rounded upwards."""
    middle, radius = exact_number(str(enclosure["value"])), exact_number(str(enclosure["radius"]))
    return math.nextafter(float(radius + abs(middle - Fraction(float(middle)))), math.inf)
