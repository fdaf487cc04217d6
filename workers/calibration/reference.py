"""Computes the reference of a measurement: the certified motion, else an integration of the equations."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.accuracy import Reference
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import ball
from service.dynamics.solution.ball_columns import MAX_PARTS
from service.jobs.outcome import Refused
from service.schemas.problem.problem import read_problem
from service.storage.codecs.arrays import decode_arrays
from workers.calibration.problems import SAMPLES, Case
from workers.computation.compute import solve_document
from workers.solvers.certified.errors import CertifiedUnavailableError
from workers.solvers.choose import enclose

FloatArray = NDArray[np.float64]

STRIDE = 9
"""The compared ones of 1000 samples: the first, the last, and every ninth in between."""
BITS = 128


class NoReferenceError(Exception):
    """The integration of the equations of motion failed."""


@dataclass(frozen=True, slots=True)
class ReferenceStates:
    """The six variables at every ninth sample, each as a sum of two doubles."""

    source: Reference
    high: FloatArray
    low: FloatArray
    error: float
    """Bound of the absolute error of each sum."""

    def departure(self, samples: FloatArray) -> float:
        """Return the largest absolute difference from here of ``samples``, sums of shape (parts, 1000, 6)."""
        # The first difference is exact where it matters: doubles next to each other.
        first, rest = samples[0, ::STRIDE] - self.high, samples[1:, ::STRIDE].sum(axis=0) - self.low
        return float(np.abs(first + rest).max())


def reference_states(case: Case) -> ReferenceStates:
    """Return the reference for the solutions of ``case``.

    Raises
    ------
    NoReferenceError
        There is no certified motion, and the integration failed.
    """
    problem = read_problem(json.loads(case.reference_document()))
    try:
        return _certified(problem, case)
    except CertifiedUnavailableError:
        return _integrated(case)


def _certified(problem: Problem, case: Case) -> ReferenceStates:
    step = Fraction(case.stop) / (SAMPLES - 1)
    times = [step * k for k in range(0, SAMPLES, STRIDE)]
    found = enclose(problem.body, problem.potential, problem.motion, times, BITS)
    with ctx.workprec(2 * BITS):
        high = np.array([[float(value.mid()) for value in state] for state in found.states])
        rest = [
            [value - ball(Fraction(number)) for value, number in zip(state, row, strict=True)]
            for state, row in zip(found.states, high.tolist(), strict=True)
        ]
        low = np.array([[float(value.mid()) for value in row] for row in rest])
        error = max(_upper(value.rad()) for row in rest for value in row)
    # The low parts are rounded to doubles.
    return ReferenceStates("certified", high, low, error + float(np.spacing(np.abs(low).max())))


def _integrated(case: Case) -> ReferenceStates:
    outcome = solve_document(case.reference_document())
    if isinstance(outcome, Refused):
        raise NoReferenceError(f"no reference for {case.kind}, {case.family}: {outcome.error}")
    error = outcome.summary["error"]
    assert isinstance(error, float)
    high = samples_of(decode_arrays(outcome.samples))[0, ::STRIDE]
    return ReferenceStates("integration", high, np.zeros_like(high), error)


def samples_of(columns: Mapping[str, FloatArray]) -> FloatArray:
    """Return the six variables as sums of doubles, shape (parts, n, 6)."""
    further = sum(f"{COLUMNS[0]}.{part}" in columns for part in range(1, MAX_PARTS))
    suffixes = ["", *(f".{part}" for part in range(1, 1 + further))]
    return np.array([[columns[name + suffix] for name in COLUMNS] for suffix in suffixes]).transpose(0, 2, 1)


def _upper(value: arb) -> float:
    return float(np.nextafter(float(value.upper()), np.inf))
