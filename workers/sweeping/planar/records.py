"""The data for a block of neighbouring points of planar motions, and its results."""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from service.dynamics.bounds import printed_error
from service.dynamics.motion import COLUMNS
from service.dynamics.reduction.windows import NoMotionError
from service.schemas.sweep.sweep import Sweep
from workers.sweeping.planar.doubles import BlockResult

if TYPE_CHECKING:
    pass

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

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

    def __init__(self, sweep: Sweep, count: int) -> None:
        self.solved, self.refused = np.zeros(count, dtype=np.bool_), dict[str, BoolArray]()
        self.numbers = {name: np.full(count, np.nan) for name in sweep.keep}
        self.series = {name: np.full((count, sweep.samples), np.nan) for name in sweep.series_columns}

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
        for k, name in enumerate(name for name in self.series if name != "t"):
            at = COLUMNS.index(name) if result.samples.shape[2] == len(COLUMNS) else k
            self.series[name][indices] = result.samples[:, :, at]
        if "t" in self.series:
            self.series["t"][indices] = result.times

    def put(self, indices: IntArray, block: SolvedBlock) -> None:
        """Fill in points that were solved as a block of their own."""
        self.solved[indices] = block.solved
        for code, points in block.refused.items():
            self.refuse(code, indices[points])
        for mine, theirs in ((self.numbers, block.numbers), (self.series, block.series)):
            for name, column in theirs.items():
                mine[name][indices] = column


def printed_errors(numbers: Mapping[str, FloatArray], kept: Container[str]) -> dict[str, FloatArray]:
    """Return the ``kept`` errors of period and energy, as those of the decimals that a job writes."""
    return {
        f"{name}.error": np.array(
            list(map(printed_error, numbers[name].tolist(), numbers[f"{name}.error"].tolist()))
        )
        for name in ("period", "energy")
        if f"{name}.error" in kept and f"{name}.error" in numbers
    }
