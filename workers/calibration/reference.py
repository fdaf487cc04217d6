"""The measured problems, every kind of motion and every family, and the reference of each measurement.

It is the certified motion, else an integration of the equations.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.accuracy import Family, MotionKind, Reference
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import Problem, Tier
from service.dynamics.solution.dense_output import MAX_PARTS
from service.jobs.records import Refused
from service.schemas.problem.problem import read_problem
from service.storage.codecs.packing import decode_arrays
from workers.computation.compute import solve_document
from workers.solvers.choose import enclose
from workers.solvers.errors import CertifiedUnavailableError

FloatArray = NDArray[np.float64]


Document = Mapping[str, object]

SAMPLES = 1000
_REFERENCE_TOLERANCE = "1e-11"
"""The integration is more accurate than this and claims its error: 1e-14 if the potential has a formula."""


@dataclass(frozen=True, slots=True)
class Case:
    """One problem, without its times and its accuracy."""

    kind: MotionKind
    family: Family
    body: Document
    potential: Document
    motion: Document
    stop: str = "999/64"
    """Such that the times of 1000 samples are doubles."""
    method: str = "auto"
    is_quick: bool = False
    """Measured by a quick calibration too."""

    def document(self, tier: Tier, samples: int) -> str:
        """Return the problem as JSON."""
        return self._problem({"tier": tier}, self.method, samples)

    def reference_document(self) -> str:
        """Return the problem for an integration with nearly all digits, as JSON."""
        return self._problem({"tolerance": _REFERENCE_TOLERANCE}, "integration", SAMPLES)

    def _problem(self, accuracy: Document, method: str, samples: int) -> str:
        return json.dumps(
            {
                "body": self.body,
                "potential": self.potential,
                "motion": self.motion,
                "time": {"start": 0, "stop": self.stop, "samples": samples},
                "accuracy": accuracy,
                "method": method,
                "outputs": ["gamma", "omega"],
            }
        )


def _rational(a: list[object], b: list[object], c: list[object]) -> Document:
    return {"type": "rational", "a": a, "b": b, "c": c}


def _formula(text: str) -> Document:
    return {"type": "expression", "expression": text}


_DOUBLE: Document = {"A": 2, "B": "3/2", "C": 1}
_NU_1: Document = {"type": "planar", "nu": 1}
_OSCILLATING = _rational([-1], ["1/50"], ["6/5"])

CASES = (
    Case("pole to equator", "three-term", _DOUBLE, _rational([-1], [], []), _NU_1, is_quick=True),
    Case("rest to equator", "three-term", _DOUBLE, _rational([-1], ["1/20"], []), _NU_1),
    Case("pole to rest", "three-term", _DOUBLE, _rational([-1], [], [2]), _NU_1),
    Case("rest to rest", "three-term", _DOUBLE, _OSCILLATING, _NU_1, is_quick=True),
    # A pole that is approached for ever.
    Case(
        "aperiodic", "three-term", _DOUBLE, _rational([], [], [-1]), _NU_1,
        stop="999/256",
    ),
    # A collision at t = 1.066.
    Case(
        "aperiodic", "three-term", _DOUBLE, _rational([-1], ["-1/20"], ["-1/2"]), _NU_1,
        stop="999/1024",
    ),
    # A separatrix that leaves an equilibrium and returns to it.
    Case(
        "aperiodic", "three-term", _DOUBLE, _rational([1], ["-1/16"], [-1]), {**_NU_1, "window": 1},
        stop="999/256",
    ),
    Case("any state", "three-term", _DOUBLE, _OSCILLATING, _NU_1, method="integration"),
    Case(
        "rest to equator", "rational", _DOUBLE,
        _rational([-2, "1/20", "1/200"], ["1/50", "1/500", "1/4000"], ["1/5", "1/10"]), _NU_1,
    ),
    Case(
        "pole to equator", "general alpha", {"A": 4, "B": "9/2", "C": 1},
        _formula("-g1*(4*g1^2 + 3*g3^2) + (4*g1^2 + g3^2)/10"), {"type": "planar", "lambda": "9/10"},
    ),
    Case(
        "rest to equator", "general alpha", {"A": 3, "B": "5/2", "C": 1},
        {"type": "homogeneous", "A": ["-1/2", 0, 1, "1/5"], "B": ["-1/3"], "C": ["1/200"]},
        {"type": "planar", "lambda": "4/5"}, is_quick=True,
    ),
    Case(
        "rest to equator", "function", _DOUBLE,
        _formula("-g1 + 1/20/g3^2 + (2*g1^2 + g3^2)*exp(g2)/20"), _NU_1,
    ),
    Case(
        "rest to equator", "integral", {"A": "17/10", "B": "7/5", "C": 1},
        {"type": "general", "F": "exp(-w)", "G": "-3*(6/10 - g2^2) + 3/10*g2"},
        {"type": "planar", "lambda": "11/10"}, stop="999/256",
    ),
)  # fmt: skip


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
    enclosed = enclose(problem.body, problem.potential, problem.motion, times, BITS)
    with ctx.workprec(2 * BITS):
        high = np.array([[float(value.mid()) for value in state] for state in enclosed.states])
        rest = [
            [value - ball(Fraction(number)) for value, number in zip(state, row, strict=True)]
            for state, row in zip(enclosed.states, high.tolist(), strict=True)
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
    high = samples_of(decode_arrays(outcome.samples))[0, ::STRIDE]
    return ReferenceStates("integration", high, np.zeros_like(high), error)


def samples_of(columns: Mapping[str, FloatArray]) -> FloatArray:
    """Return the six variables as sums of doubles, shape (parts, n, 6)."""
    further = sum(f"{COLUMNS[0]}.{part}" in columns for part in range(1, MAX_PARTS))
    suffixes = ["", *(f".{part}" for part in range(1, 1 + further))]
    return np.array([[columns[name + suffix] for name in COLUMNS] for suffix in suffixes]).transpose(0, 2, 1)


def _upper(value: arb) -> float:
    return float(np.nextafter(float(value.upper()), np.inf))
