"""Computes points one by one, by the functions of a single job."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.jobs.records import Refused, SolveOutcome
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError
from service.schemas.sweep.sweep import Sweep, kept_numbers
from service.storage.codecs.arrays import decode_arrays
from service.storage.codecs.points import SOLVED
from service.verdicts.cached import Kept
from workers.computation.compute import solve_checked, solve_document
from workers.solvers.ways import Way

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """The kept numbers and the outcome of one point."""

    outcome: str
    """``solved``, or the code of its error."""
    numbers: Sequence[float]
    """NaN for missing numbers."""
    series: Mapping[str, FloatArray]
    """Empty for a point that was not solved."""


def solve_point(
    sweep: Sweep, index: int, *, is_judged: bool, way: Way, waits: bool = False, kept: Kept | None = None
) -> SweepPoint:
    """Solve the point like its job of that way; with ``is_judged`` its potential is known to be admissible.

    Then only the verdict is skipped: other refusals that precede a job are
    raised by the job itself. Else the verdict may be in ``kept``, or is put there.

    Raises
    ------
    NeedsKernelsError
        A plain way that ``waits`` for kernels refuses the point.
    """
    document = json.dumps(sweep.document(index))
    try:
        outcome = (
            solve_document(document, way=way, waits=waits, read=read_problem)
            if is_judged
            else solve_checked(document, explains=False, kept=kept, way=way, waits=waits)
        )
    except InvalidProblemError:
        return _refused(sweep, "invalid_problem")
    return _kept(sweep, outcome)


def _kept(sweep: Sweep, outcome: SolveOutcome) -> SweepPoint:
    if isinstance(outcome, Refused):
        return _refused(sweep, str(outcome.error["code"]))
    columns = decode_arrays(outcome.samples) if sweep.series_columns else {}
    series = {name: columns[name] for name in sweep.series_columns}
    return SweepPoint(SOLVED, kept_numbers(outcome.summary, sweep.keep), series)


def _refused(sweep: Sweep, code: str) -> SweepPoint:
    return SweepPoint(code, [np.nan] * len(sweep.keep), {})
