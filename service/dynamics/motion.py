"""A computed motion: the solution as a function of time, with its evidence."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from flint import arb

from service.dynamics.accuracy import GroupError
from service.dynamics.numerics import ErrorKind, SolvedBy
from service.dynamics.reduction.window import Window
from service.dynamics.solution.dense_output import DenseOutput, FloatArray, split

COLUMNS: tuple[str, ...] = ("p", "q", "r", "g1", "g2", "g3")
"""The six variables of the Euler-Poisson equations, in the order of every array."""


def columns_of(outputs: Collection[str]) -> list[str]:
    """Return the variables that are asked for by the ``outputs`` gamma and omega."""
    return [name for name in COLUMNS if ("gamma" if name.startswith("g") else "omega") in outputs]


EnclosureMethod = Literal["elliptic", "integral", "steps"]
"""Ways to an enclosure: elliptic functions, for potentials of three terms; the integral, for any formula;
proven steps, from any state."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number and the bound of its absolute error."""

    value: float
    error: float
    kind: ErrorKind
    """The way in which the bound is known."""

    @classmethod
    def of(cls, ball: arb, kind: ErrorKind = "theorem") -> Self:
        """Return the double next to the middle of a ball, with a bound that holds for all of the ball."""
        (value,), error = split(ball, 1)
        return cls(value, error, kind)


AperiodicKind = Literal["separatrix", "equilibrium", "collision", "pole"]
"""Why a planar motion never closes; the kinds of :data:`service.dynamics.reduction.window.WindowKind`."""


@dataclass(frozen=True, slots=True)
class Asymptote:
    """The limit of an aperiodic motion, forwards or backwards in time."""

    kind: Literal["equilibrium", "pole", "collision"]
    """A zero of p² of higher order; a pole that is not passed; a singularity of the potential."""
    time: Estimate | None
    """When it is there; None if only in the limit t → ±∞."""
    rate: Estimate | None
    """The distance dies out like exp(−rate |t|); None if it is reached, or approached more slowly."""
    gamma: tuple[float, float, float]
    """The Poisson variables there, rounded to doubles."""


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """Comparison of a motion with a second, independent method."""

    method: str
    """The witness: how the motion was computed a second time."""
    disagreement: float
    """Largest absolute difference of the six variables over |t| ≤ ``horizon``."""
    horizon: float
    """Largest |t| that was compared: beyond it the witness cannot vouch for its own digits."""
    agrees: bool
    """The disagreement is explained by the error estimates of the two methods."""
    why_none: str | None = None
    """Why nothing was compared but the start, which the two have in common; None if something was."""


@dataclass(frozen=True, slots=True)
class PlaceError:
    """Errors of γ of a planar motion, apart from those of p and r, within the breaks of its dense output."""

    late: float = 0.0
    """Error of the time at which it is at a place of the curve, wherever that is."""
    ends: int = 2
    """1 where the place at t = 0 is known to roundings, 2 where it may be late as well."""
    moved: float = 0.0
    """Bound of what this error is besides, at some places, times the rate of the fastest variable there."""
    off: float = 0.0
    """Error of g1, g2 and g3 besides."""


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion with everything that vouches for it."""

    method: SolvedBy
    dense: DenseOutput
    times: FloatArray
    """The requested times, each rounded to the nearest double, shape (n,)."""
    samples: FloatArray
    """The six variables p, q, r, g1, g2, g3 at the exact times, ``times`` + ``low_parts``, shape (n, 6)."""
    error: float
    """Largest absolute error of any of the six variables over ``times``."""
    samples_kind: ErrorKind
    """The way in which ``error`` is known."""
    function_kind: ErrorKind
    """The way in which the error of ``dense`` is known, but for that of its period."""
    energy: Estimate
    window: Window | None
    """Where on the curve a planar motion takes place; None if it was integrated from any state."""
    aperiodic: AperiodicKind | None
    """Why a planar motion has no period; None if it has one, or if it was integrated."""
    past: Asymptote | None
    future: Asymptote | None
    cross_check: CrossCheck | None
    conventions: tuple[str, ...]
    """Choices made where the equations leave one, such as the way through a pole."""
    evidence: Mapping[str, float | int | str]
    """Measurements by the solver: nodes, steps, changes at the last refinement."""
    low_parts: FloatArray | None = None
    """Exact times minus ``times``, shape (n,); None if zero."""
    first_passage: float | None = None
    """The least |t| at which a pole is passed by one of the ``conventions``; None if none is passed so."""
    enclosed_by: EnclosureMethod | None = None
    """How the samples were enclosed that doubles alone did not have to the tolerance; None if they had."""
    place_error: PlaceError | None = None
    """Errors of the place of a sample; None where ``dense.error`` alone is known."""
    unit: float = 1.0
    """So many times those of g1, g2, g3 are the errors of p, q, r: a power of 2, other than 1 for a motion
    that was solved in units of its own."""

    @property
    def group_errors(self) -> dict[str, GroupError]:
        """The errors of omega and gamma over ``times``, beside their sizes there."""
        return group_errors(self.samples, self.error, self.unit)


def group_errors(samples: FloatArray, error: float, unit: float) -> dict[str, GroupError]:
    """Return the errors of omega and gamma at ``samples``, shape (n, 6); see :attr:`Motion.unit`."""
    omega, gamma = (float(np.abs(part).max(initial=0.0)) for part in (samples[:, :3], samples[:, 3:]))
    return {
        "omega": GroupError(error * min(1.0, unit), omega),
        "gamma": GroupError(error / max(1.0, unit), gamma),
    }
