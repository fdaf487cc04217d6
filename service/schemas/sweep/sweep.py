"""Generates the points of a sweep from its base problem and its axes, and reads the numbers kept of each.

The stable interface for code that computes or shows points:

- :func:`service.schemas.sweep.reading.read_sweep` takes a sweep's document and returns a :class:`Sweep`;
  :func:`trusted_sweep` does so for one that was validated before, as the stored ones were.
- ``sweep.points`` is their number; an index from 0 says everything about a point.
- ``sweep.values(index)`` are the exact numbers on the axes, ``sweep.document(index)`` is the problem
  that, sent by itself, is the very same; ``sweep.columns(first, count)`` are the numbers as doubles.
- ``sweep.keep`` names the numbers kept of each point, see :data:`NUMBERS`;
  ``sweep.series_columns`` the functions of time, empty unless they are wanted, of
  ``sweep.samples`` samples each.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal  # Any: documents that were read from JSON

import numpy as np
from numpy.typing import NDArray

from service.dynamics.equations.orientation import PRECESSION, QUATERNION
from service.dynamics.exact import exact_number, exact_text
from service.dynamics.motion import columns_of
from service.dynamics.problem import Output, Problem, StateMotion, TimePeriods
from service.dynamics.sweep_axes import Axis, LinearAxis, ListedAxis, LogarithmicAxis, UniformAxis, at
from service.schemas.problem.trusted import trusted_problem
from service.schemas.reading.documents import Document, Part, split_pointer, with_values

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Combine = Literal["grid", "zip"]
Varies = Literal["curve", "potential", "start", "moment", "body", "time", "sign", "state", "other"]
"""The numbers that an axis may vary: λ or nu; a number of the potential; g1 at the start; B, on which no
planar motion depends; A or C; the times; window and signs, which have few values; ω and γ; something else."""

_OF_STATES = frozenset({"period", "gamma", "omega"})
"""Outputs that kernels have for motions from any state."""
PLAIN_OUTPUTS: frozenset[str] = _OF_STATES | {"invariants"}
"""Outputs that blocks of planar points have, whatever the accuracy."""
_BY_DOUBLES = frozenset({"orientation", "stability"})
"""Outputs that compiled doubles have for the tiers that are content with them."""
FEW = (
    ("motion", "window"),
    ("motion", "g1_sign"),
    ("motion", "g3_sign"),
    ("motion", "start", "s_sign"),
    ("motion", "start", "g2_sign"),
)
"""Numbers that have few values."""

_LARGEST_JSON_INTEGER = 2**53


@dataclass(frozen=True, slots=True)
class SweepAxis:
    """One of the numbers that vary."""

    pointer: str
    path: tuple[str, ...]
    """The pointer's parts."""
    axis: Axis

    @property
    def varies(self) -> Varies:
        """The kind of number that it varies."""
        match self.path:
            case ("potential", *_):
                return "potential"
            case ("motion", "lambda" | "nu"):
                return "curve"
            case ("motion", "start", "g1"):
                return "start"
            case ("motion", "omega" | "gamma", _):
                return "state"
            case ("body", "B"):
                return "moment"
            case ("body", *_):
                return "body"
            case ("time", "start" | "stop" | "periods"):
                return "time"
        return "sign" if self.path in FEW else "other"

    @property
    def position_in_state(self) -> int | None:
        """The place of its number among p, q, r, g1, g2, g3, A, B, C; None for what is none of them."""
        match self.path:
            case ("motion", ("omega" | "gamma") as vector, ("0" | "1" | "2") as index):
                return 3 * ("omega", "gamma").index(vector) + int(index)
            case ("body", ("A" | "B" | "C") as moment):
                return 6 + "ABC".index(moment)
        return None


