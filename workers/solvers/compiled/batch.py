"""Solves many motions in one call, or a single one: arrays of problems in, arrays of results out."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from service.dynamics.sampling import SampleTimes
from workers.solvers.compiled.evaluation.program import Program
from workers.solvers.compiled.motion import Bounds
from workers.solvers.compiled.records import FOUND, MAX_PANELS, PANEL, Records, copied, new_records
from workers.solvers.compiled.solve_set import solve_sets
from workers.solvers.compiled.workspace import own_workspace

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Tier = Literal["draft", "standard", "high"]

TOLERANCES: dict[Tier, float] = {"draft": 2e-9, "standard": 1e-13, "high": 2e-15}
"""Tail of dt/du on a panel against the whole, below which it is resolved."""

_NO_RESTS = np.empty((0, 0))
NO_TIMES = SampleTimes(np.zeros(0), np.zeros(0))


@dataclass(frozen=True, slots=True)
class Batch:
    """Motions in potentials of one program, which differ in its constants and in λ."""

    program: Program
    constants: FloatArray
    """Shape (sets, constants)."""
    loops: Records
    """Shape (sets,): what :meth:`.frame.Frame.loops` returns, or loops known by their roots."""
    tier: Tier
    times: SampleTimes = NO_TIMES
    """Times at which all of them are sampled."""
    columns: IntArray = field(default_factory=lambda: np.arange(6))
    """Numbers of the variables that are sampled."""
    rests: FloatArray | None = None
    """Low parts of the constants, of the same shape; then the loops have theirs as well, and motions are
    solved with twice the digits where doubles would lose some (:mod:`.doubled`)."""


@dataclass(frozen=True, slots=True)
class BatchResult:
    """The results, in the order of the batch; NaN where a motion was not decided."""

    loops: Records
    """With their orbits."""
    found: Records
    """A :class:`.records.Found` of each."""
    samples: FloatArray
    """Shape (sets, times, columns)."""
    panels: Records
    """The time map of the last motion."""

    @property
    def bounds(self) -> Bounds:
        """Return what the errors of samples are made of, arrays of shape (sets,)."""
        return bounds_of(self.found)

    def errors_at(self, latest: FloatArray | float) -> FloatArray:
        """Return the bounds of the errors up to |t| = ``latest``, shape (sets,); inf where not decided."""
        return errors_of(self.found, latest)


def solve_batch(batch: Batch) -> BatchResult:
    """Solve every motion of a batch by compiled code: each has the very numbers that it has alone."""
    sets, times = len(batch.loops), batch.times
    loops, panels = copied(batch.loops), new_records(PANEL, MAX_PANELS)
    found = new_records(FOUND, sets)
    samples = np.empty((sets, len(times.doubles), len(batch.columns)))
    solve_sets(
        batch.program.code,
        batch.program.result,
        batch.program.turn,
        batch.constants,
        _NO_RESTS if batch.rests is None else batch.rests,
        TOLERANCES[batch.tier],
        times.doubles,
        times.low_parts,
        batch.columns,
        loops,
        panels,
        found,
        own_workspace(),
        samples,
    )
    return BatchResult(loops, found, samples, panels[: int(found[-1]["panels"])] if sets else panels[:0])


def bounds_of(found: Records) -> Bounds:
    """Return what the errors of samples are made of."""
    return Bounds(found["time_error"], found["speed"], found["rate_error"], found["largest"], found["moved"])


def errors_of(found: Records, latest: FloatArray | float) -> FloatArray:
    """Return the bounds of the errors of samples up to |t| = ``latest``; inf where not decided."""
    errors = bounds_of(found).error_at(latest, found["period"], found["period_error"])
    return np.where((found["panels"] > 0) & ~np.isnan(errors), errors, np.inf)
