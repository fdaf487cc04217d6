"""The data for a block of neighbouring points of planar motions of one body, and its results."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from service.dynamics.motion import COLUMNS
from service.dynamics.numerics import printed_error
from service.dynamics.problem import PlanarMotion, Problem
from service.dynamics.reduction.windows import NoMotionError
from service.schemas.sweep.sweep import Sweep
from workers.sweeping.parameters.coefficients import Coefficients
from workers.sweeping.parameters.family import Energies, Path, Poles
from workers.sweeping.planar.doubles import BlockResult

if TYPE_CHECKING:
    from workers.sweeping.planar.by_roots import RationalFamily

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Side:
    """The motions with one sign of g1; λ differs from point to point."""

    motion: PlanarMotion
    energies: Energies | None
    rational: "RationalFamily | None" = None
    """The potentials as sums of powers, at the tier ``high`` alone, which is for these."""


@dataclass(frozen=True, slots=True)
class CompiledPlan:
    """The data that hold for all points."""

    problem: Problem
    """The first point's."""
    potential: Mapping[str, object]
    """The base's."""
    paths: tuple[Path, ...]
    """Paths of the numbers in the potential that vary."""
    axes: tuple[int, ...]
    """Indices of their axes, in the same order."""
    coefficients: Coefficients
    """Coefficients that these numbers make, in which the potential is linear."""
    curve_axis: int | None
    """Index of the axis of λ or nu."""
    start_axis: int | None
    """Index of the axis of g1 at the start."""
    moment_axis: int | None
    """Index of the axis of B, on which planar motions do not depend."""
    time_axes: Mapping[str, int]
    """Indices of the axes of the times, by their names."""
    sides: Mapping[int, Side]
    """The sides by the sign of g1."""
    poles: Poles | None


NO_MOTION, INVALID, INADMISSIBLE = NoMotionError.code, "invalid_problem", "inadmissible_potential"


@dataclass(frozen=True, slots=True)
class SolvedBlock:
    """Some neighbouring points; those neither ``solved`` nor ``refused`` are left to single jobs."""

    solved: BoolArray
    """Shape (points,)."""
    refused: Mapping[str, BoolArray]
    """The points that certainly end with the error of this code, shape (points,)."""
    numbers: Mapping[str, FloatArray]
    """The kept numbers, each of shape (points,)."""
    series: Mapping[str, FloatArray]
    """The functions of time, each of shape (points, samples)."""

    @property
    def is_open(self) -> BoolArray:
        """Tell which are left."""
        undecided: BoolArray = ~np.logical_or.reduce([self.solved, *self.refused.values()])
        return undecided


class FoundPoints:
    """The results of a block, filled in group by group."""

    def __init__(self, sweep: Sweep, names: Sequence[str], count: int) -> None:
        self.solved, self.refused = np.zeros(count, dtype=np.bool_), dict[str, BoolArray]()
        self.numbers = {name: np.full(count, np.nan) for name in sweep.keep}
        shape = (count, sweep.samples)
        self.series = {name: np.full(shape, np.nan) for name in sweep.series_columns}
        self._names = names

    def refuse(self, code: str, indices: IntArray) -> None:
        """Note that these points end with an error."""
        if len(indices):
            self.refused.setdefault(code, np.zeros(len(self.solved), dtype=np.bool_))[indices] = True

    def block(self) -> SolvedBlock:
        """Return all of it."""
        return SolvedBlock(self.solved, self.refused, self.numbers, self.series)

    def add(
        self, indices: IntArray, solved: BoolArray, numbers: Mapping[str, FloatArray], result: BlockResult
    ) -> None:
        """Fill in the points of a group."""
        self.solved[indices] = solved
        numbers = {**numbers, **printed_errors(numbers, self.numbers)}
        for name, column in self.numbers.items():
            if name in numbers:
                column[indices] = numbers[name]
        for k, name in enumerate(self._names):
            at = COLUMNS.index(name) if result.samples.shape[2] == len(COLUMNS) else k
            self.series[name][indices] = result.samples[:, :, at]
        if "t" in self.series:
            self.series["t"][indices] = result.times


def printed_errors(numbers: Mapping[str, FloatArray], kept: Container[str]) -> dict[str, FloatArray]:
    """Return the ``kept`` errors of period and energy, as those of the decimals that a job writes."""
    return {
        f"{name}.error": np.array(
            list(map(printed_error, numbers[name].tolist(), numbers[f"{name}.error"].tolist()))
        )
        for name in ("period", "energy")
        if f"{name}.error" in kept and f"{name}.error" in numbers
    }


def numbers_of_motions(result: BlockResult, has_times: bool) -> dict[str, FloatArray]:
    """Return period and errors as a job tells them."""
    # Without functions of time a job claims no error of them.
    error = result.errors if has_times else np.zeros(len(result.errors))
    period_errors = np.nextafter(result.period_errors, np.inf)
    return {"period": result.periods, "period.error": period_errors, "error": error}
