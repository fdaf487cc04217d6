"""A computed motion: the solution as a function of time, with its evidence."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from service.dynamics.dense_output import DenseOutput, FloatArray
from service.dynamics.reduction.window import Window

COLUMNS: tuple[str, ...] = ("p", "q", "r", "g1", "g2", "g3")
"""The six variables of the Euler-Poisson equations, in the order of every array."""

SolvedBy = Literal["quadrature", "integration"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and the bound of its absolute error."""

    value: float
    error: float


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """What a second, independent method says about a motion."""

    method: str
    """The witness: how the motion was computed a second time."""
    disagreement: float
    """Largest absolute difference of the six variables over |t| ≤ ``horizon``."""
    horizon: float
    """Largest |t| that was compared: beyond it the witness cannot vouch for its own digits."""
    agrees: bool
    """The disagreement is explained by the error estimates of the two methods."""


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion with everything that vouches for it."""

    method: SolvedBy
    dense: DenseOutput
    times: FloatArray
    """The times asked for, shape (n,)."""
    samples: FloatArray
    """The six variables p, q, r, g1, g2, g3 at ``times``, shape (n, 6)."""
    error: float
    """Largest absolute error of any of the six variables over ``times``."""
    energy: Estimate
    window: Window | None
    """Where on the curve a planar motion takes place; None if it was integrated from any state."""
    cross_check: CrossCheck | None
    conventions: tuple[str, ...]
    """Choices made where the equations leave one, such as the way through a pole."""
    evidence: Mapping[str, float | int | str]
    """What the solver measured about itself: nodes, steps, changes at the last refinement."""
