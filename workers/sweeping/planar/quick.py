"""The data for solving points of planar motions of one body in compiled doubles."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from service.dynamics.problem import PlanarMotion, Problem
from workers.sweeping.parameters.coefficients import Coefficients
from workers.sweeping.parameters.energies import Energies
from workers.sweeping.parameters.family import Path, Poles, SweepFamily

if TYPE_CHECKING:
    from workers.sweeping.planar.by_roots import RationalFamily


@dataclass(frozen=True, slots=True)
class Side:
    """The motions with one sign of g1; λ differs from point to point."""

    motion: PlanarMotion
    energies: Energies | None
    rational: "RationalFamily | None" = None
    """The potentials as sums of powers, at the tier ``high`` alone, which is for these."""


@dataclass(frozen=True, slots=True)
class Quick:
    """The data that hold for all points."""

    problem: Problem
    """The first point's."""
    potential: Mapping[str, object]
    """The base's."""
    paths: tuple[Path, ...]
    """Paths of the numbers in the potential that vary."""
    places: tuple[int, ...]
    """Indices of their axes, in the same order."""
    coefficients: Coefficients
    """Coefficients that these numbers make, in which the potential is linear."""
    curve_place: int | None
    """Index of the axis of λ or nu."""
    start_place: int | None
    """Index of the axis of g1 at the start."""
    moment_place: int | None
    """Index of the axis of B, on which planar motions do not depend."""
    time_places: Mapping[str, int]
    """Indices of the axes of the times, by their names."""
    sides: Mapping[int, Side]
    """The sides by the sign of g1."""
    family: SweepFamily
    poles: Poles | None