@dataclass(frozen=True, slots=True)
class Sweep:
    """The points of a sweep, each generated on request."""

    base: Mapping[str, object]
    axes: tuple[SweepAxis, ...]
    combine: Combine
    keep: tuple[str, ...]
    """Names of the numbers, in the order of the columns."""
    series_columns: tuple[str, ...]
    """``t`` and the functions of time that are kept of each point."""
    samples: int
    """Samples of each series; 0 without series."""
    first_problem: Problem
    """The problem of the first point: it was read to check the others' common part."""

    @property
    def points(self) -> int:
        """Number of points."""
        lengths = [each.axis.length for each in self.axes]
        return math.prod(lengths) if self.combine == "grid" else lengths[0]

    @property
    def pointers(self) -> tuple[str, ...]:
        """The names of the axes, in their order."""
        return tuple(each.pointer for each in self.axes)

    @property
    def are_states(self) -> bool:
        """Whether the points are motions from any state that kernels solve many at a time.

        It varies nothing but states, moments and the potential's numbers, and asks for no outputs but period,
        gamma and omega, by an absolute tolerance or a tier of doubles.
        """
        problem = self.first_problem
        return (
            isinstance(problem.motion, StateMotion)
            and not isinstance(problem.time, TimePeriods)
            and problem.accuracy.tier != "certified"
            and problem.accuracy.budget_seconds is None
            and problem.accuracy.measure != "relative"
            and set(problem.outputs) <= _OF_STATES
            and all(axis.position_in_state is not None or axis.varies == "potential" for axis in self.axes)
        )

    def has_block_outputs(self, *, by_doubles: bool) -> bool:
        """Tell whether compiled code has all outputs and kept numbers for many points at a time.

        ``by_doubles``: whether the accuracy is one for which it also has the stability, and the precession of
        the attitude, of which it has no columns.
        """
        problem, outputs = self.first_problem, set(self.first_problem.outputs)
        is_had = outputs <= PLAIN_OUTPUTS or (
            by_doubles
            and outputs <= PLAIN_OUTPUTS | _BY_DOUBLES
            and not ("orientation" in outputs and self.series_columns)
            and not ("stability" in outputs and problem.body.B is None)
        )
        moves_moment = any(axis.varies == "moment" for axis in self.axes)
        return is_had and not (keeps_further(self.keep) and moves_moment)

    def values(self, index: int) -> tuple[Fraction, ...]:
        """Return the exact number on each axis; in a grid the last axis runs fastest."""
        if not 0 <= index < self.points:
            raise IndexError(f"point {index} of {self.points}")
        places = self._places(np.array([index], dtype=np.int64))
        return tuple(each.axis.value(int(place[0])) for each, place in zip(self.axes, places, strict=True))

    def document(self, index: int) -> Document:
        """Return the problem document of one point."""
        values = self.values(index)
        replaced = {each.path: json_number(value) for each, value in zip(self.axes, values, strict=True)}
        return with_values(self.base, replaced)

    def columns(self, first: int, count: int) -> dict[str, FloatArray]:
        """Return the numbers on each axis, by its pointer, of ``count`` neighbouring points as doubles."""
        return self.columns_at(np.arange(first, first + count, dtype=np.int64))

    def columns_at(self, indices: IntArray) -> dict[str, FloatArray]:
        """Return the numbers on each axis, by its pointer, of any points as doubles."""
        places = self._places(indices)
        return {each.pointer: at(each.axis, place) for each, place in zip(self.axes, places, strict=True)}

    def _places(self, indices: IntArray) -> Sequence[IntArray]:
        """Return for each axis the index on it."""
        if self.combine == "zip":
            return [indices] * len(self.axes)
        places: list[IntArray] = []
        for each in reversed(self.axes):
            indices, place = np.divmod(indices, each.axis.length)
            places.append(place)
        return places[::-1]


def trusted_sweep(document: Part) -> Sweep:
    """Return the sweep that a valid document states; raises what constructors of its first point raise."""
    axes = tuple(sweep_axis(part, place) for place, part in enumerate(document["axes"]))
    return sweep_of(document, axes, trusted_problem(first_point(document["base"], axes)))


def sweep_of(document: Part, axes: tuple[SweepAxis, ...], first: Problem) -> Sweep:
    """Return the sweep of a document whose axes and first point are made already."""
    columns = _series_columns(first) if document.get("series", False) else ()
    samples = 0
    if columns:
        samples = first.time.samples
    keep = tuple(document.get("keep", DEFAULT_KEEP))
    return Sweep(document["base"], axes, document.get("combine", "grid"), keep, columns, samples, first)


