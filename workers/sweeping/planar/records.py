"""The data for a block of neighbouring points of planar motions, and its results."""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.bounds import printed_error
from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import PlanarMotion, Problem, Times
from service.dynamics.reduction.windows import NoMotionError
from service.schemas.sweep.sweep import Sweep
from workers.solvers.compiled.batch import Tier
from workers.solvers.units import Units
from workers.sweeping.parameters.family import Energies
from workers.sweeping.parameters.points import SweptPoints
from workers.sweeping.parameters.templates import Group
from workers.sweeping.planar.doubles import BlockResult, Sampling

if TYPE_CHECKING:
    from workers.sweeping.planar.by_roots import RationalFamily

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

NO_MOTION, INVALID, INADMISSIBLE = NoMotionError.code, "invalid_problem", "inadmissible_potential"


@dataclass(frozen=True, slots=True)
class Side:
    """The motions with one sign of g1; λ differs from point to point."""

    motion: PlanarMotion
    energies: Energies | None = None
    """Of potentials that are proved at once."""
    rational: "RationalFamily | None" = None
    """The potentials as sums of powers, at the tier ``high`` alone, which is for these."""


@dataclass(frozen=True, slots=True)
class Request:
    """What is asked of the points of a group."""

    side: Side
    squares: Sequence[fmpq]
    """Their λ²."""
    units: Units
    sampling: Sampling
    """In these units, as the times are."""
    tier: Tier
    start_axis: int | None
    """Index of the axis of g1 at the start, if it varies."""
    times: Sequence[Times] | None
    """The times of each, where they vary."""


class Potentials(Protocol):
    """The potentials of a sweep, with their programs: proved at once, or judged one by one."""

    def at(self, points: SweptPoints) -> "PotentialsOfBlock":
        """Return those at the points of a block."""


class PotentialsOfBlock(Protocol):
    """The potentials at the points of a block."""

    usable: BoolArray
    """Whether their numbers are within the limits of doubles, shape (points,)."""

    def groups(self, indices: IntArray, *, has_rests: bool) -> list[Group]:
        """Return points by their programs, with ``rests`` if they are asked for.

        Points without a program, or of which it is not known that they are admissible, are left out.
        """

    def refused(self) -> Mapping[str, Sequence[int]]:
        """Return the points so far that certainly end with an error, by its code."""

    def body(self, index: int) -> RigidBody:
        """Return the body of a point."""

    def potential(self, index: int) -> Potential:
        """Return the potential of a point."""

    def solve(self, group: Group, request: Request) -> BlockResult | None:
        """Solve the points of a group; None if motions of their kind are not solved here."""

    def energies(self, group: Group, side: Side, squares: Sequence[fmpq]) -> FloatArray:
        """Return energies and bounds of their errors as jobs have them, shape (points, 2), NaN in doubt."""

    def are_smooth(self, group: Group, side: Side, passing: BoolArray) -> BoolArray:
        """Tell for the points ``passing`` a pole whether they need no convention there."""

    def have_no_motion(self, group: Group, side: Side, rest: IntArray, squares: Sequence[fmpq]) -> BoolArray:
        """Tell which of the ``rest`` of a group, on the curves of these λ², are proved to have no motion."""


@dataclass(frozen=True, slots=True)
class RowPlan:
    """What the points of a sweep, or of a part of it, have in common; axes are told by their index."""

    problem: Problem
    """The first point's."""
    tier: Tier
    potentials: Potentials
    curve_axis: int | None
    """λ or nu."""
    start_axis: int | None
    """g1 at the start."""
    moment_axis: int | None
    """B, on which planar motions do not depend."""
    time_axes: Mapping[str, int]
    """The times, by their names."""
    sides: Mapping[int, Side]
    """The sides by the sign of g1."""


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
