"""Solves stored solutions again and compares: bit for bit on a like processor, else within the errors.

Bits are promised where the whole provenance is equal: version, numerics,
libraries, and the features of the processor. Between others a number is
promised within its error, and an error, itself an estimate, is not compared.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from random import Random

import numpy as np
from sqlalchemy import func, select

from service.dynamics.bounds import is_within, largest
from service.dynamics.equations.orientation import trajectory_columns, trajectory_errors
from service.dynamics.solution.dense_output import DenseOutput, OutsideHorizonError
from service.jobs.outcome import Refused, Solved
from service.sandbox import Sandbox, SandboxCrashError, SandboxMemoryError, SandboxTimeoutError
from service.storage.codecs.arrays import CodecError, decode_dense, unpack_arrays
from service.storage.database.database import Database
from service.storage.tables.solutions import DenseOutputRow, SamplesRow, SolutionRow
from workers.computation.compute import solve_document

TIMES = 33
"""At which two functions of time are compared."""
_NUMBERS = ("period", "energy")


class Sameness(StrEnum):
    """How the new solution compares with the stored one."""

    IDENTICAL = "identical"
    """Bit by bit, but for the time it took."""
    WITHIN_ERRORS = "within_errors"
    """Other bits, of another version or another processor; closer than both errors together."""
    DIFFERENT = "different"
    """Further apart than both errors allow, or other numbers of the same provenance: one of them is wrong."""
    FAILED = "failed"
    """There is no new solution."""


@dataclass(frozen=True, slots=True)
class Repetition:
    """The result for one solution."""

    solution: str
    sameness: Sameness
    detail: str

    @property
    def is_clean(self) -> bool:
        """The stored numbers are confirmed."""
        return self.sameness in (Sameness.IDENTICAL, Sameness.WITHIN_ERRORS)


@dataclass(frozen=True, slots=True)
class _Stored:
    solution: str
    problem: Mapping[str, object]
    summary: Mapping[str, object]
    dense: bytes
    samples: bytes | None
    """None if they were removed to save space."""


def repeat_solutions(
    database: Database, sandbox: Sandbox, *, count: int, seconds: float, random: Random
) -> Iterator[Repetition]:
    """Solve ``count`` of the stored problems, chosen by ``random``, in ``seconds`` each at most; compare."""
    for stored in _chosen(database, count, random):
        yield _repeat(stored, sandbox, seconds)


def _chosen(database: Database, count: int, random: Random) -> Iterator[_Stored]:
    with database.read() as session:
        total = session.scalar(select(func.count()).select_from(SolutionRow)) or 0
    statement = (
        select(SolutionRow.id, SolutionRow.problem, SolutionRow.summary, DenseOutputRow.data, SamplesRow.data)
        .join(DenseOutputRow, DenseOutputRow.solution_id == SolutionRow.id)
        .outerjoin(SamplesRow, SamplesRow.solution_id == SolutionRow.id)
    )
    for place in random.sample(range(total), min(count, total)):
        one = select(SolutionRow.id).order_by(SolutionRow.id).offset(place).limit(1).scalar_subquery()
        with database.read() as session:
            row = session.execute(statement.where(SolutionRow.id == one)).one_or_none()
        if row is not None:  # else it was removed meanwhile, or lacks what another law says it must have
            yield _Stored(*row)


def _repeat(stored: _Stored, sandbox: Sandbox, seconds: float) -> Repetition:
    document = json.dumps(stored.problem)
    try:
        outcome = sandbox.run(solve_document, document, seconds=seconds)
    except (SandboxTimeoutError, SandboxMemoryError, SandboxCrashError) as fault:
        return Repetition(stored.solution, Sameness.FAILED, f"it cannot be solved again: {fault}")
    if isinstance(outcome, Refused):
        detail = "it cannot be solved again: {code}: {detail}".format(**outcome.error)
        return Repetition(stored.solution, Sameness.FAILED, detail)
    if _is_identical(stored, outcome):
        return Repetition(stored.solution, Sameness.IDENTICAL, "the same bits")
    try:
        distance = _distance(stored, outcome.summary, decode_dense(outcome.dense))
        has_same_numbers = _has_same_numbers(stored, outcome)
    except CodecError as fault:
        return Repetition(stored.solution, Sameness.DIFFERENT, str(fault))
    if not is_within(distance, 1.0):
        detail = f"apart by {distance:.2g} of what both errors allow"
        return Repetition(stored.solution, Sameness.DIFFERENT, detail)
    changed = _changed_provenance(stored, outcome.summary)
    apart = f"apart by {distance:.2g} of both errors"
    if not changed and not has_same_numbers:
        detail = f"other bits than the same program stored on a like processor, {apart}"
        return Repetition(stored.solution, Sameness.DIFFERENT, detail)
    by = f" with another {', '.join(changed)}" if changed else ", which only describe the numbers"
    return Repetition(stored.solution, Sameness.WITHIN_ERRORS, f"other bits than were stored{by}, {apart}")


def _is_identical(stored: _Stored, outcome: Solved) -> bool:
    # As it comes back from a database: tuples are lists there.
    summary = json.loads(json.dumps(outcome.summary))
    return (
        {**stored.summary, "cost": None} == {**summary, "cost": None}
        and stored.dense == outcome.dense
        and stored.samples in (None, outcome.samples)
    )


def _has_same_numbers(stored: _Stored, outcome: Solved) -> bool:
    return (
        _has_same_arrays(stored.dense, outcome.dense)
        and (stored.samples is None or _has_same_arrays(stored.samples, outcome.samples))
        and all(stored.summary.get(name) == outcome.summary.get(name) for name in _NUMBERS)
    )


def _has_same_arrays(one: bytes, other: bytes) -> bool:
    """Compare the bits of arrays, not of packets: another version of the library packs them otherwise."""
    (arrays, _), (others, _) = unpack_arrays(one), unpack_arrays(other)
    return arrays.keys() == others.keys() and all(
        array.tobytes() == others[name].tobytes() for name, array in arrays.items()
    )


def _changed_provenance(stored: _Stored, summary: Mapping[str, object]) -> list[str]:
    """Return what of the provenance differs; older solutions that tell no processor are of another one."""
    before, now = stored.summary.get("provenance"), summary["provenance"]
    assert isinstance(now, Mapping)
    known = before if isinstance(before, Mapping) else {}
    return [name for name, value in now.items() if known.get(name) != value]


def _distance(stored: _Stored, summary: Mapping[str, object], dense: DenseOutput) -> float:
    """Return the largest distance of two corresponding numbers, in units of the sum of their errors."""
    numbers = [_apart(stored.summary.get(name), summary.get(name)) for name in _NUMBERS]
    return largest([*numbers, _functions_apart(decode_dense(stored.dense), dense)])


def _apart(one: object, other: object) -> float:
    if one is None and other is None:
        return 0.0
    if not isinstance(one, Mapping) or not isinstance(other, Mapping):
        return float("inf")
    allowed = _error(one) + _error(other)
    distance = abs(Fraction(one["value"]) - Fraction(other["value"]))
    return _ratio(float(distance), float(allowed))


def _error(number: Mapping[str, object]) -> Fraction:
    """Return the error of a number, or the radius of one that is proven."""
    error = number["radius"] if "radius" in number else number["error"]
    assert isinstance(error, int | float | str)
    return Fraction(error)


def _functions_apart(one: DenseOutput, other: DenseOutput) -> float:
    if one.columns != other.columns:
        return float("inf")
    if not one.columns:
        return 0.0
    start, stop = max(one.breaks[0], other.breaks[0]), min(one.breaks[-1], other.breaks[-1])
    times = np.linspace(start, stop, TIMES)
    try:
        values, others = trajectory_columns(one, times), trajectory_columns(other, times)
    except OutsideHorizonError:
        return float("inf")
    errors, other_errors = trajectory_errors(one, times), trajectory_errors(other, times)
    return largest(
        _ratio(float(np.max(np.abs(values[name] - others[name]))), errors[name] + other_errors[name])
        for name in values
    )


def _ratio(distance: float, allowed: float) -> float:
    if distance == 0.0:
        return 0.0
    # Errors without end would allow any distance.
    return distance / allowed if 0.0 < allowed < float("inf") else float("inf")
