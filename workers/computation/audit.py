"""Solves the problem of a stored solution again, and compares: within the errors that both claim.

Bits are promised where the problem and the whole provenance are equal: version, numerics, libraries, and the
features of the processor. Otherwise a number is promised within its error, and an error, itself an estimate,
is not compared.

Of samples the ones with the same place in the list belong to the same exact time, which ``t`` has rounded:
with times in periods a multiple of the true period.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from fractions import Fraction
from math import isfinite, isnan

import numpy as np

from service.dynamics.equations.orientation import orientation_errors, trajectory_columns, trajectory_errors
from service.dynamics.motion import COLUMNS
from service.dynamics.numerics import is_within, largest
from service.dynamics.solution.dense_output import EPSILON, DenseOutput, OutsideHorizonError
from service.jobs.records import Refused, Solved, SolveOutcome, StoredSolution
from service.storage.codecs.packing import CodecError, FloatArray, decode_arrays, decode_dense, unpack_arrays
from workers.computation.compute import solve_document, way_to_repeat

COMPARED_TIMES = 33
"""Number of times at which two functions of time are compared."""
_NUMBERS: Mapping[str, tuple[str, ...]] = {
    "period": ("period",),
    "energy": ("energy",),
    "trace": ("stability",),
    "psi1": ("precession", "psi1"),
    "psi3": ("precession", "psi3"),
}
"""Where in a summary the numbers with errors are."""


class Sameness(StrEnum):
    """The result of comparing the new solution with the stored one."""

    IDENTICAL = "identical"
    """Bit by bit, but for the time it took."""
    WITHIN_ERRORS = "within_errors"
    """Other bits, of another problem, version or processor; closer than both errors together."""
    DIFFERENT = "different"
    """Further apart than both errors allow, or other numbers of the same provenance: one of them is wrong."""
    FAILED = "failed"
    """There is no new solution."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The difference of two numbers, or of two columns of numbers."""

    difference: float
    allowed: float
    """The sum of both errors."""
    share: float
    """Their quotient, of columns the largest; 0 where there is no difference."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """The result for two solutions."""

    sameness: Sameness
    detail: str
    differences: Mapping[str, Difference]
    """Differences by name, for all that both solutions have."""


class _OneSidedError(ValueError):
    """One of two solutions of a problem lacks what the other has, or it cannot be read."""


def compare_solutions(stored: StoredSolution, again: Solved) -> Comparison:
    """Compare a stored solution with another one of the same problem, perhaps of another tier or method."""
    is_same = stored.problem == again.summary["problem"]
    if is_same and _is_identical(stored, again):
        return Comparison(Sameness.IDENTICAL, "the same bits", _differences(stored, again, is_same=True))
    try:
        differences = _differences(stored, again, is_same=is_same)
        has_same_numbers = is_same and _has_same_numbers(stored, again)
    except (CodecError, _OneSidedError) as fault:
        return Comparison(Sameness.DIFFERENT, str(fault), {})
    share = largest(each.share for each in differences.values())
    if not is_within(share, 1.0):
        worst = max(differences, key=lambda name: _badness(differences[name]))
        detail = f"apart by {share:.2g} of what both errors allow, in {worst}"
        return Comparison(Sameness.DIFFERENT, detail, differences)
    apart = f"apart by {share:.2g} of both errors"
    if not is_same:
        return Comparison(Sameness.WITHIN_ERRORS, apart, differences)
    changed = _changed_provenance(stored, again)
    if not changed and not has_same_numbers:
        detail = f"other bits than the same program stored on a like processor, {apart}"
        return Comparison(Sameness.DIFFERENT, detail, differences)
    by = f" with another {', '.join(changed)}" if changed else ", which only describe the numbers"
    return Comparison(Sameness.WITHIN_ERRORS, f"other bits than were stored{by}, {apart}", differences)


def _is_identical(stored: StoredSolution, again: Solved) -> bool:
    # As it comes back from a database: tuples are lists there.
    summary = json.loads(json.dumps(again.summary))
    return (
        {**stored.summary, "cost": None} == {**summary, "cost": None}
        and stored.dense == again.dense
        and stored.samples in (None, again.samples)
    )


def _has_same_numbers(stored: StoredSolution, again: Solved) -> bool:
    return (
        _has_same_arrays(stored.dense, again.dense)
        and (stored.samples is None or _has_same_arrays(stored.samples, again.samples))
        and all(_member(stored.summary, path) == _member(again.summary, path) for path in _NUMBERS.values())
    )


def _has_same_arrays(one: bytes, other: bytes) -> bool:
    """Compare the bits of arrays, not of packets: another version of the library packs them otherwise."""
    (arrays, _), (others, _) = unpack_arrays(one), unpack_arrays(other)
    return arrays.keys() == others.keys() and all(
        array.tobytes() == others[name].tobytes() for name, array in arrays.items()
    )


def _changed_provenance(stored: StoredSolution, again: Solved) -> list[str]:
    """Return what of the provenance differs; older solutions that tell no processor are of another one."""
    before, now = stored.summary.get("provenance"), again.summary["provenance"]
    # Before it was told, there was one way.
    known = {"way": "compiled", **before} if isinstance(before, Mapping) else {}
    return [name for name, value in now.items() if known.get(name) != value]


def _differences(stored: StoredSolution, again: Solved, *, is_same: bool) -> dict[str, Difference]:
    """Return the differences of all that both solutions have.

    Raises
    ------
    _OneSidedError
        One of two solutions of the same problem lacks something, or what is stored has no such form.
    """
    differences: dict[str, Difference] = {}
    for name, path in _NUMBERS.items():
        one, other = _member(stored.summary, path), _member(again.summary, path)
        if one is not None and other is not None:
            differences[name] = _apart(name, one, other)
        elif is_same and one is not other:
            raise _OneSidedError(f"only one of the two solutions has a {name}")
    dense, other_dense = decode_dense(stored.dense), decode_dense(again.dense)
    function = _functions_apart(dense, other_dense)
    if function is not None:
        differences["function"] = function
    if stored.samples is not None:
        columns, others = decode_arrays(stored.samples), decode_arrays(again.samples)
        errors, other_errors = (
            _errors(stored.summary, dense, columns),
            _errors(again.summary, other_dense, others),
        )
        wanted = [name for name in columns if name in errors]
        if wanted != [name for name in others if name in other_errors]:
            raise _OneSidedError("the two solutions have samples of different columns")
        if wanted:
            differences["samples"] = _columns_apart(
                {name: columns[name] for name in wanted},
                others,
                lambda name: errors[name] + other_errors[name],
            )
    return differences


def _member(summary: Mapping[str, object], path: tuple[str, ...]) -> Mapping[str, object] | None:
    member: object = summary
    for name in path:
        member = member.get(name) if isinstance(member, Mapping) else None
    return member if isinstance(member, Mapping) else None


def _apart(name: str, one: Mapping[str, object], other: Mapping[str, object]) -> Difference:
    try:
        (value, error), (other_value, other_error) = (_number(each, name) for each in (one, other))
    except (KeyError, ValueError, TypeError, ArithmeticError) as fault:
        raise _OneSidedError(f"the stored {name} is no number with an error") from fault
    return _difference(float(abs(value - other_value)), float(error + other_error))


def _number(number: Mapping[str, object], name: str) -> tuple[Fraction, Fraction]:
    """Return a number and its error, or the radius of one that is proven."""
    if name == "trace" and isinstance(enclosed := number["trace"], Mapping):
        number, name = enclosed, "enclosed trace"
    value = number["trace" if name == "trace" else "value"]
    error = number["radius"] if "radius" in number else number["error"]
    return Fraction(str(value)), Fraction(str(error))


def _errors(
    summary: Mapping[str, object], dense: DenseOutput, columns: Mapping[str, FloatArray]
) -> dict[str, float]:
    """Return the claimed error of each column of stored samples that are doubles; not those of enclosures."""
    if "t" not in columns:
        return {}
    try:
        error = float(str(summary["error"]))
    except (KeyError, ValueError) as fault:
        raise _OneSidedError("the stored solution has no error") from fault
    own = orientation_errors(dense, columns["t"])
    known = {"t": _error_of_times(summary, columns["t"]), **dict.fromkeys(COLUMNS, error), **own}
    return {name: known[name] for name in columns if name in known}


def _error_of_times(summary: Mapping[str, object], times: FloatArray) -> float:
    """Return by how much rounding, and with times in periods the error of the period, may move a time."""
    last, relative = float(np.max(np.abs(times), initial=0.0)), EPSILON
    period, problem = _member(summary, ("period",)), _member(summary, ("problem",))
    if period is not None and problem is not None and "periods" in (_member(problem, ("time",)) or {}):
        value, error = _number(period, "period")
        relative += float(error / abs(value))
    return last * relative


def _functions_apart(one: DenseOutput, other: DenseOutput) -> Difference | None:
    if one.columns != other.columns:
        raise _OneSidedError("the two solutions are functions of time with different columns")
    if not one.columns:
        return None
    start, stop = max(one.breaks[0], other.breaks[0]), min(one.breaks[-1], other.breaks[-1])
    times = np.linspace(start, stop, COMPARED_TIMES)
    try:
        values, others = trajectory_columns(one, times), trajectory_columns(other, times)
    except OutsideHorizonError as fault:
        raise _OneSidedError("the two solutions have no time in common") from fault
    errors, other_errors = trajectory_errors(one, times), trajectory_errors(other, times)
    return _columns_apart(values, others, lambda name: errors[name] + other_errors[name])


def _columns_apart(
    columns: Mapping[str, FloatArray], others: Mapping[str, FloatArray], allowed: Callable[[str], float]
) -> Difference:
    if any(column.shape != others[name].shape for name, column in columns.items()):
        raise _OneSidedError("the two solutions have samples at different times")
    differences = [
        _difference(float(np.max(np.abs(column - others[name]), initial=0.0)), allowed(name))
        for name, column in columns.items()
    ]
    return max(differences, key=_badness)


def _badness(difference: Difference) -> float:
    """Return the share; what is no number is worse than all numbers, but no maximum finds it."""
    return float("inf") if isnan(difference.share) else difference.share


def _difference(difference: float, allowed: float) -> Difference:
    if difference == 0.0:
        return Difference(difference, allowed, 0.0)
    # Errors without end would allow any distance.
    share = difference / allowed if 0.0 < allowed < float("inf") else float("inf")
    return Difference(difference, allowed, share)


_REPORTED = ("method", "tier", "error", "provenance")
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
    comparison: Comparison, stored: Mapping[str, object], again: Mapping[str, object]
) -> dict[str, object]:
    return {
        "verdict": "disagrees" if comparison.sameness is Sameness.DIFFERENT else "agrees",
        "identical": comparison.sameness is Sameness.IDENTICAL,
        "detail": comparison.detail,
        "differences": {
            name: {part: _finite(number) for part, number in asdict(difference).items()}
            for name, difference in comparison.differences.items()
        },
        "stored": {name: stored.get(name) for name in _REPORTED},
        "found": {name: again.get(name) for name in _REPORTED},
    }


def _finite(number: float) -> float | None:
    """Return what JSON can hold: a damaged array may hold what is no number."""
    return number if isfinite(number) else None