def first_point(base: Part, axes: Sequence[SweepAxis]) -> dict[str, Any]:
    """Return the problem document with the first value of each axis."""
    return with_values(base, {each.path: json_number(each.axis.value(0)) for each in axes})


def sweep_axis(part: Part, place: int) -> SweepAxis:
    """Return the axis of a sweep that is the ``place``-th, from 0."""
    return SweepAxis(part["pointer"], split_pointer(part["pointer"]), axis_of(part, place))


def axis_of(part: Part, place: int) -> Axis:
    """Return the values of an axis; its place selects the random stream."""
    if "values" in part:
        return ListedAxis(tuple(map(exact_number, part["values"])))
    kind = next(kind for kind in ("linspace", "logspace", "uniform") if kind in part)
    low, high, length = map(exact_number, part[kind])
    match kind:
        case "linspace":
            return LinearAxis(low, high, int(length))
        case "logspace":
            return LogarithmicAxis(low, high, int(length))
    return UniformAxis(low, high, int(length), int(exact_number(part.get("seed", 0))), place)


def _series_columns(problem: Problem) -> tuple[str, ...]:
    """Return ``t`` and the functions of time that the outputs ask for; empty if there are none."""
    columns = columns_of(problem.outputs)
    if "orientation" in problem.outputs:
        columns += [*QUATERNION, *PRECESSION]
    return ("t", *columns) if columns else ()


def json_number(value: Fraction) -> int | float | str:
    """Return ``value`` as a document has it: a JSON number if one says it exactly, text if not."""
    if value.denominator == 1 and abs(value) <= _LARGEST_JSON_INTEGER:
        return value.numerator
    double = float(value)
    return double if exact_number(double) == value else exact_text(value)


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
        ("stability", "trusted_time"), "stability", "until when double precision keeps the tolerance"
    ),
    **_estimate("precession.psi1", ("precession", "psi1"), "orientation", "growth of psi1 per period"),
    **_estimate("precession.psi3", ("precession", "psi3"), "orientation", "growth of psi3 per period"),
    "cross_check.disagreement": KeptNumber(
        ("cross_check", "disagreement"), None, "between the two methods, where the method is both"
    ),
}
"""The names accepted in ``keep``. A point without the number (aperiodic, refused, ...) has null."""

DRIFT_NUMBERS = frozenset(name for each in ("energy", "geometric", "areas") for name in _drift(each))


def keeps_further(keep: Sequence[str]) -> bool:
    """Tell whether further integrals are among the kept numbers; they depend on B."""
    return any(name.startswith("invariants.") and name not in DRIFT_NUMBERS for name in keep)


DEFAULT_KEEP = ("period", "energy", "error")


def kept_numbers(solution: Part, names: Sequence[str]) -> list[float]:
    """Return these numbers of a solution's document; NaN for missing ones.

    Certified decimals are rounded to doubles; the error then covers the rounding too.
    """
    return [_number(solution, NUMBERS[name].path) for name in names]


def _number(solution: Part, path: tuple[str, ...]) -> float:
    *parents, field = path
    found: object = solution
    for part in parents:
        if not isinstance(found, Mapping):
            return math.nan
        found = found.get(part)
    if not isinstance(found, Mapping):
        return math.nan
    value = found.get(field)
    if isinstance(value, Mapping):
        value = value.get("value")
    if field == "error" and "radius" in found:
        return _error_of_rounded(found)
    if isinstance(value, str):
        return float(exact_number(value))
    return float(value) if isinstance(value, int | float) else math.nan


def _error_of_rounded(enclosure: Part) -> float:
    """Return the bound of the error of a certified decimal's double, rounded upwards."""
    middle, radius = exact_number(str(enclosure["value"])), exact_number(str(enclosure["radius"]))
    return math.nextafter(float(radius + abs(middle - Fraction(float(middle)))), math.inf)
