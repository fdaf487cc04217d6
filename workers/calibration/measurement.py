"""Measures seconds and errors of every tier on every problem.

The measured problems are of every kind of motion and every family. The reference of each measurement is the
certified motion, else an integration of the equations.
"""

import json
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from statistics import median

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.accuracy import (
    TIERS,
    AccuracyRow,
    AccuracyTable,
    Family,
    Machine,
    MotionKind,
    Reference,
    Source,
    Unavailable,
)
from service.dynamics.formula.algebras.ball import ball
from service.dynamics.motion import COLUMNS
from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Problem, Tier
from service.dynamics.solution.dense_output import MAX_PARTS, RADIUS
from service.jobs.records import Refused, Solved
from service.sandbox import Sandbox
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError, instant_text
from service.storage.codecs.packing import decode_arrays
from service.storage.database.database import Database
from service.storage.database.migration import migrate
from service.storage.database.rows import new_id
from service.storage.jobs.job_store import JobStore
from service.versions import version_of
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


_LEASE_SECONDS = 3600.0

SecondsOf = Callable[[str], float]
"""Measures the seconds of a problem, given as JSON."""


@contextmanager
def whole_jobs() -> Iterator[SecondsOf]:
    """Yield a function that times a job: submitted, claimed, solved by a child process, and stored."""
    with tempfile.TemporaryDirectory(prefix="polhode-calibration-") as folder:
        url = f"sqlite:///{Path(folder) / 'jobs.db'}"
        migrate(url)
        database = Database(url)
        sandbox = Sandbox(1, preload=["workers.computation.compute"])
        jobs = JobStore(database)

        def seconds_of(document: str) -> float:
            problem = json.loads(document)
            began = time.perf_counter()
            # A digest of its own, so that nothing is reused.
            jobs.submit(problem, new_id())
            claim = jobs.claim("calibration", lease_seconds=_LEASE_SECONDS)
            assert claim is not None
            outcome = sandbox.run(solve_document, json.dumps(claim.payload), seconds=None)
            jobs.finish(claim, outcome)
            return time.perf_counter() - began

        try:
            sandbox.start()
            yield seconds_of
        finally:
            sandbox.close()
            database.close()


SLOW_SECONDS = 0.3
"""Slower problems are measured once, and only with 1000 samples more."""


@dataclass(frozen=True, slots=True)
class Effort:
    """The extent of the measurements."""

    cases: tuple[Case, ...]
    repetitions: int
    many_samples: int
    """The time of 1000 more samples is the slope up to this number."""


FULL = Effort(CASES, 5, 10_990)
QUICK = Effort(tuple(case for case in CASES if case.is_quick), 1, 2000)


class ClaimExceededError(Exception):
    """A solution is further from its reference than both of them claim."""


def calibrate(
    effort: Effort,
    seconds_of: SecondsOf,
    *,
    source: Source = "measured",
    step: Callable[[str], None] = lambda _: None,
) -> AccuracyTable:
    """Measure every tier on every problem; ``step`` is called before each of :func:`steps`.

    ``seconds_of`` measures the time of a problem: :func:`workers.calibration.measurement.whole_jobs`.

    Raises
    ------
    ClaimExceededError
        An error is larger than claimed.
    NoReferenceError
        A motion has no reference.
    ValueError
        No tier solved any of the problems.
    """
    rows: list[AccuracyRow] = []
    unavailable: list[Unavailable] = []
    for case in effort.cases:
        step(f"{case.kind}, {case.family}: reference")
        reference = reference_states(case)
        for tier in TIERS:
            step(f"{case.kind}, {case.family}: {tier}")
            row = _measure(case, tier, reference, effort, seconds_of)
            if isinstance(row, AccuracyRow):
                rows.append(row)
            else:
                unavailable.append(row)
    return AccuracyTable(
        source=source,
        date=instant_text(datetime.now(UTC), "seconds"),
        version=version_of("polhode"),
        numerics=NUMERICS,
        machine=this_machine(),
        repetitions=effort.repetitions,
        rows=tuple(rows),
        unavailable=tuple(unavailable),
    )


def steps(effort: Effort) -> int:
    """Return how many steps a calibration has."""
    return len(effort.cases) * (1 + len(TIERS))


def _measure(
    case: Case, tier: Tier, reference: ReferenceStates, effort: Effort, seconds_of: SecondsOf
) -> AccuracyRow | Unavailable:
    document = case.document(tier, SAMPLES)
    try:
        outcome = solve_document(document, read=read_problem)
    except InvalidProblemError as refusal:
        fault = refusal.faults[0]
        return Unavailable(tier, case.kind, case.family, fault.code, fault.message)
    if isinstance(outcome, Refused):
        code, detail = (str(outcome.error[name]) for name in ("code", "detail"))
        return Unavailable(tier, case.kind, case.family, code, detail)
    claimed, reached = _errors(case, tier, outcome, reference)
    # The first problem of a structure compiles code or fills caches.
    seconds_of(document)
    seconds = seconds_of(document)
    is_slow = seconds > SLOW_SECONDS
    many = 2 * SAMPLES if is_slow else effort.many_samples
    if not is_slow:
        seconds = median(seconds_of(document) for _ in range(effort.repetitions))
    further = case.document(tier, many)
    more = median(seconds_of(further) for _ in range(1 if is_slow else effort.repetitions))
    return AccuracyRow(
        tier=tier,
        kind=case.kind,
        family=case.family,
        claimed_error=claimed,
        error=reached,
        reference=reference.source,
        reference_error=reference.error,
        seconds=seconds,
        seconds_per_1000=max(0.0, (more - seconds) / (many - SAMPLES) * 1000),
    )


def _errors(case: Case, tier: Tier, outcome: Solved, reference: ReferenceStates) -> tuple[float, float]:
    """Return the claimed error and the one that was reached; with radii, of all the proven digits."""
    columns = decode_arrays(outcome.samples)
    radii = [values.max() for name, values in columns.items() if name.endswith(f".{RADIUS}")]
    claimed = float(max(radii)) if radii else float(str(outcome.summary["error"]))
    reached = reference.departure(samples_of(columns))
    if not reached <= claimed + reference.error:
        raise ClaimExceededError(
            f"{tier}, {case.kind}, {case.family}: the error is {reached:.2e} where {claimed:.2e} is claimed"
        )
    return claimed, reached


def this_machine() -> Machine:
    """Return the system, the processor and the number of processors of this machine."""
    return Machine(os.cpu_count() or 1, _processor(), f"{platform.system()} {platform.machine()}")


def _processor() -> str | None:
    try:
        lines: Sequence[str] = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = ()
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, None) or platform.processor() or None
