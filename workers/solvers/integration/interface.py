"""The protocol of integrators of the six equations: a run made of polynomial pieces."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.equations.euler_poisson import moments_of
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.motion import COLUMNS
from service.dynamics.solution.dense_output import DenseOutput
from workers.solvers.integration.errors import CollisionError, IntegrationError, StepCollapseError

FloatArray = NDArray[np.float64]

COLLAPSED_STEP_RATIO = 1e-13
"""A step this much shorter than the longest one so far will not come back: towards a singularity
at t* the steps shrink in proportion to t* - t, so t* is then known to the rounding of t."""
COLLISION_GRADIENT_GROWTH = 1e6
"""Growth of the potential's gradient, since the start, that tells a collision from a mere loss of
smoothness: at a collapsed step a term 1/g² has grown by 1e19, sqrt(g) by 1e6, |g|^(4/3) not at all."""

Rounding = Callable[[Fraction], float]
"""How exact constants become doubles: to the nearest one, or to :func:`neighbour_of` it."""


def rounded_moments(body: RigidBody, rounding: Rounding) -> FloatArray:
    """Return A, B, C, B − C, C − A, A − B as doubles; raises MissingMomentError if B was left out."""
    body.require_B("integration of the six equations")
    return np.array([rounding(each) for each in moments_of(body)])


@dataclass(frozen=True, slots=True)
class Run:
    """One integration from t = 0 in one direction.

    Parameters
    ----------
    breaks
        Shape (pieces + 1,), from 0 away: increasing or decreasing.
    coefficients
        Shape (pieces, degree + 1, 6): Chebyshev series of each piece over
        [breaks[k], breaks[k+1]] with x = −1 at breaks[k].
    ending
        Why the run stopped short of the time that was asked for, or None.
    """

    breaks: FloatArray
    coefficients: FloatArray
    ending: IntegrationError | None

    @property
    def reached(self) -> float:
        """The last time of the run."""
        return float(self.breaks[-1])


class Steps(Protocol):
    """The local tolerances that a method can be given, and the errors of its steps."""

    finest: float
    """Local tolerance below which rounding, not truncation, makes the error."""
    coarsest: float
    """Largest local tolerance, whatever is asked: beyond it the method is not in its element."""
    first_share: float
    """Local tolerance of the first try, of the coarser run, in parts of the tolerance: errors of some hundred
    steps add up."""
    leaves_out: float
    """Truncation error of a step, relative to the largest variable, in local tolerances."""
    tightening: float
    """How much tighter the second of two runs must be for other steps and a smaller error."""


class Integrator(Steps, Protocol):
    """The six equations for one body and one potential, ready to be integrated."""

    name: str

    def neighbour(self) -> Self:
        """Return the integrator of a problem that the rounded moments and coefficients might have meant."""
        ...

    def run(
        self,
        state: FloatArray,
        end: float,
        *,
        local_tolerance: float,
        max_steps: int,
        longest: float = inf,
        since: float = 0.0,
    ) -> Run:
        """Integrate from ``state``, shape (6,), at t = 0 to t = ``end``, which may be negative.

        ``local_tolerance`` bounds the error of one step relative to the largest
        variable, ``longest`` the length of a step. What ends the run early is
        returned with it, not raised, and tells times that are later by ``since``.
        """
        ...

    def keeps(self, run: Run, goal: float, allowed: float) -> bool:
        """Say whether kernels show that no step of ``run`` leaves more than ``allowed`` of the equations.

        Interpolation may leave out ``goal`` in all. False says nothing.
        """
        ...


def joined(backward: Run | None, forward: Run | None) -> DenseOutput:
    """Return one function of time from the runs on the two sides of t = 0; its error is not known yet."""
    breaks: list[FloatArray] = [np.zeros(1)]
    pieces: list[FloatArray] = []
    if backward is not None:
        breaks.insert(0, backward.breaks[:0:-1])
        mirrored = backward.coefficients[::-1].copy()
        mirrored[:, 1::2] *= -1.0
        pieces.append(mirrored)
    if forward is not None:
        breaks.append(forward.breaks[1:])
        pieces.append(forward.coefficients)
    return DenseOutput(COLUMNS, np.concatenate(breaks), stacked(pieces), None, float("inf"))


def stacked(parts: Sequence[FloatArray]) -> FloatArray:
    """Return pieces of different degrees as one array, filled up with zeros; (0, 1, 6) if there are none."""
    length = max((part.shape[1] for part in parts), default=1)
    padded = [np.pad(part, ((0, 0), (0, length - part.shape[1]), (0, 0))) for part in parts]
    return np.concatenate([np.zeros((0, length, 6)), *padded])


def step_has_collapsed(step: float, longest: float, time: float) -> bool:
    """Return whether a step is too short to go on with."""
    return not abs(step) > max(COLLAPSED_STEP_RATIO * longest, 4.0 * float(np.spacing(abs(time))))


def collapse(time: float, start_gradient: FloatArray, end_gradient: FloatArray) -> IntegrationError:
    """Return what a collapsed step means, by how the potential's gradient has grown."""
    # Their squares may be beyond doubles.
    return collapse_by(time, math.hypot(*start_gradient.tolist()), math.hypot(*end_gradient.tolist()))


def collapse_by(time: float, start: float, end: float, error: float = inf) -> IntegrationError:
    """Return what a collapsed step means, by the sizes of the potential's gradient.

    One run alone does not know the error of a collision's time.
    """
    if not end <= COLLISION_GRADIENT_GROWTH * start:
        return CollisionError(time=time, error=error, start=start, end=end)
    return StepCollapseError(
        f"the steps shrink to nothing at t = {time:.15g} while the potential's gradient stays at {end:.1e}: "
        "the potential is not smooth, or not defined, there; ask for times nearer to 0",
        time=time,
    )


def too_many_steps(time: float, end: float, max_steps: int) -> StepCollapseError:
    """Return the error of a run that used up its steps."""
    return StepCollapseError(
        f"{max_steps} steps reach t = {time:.15g} only, of {end:.15g}; ask for times nearer to 0", time=time
    )


def neighbour_of(number: Fraction | float) -> float:
    """Return the neighbour of the nearest double that a rounded number might as well have been.

    An exact number that a double holds has none: it is returned itself. For a
    rational the neighbour is on the side of the true value; a double may stand
    for anything that rounds to it, so its next neighbour outwards is taken.
    """
    value = nearest_double(number) if isinstance(number, Fraction) else float(number)
    if (
        value == 0.0
        or not math.isfinite(value)
        or (isinstance(number, Fraction) and Fraction(value) == number)
    ):
        return value
    if isinstance(number, Fraction):
        return float(np.nextafter(value, np.inf if number > Fraction(value) else -np.inf))
    return float(np.nextafter(value, np.copysign(np.inf, value)))
