"""Measures seconds and errors of every tier on every problem."""

import json
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from statistics import median

from service.dynamics.accuracy import TIERS, AccuracyRow, AccuracyTable, Machine, Source, Unavailable
from service.dynamics.numerics import NUMERICS
from service.dynamics.problem import Tier
from service.dynamics.solution.dense_output import RADIUS
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
from workers.calibration.reference import CASES, SAMPLES, Case, ReferenceStates, reference_states, samples_of
from workers.computation.compute import solve_document

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
