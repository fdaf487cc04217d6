"""Points one by one, by the very functions that compute a single job."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.jobs.outcome import SolveOutcome
from service.schemas.faults import InvalidProblemError
from service.schemas.sweep import Sweep
from service.schemas.sweep_numbers import kept_numbers
from service.storage.solutions.codec import decode_arrays
from service.storage.sweeps.chunk_codec import SOLVED
from workers.computation import solve_checked, solve_document

FloatArray = NDArray[np.float64]

INVALID = "invalid_problem"


@dataclass(frozen=True, slots=True)
class Point:
    """What is kept of one point."""

    outcome: str
    """``solved``, or the code of its error."""
    numbers: Sequence[float]
    """NaN for what it has not."""
    series: Mapping[str, FloatArray]
    """Empty for a point that was not solved."""


def solve_point(sweep: Sweep, index: int, *, is_judged: bool) -> Point:
    """Return the point as its job has it; ``is_judged``: its potential is known to be admissible.

    Then only the verdict is spared: whatever else is refused before a job, the
    job itself ends with.
    """
    document = json.dumps(sweep.document(index))
    try:
        outcome = solve_document(document) if is_judged else solve_checked(document, explains=False)
    except InvalidProblemError:
        return _refused(sweep, INVALID)
    return _kept(sweep, outcome)


def _kept(sweep: Sweep, outcome: SolveOutcome) -> Point:
    if outcome.summary is None:
        return _refused(sweep, str((outcome.error or {}).get("code")))
    columns = decode_arrays(outcome.samples) if sweep.series_columns else {}
    series = {name: columns[name] for name in sweep.series_columns}
    return Point(SOLVED, kept_numbers(outcome.summary, sweep.keep), series)


def _refused(sweep: Sweep, code: str) -> Point:
    return Point(code, [np.nan] * len(sweep.keep), {})
