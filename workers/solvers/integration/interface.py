"""The protocol of integrators of the six equations, and runs whose every step satisfies them.

A run is made of polynomial pieces. An integrator chooses its steps by what it sees where a step begins, or
at a few places on it: what is narrower than a step it steps over. So the polynomial of every step is put into
the equations, whose right-hand sides are bounded by discs around it (:mod:`service.dynamics.defect`). Where
the defect is more than the step's own error and rounding can be, the run is cut, and goes on from there with
steps as short as the stretch on which that was seen.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.defect.accumulation import Blocks, StretchBatch, defect_within
from service.dynamics.defect.equations import Equations
from service.dynamics.defect.evidence import STATE_RELATIVE_ROUNDING, hides_something
from service.dynamics.equations.euler_poisson import moments_of
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.motion import COLUMNS
from service.dynamics.solution.dense_output import DenseOutput, chebyshev_coefficients, chebyshev_points
from workers.solvers.errors import CollisionError, IntegrationError, StepCollapseError

FloatArray = NDArray[np.float64]
Rounding = Callable[[Fraction], float]
"""How exact constants become doubles: to the nearest one, or to :func:`neighbour_of` it."""
COLLAPSED_STEP_RATIO = 1e-13
"""A step this much shorter than the longest one so far will not come back: towards a singularity
at t* the steps shrink in proportion to t* - t, so t* is then known to the rounding of t."""
COLLISION_GRADIENT_GROWTH = 1e6
"""Growth of the potential's gradient, since the start, that tells a collision from a mere loss of
smoothness: at a collapsed step a term 1/g² has grown by 1e19, sqrt(g) by 1e6, |g|^(4/3) not at all."""
STEPS_BETWEEN_CHECKS = 24
"""Steps between two checks, once a step has failed."""
MAX_RESTARTS = 400
"""Checks after the first failure: a feature takes some ten."""
STEP_RELATIVE_ROUNDING = 2.0**-43
"""Rounding error of one step, relative to the variables: some hundred roundings of a state."""
MAX_DEFECT_TOLERANCES = 1e3
"""Largest defect of a step, in local tolerances: between its ends the function of time is less good."""
STEP_REGROWTH = 4.0
"""Factor by which the longest step grows at each check that finds nothing."""
UNCHECKED_TIME_SHARE = 1e-6
"""Share of the time of a run that ends early of which nothing is asked."""
MIN_STEP_SHARE = 1e-14
"""Shortest step that is tried, in parts of the time to go."""


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
    """Return what a collapsed step means, by how the potential's gradient has grown.

    One run alone does not know the error of a collision's time.
    """
    # Their squares may be beyond doubles.
    start, end = math.hypot(*start_gradient.tolist()), math.hypot(*end_gradient.tolist())
    if not end <= COLLISION_GRADIENT_GROWTH * start:
        return CollisionError(time=time, error=inf, start=start, end=end)
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


@dataclass(frozen=True, slots=True)
class _Failure:
    """The first stretch of a run on which its polynomial fails the equations."""

    time: float
    """Where it begins, seen in the direction of the run."""
    length: float


def followed(
    integrator: Integrator,
    equations: Equations,
    state: FloatArray,
    end: float,
    *,
    local_tolerance: float,
    max_steps: int,
    looseness: float = 1.0,
) -> Run:
    """Integrate as ``integrator.run`` does; every step satisfies the equations on its whole length.

    ``looseness`` multiplies the defect that passes for rounding. Of two runs that are compared one needs a
    larger one: at kinks both would leave the same error of that size, and their difference would not show it.
    Of a potential given by an integral, and of a stretch about a kink too short to be cut, nothing is
    said. What ends the run early is returned with it.
    """
    run = integrator.run(state, end, local_tolerance=local_tolerance, max_steps=max_steps)
    if equations.tape is None:
        return run
    failure = _first_failure(integrator, equations, run, local_tolerance, looseness)
    if failure is None:
        return run
    parts = [_until(run, failure.time)]
    done, steps, longest = failure.time, len(parts[0].coefficients), failure.length
    for _ in range(MAX_RESTARTS):
        if longest <= MIN_STEP_SHARE * abs(end):
            break
        if steps > max_steps:
            return replace(_together(parts, end), ending=too_many_steps(done, end, max_steps))
        state = _last_state(parts, state)
        part = integrator.run(
            state,
            end - done,
            local_tolerance=local_tolerance,
            max_steps=STEPS_BETWEEN_CHECKS,
            longest=longest,
            since=done,
        )
        failure = _first_failure(integrator, equations, part, local_tolerance, looseness)
        if failure is not None:
            longest = 0.5 * min(failure.length, longest) if failure.time == 0.0 else failure.length
            part = _until(part, failure.time)
        parts.append(part)
        steps += len(part.coefficients)
        is_whole = failure is None and len(part.coefficients) < STEPS_BETWEEN_CHECKS
        if is_whole or (failure is None and part.reached == end - done):
            return replace(_together(parts, end), ending=part.ending)
        done += part.reached
        longest = longest if failure is not None else STEP_REGROWTH * longest
    return replace(_together(parts, end), ending=_not_followed(done, end))


def _first_failure(
    integrator: Integrator, equations: Equations, run: Run, local_tolerance: float, looseness: float
) -> _Failure | None:
    if len(run.breaks) == 1:
        return None
    is_forward = run.reached > 0.0
    size = float(np.abs(run.coefficients).max())
    allowed = size * max(MAX_DEFECT_TOLERANCES * local_tolerance, looseness * STEP_RELATIVE_ROUNDING)
    goal = 0.1 * allowed * (len(run.breaks) - 1)
    # Next to the singularity it runs into, a run is not asked what is there.
    limit = inf if run.ending is None else (1.0 - UNCHECKED_TIME_SHARE) * abs(run.reached)
    asked = int(np.searchsorted(np.abs(run.breaks[:-1]), limit, side="left"))
    if integrator.keeps(Run(run.breaks[: asked + 1], run.coefficients[:asked], None), goal, allowed):
        return None
    dense = joined(None, run) if is_forward else joined(run, None)
    found: _Failure | None = None
    for block in Blocks(dense, equations.at, equations.bound).cut(goal):
        failed = np.flatnonzero(_fails(equations, block, allowed))
        if not len(failed):
            continue
        parts = block.stretches
        first = failed[0 if is_forward else -1]
        piece, begins = int(parts.piece[first]), float(parts.middle[first] - parts.half[first])
        ends = begins + 2.0 * float(parts.half[first])
        left, right = float(dense.breaks[piece]), float(dense.breaks[piece + 1])
        share = 0.5 * (1.0 + (begins if is_forward else ends))
        time = left if share == 0.0 else right if share == 1.0 else left + (right - left) * share
        found = _Failure(time, (right - left) * float(parts.half[first])) if abs(time) < limit else None
        if is_forward:
            break
    return found


@np.errstate(all="ignore")
def _fails(equations: Equations, block: StretchBatch, allowed: float) -> NDArray[np.bool_]:
    """Say on which stretches the defect is neither the step's error nor rounding, or may be hidden."""
    _, extent = defect_within(block)
    fails = block.stretches.is_settled & (extent > allowed).any(axis=1)
    if fails.any():
        states = block.states[fails]
        columns = states.reshape(-1, 6).T
        spread = equations.spread(columns, STATE_RELATIVE_ROUNDING * np.abs(columns)).T.reshape(states.shape)
        rounding = 2.0 * block.times[fails, None] * spread.max(axis=1)
        fails[fails] = (extent[fails] > allowed + rounding).any(axis=1)
    return fails | hides_something(equations, block, is_planar=False)


def _until(run: Run, time: float) -> Run:
    """Return the run as far as ``time``, its last step cut there."""
    count = int(np.searchsorted(np.abs(run.breaks), abs(time), side="left"))
    if run.breaks[count] == time:
        return Run(run.breaks[: count + 1], run.coefficients[:count], None)
    begins, ends = float(run.breaks[count - 1]), float(run.breaks[count])
    share = (time - begins) / (ends - begins)
    degree = run.coefficients.shape[1] - 1
    x = -1.0 + share * (1.0 + chebyshev_points(max(degree, 1)))
    values = np.polynomial.chebyshev.chebvander(x, degree) @ run.coefficients[count - 1]
    last = chebyshev_coefficients(values)[None, : degree + 1]
    return Run(
        np.append(run.breaks[:count], time), np.concatenate([run.coefficients[: count - 1], last]), None
    )


def _together(parts: list[Run], end: float) -> Run:
    """Return the runs as one; each has its own t = 0 where the one before ends."""
    breaks, done = [np.zeros(1)], 0.0
    for part in parts:
        breaks.append(done + part.breaks[1:])
        is_last = part is parts[-1] and part.reached == end - done
        done = end if is_last else done + part.reached
        if is_last:
            breaks[-1][-1] = end
    return Run(np.concatenate(breaks), stacked([part.coefficients for part in parts]), None)


def _last_state(parts: list[Run], start: FloatArray) -> FloatArray:
    coefficients = parts[-1].coefficients
    return np.asarray(coefficients[-1].sum(axis=0)) if len(coefficients) else start


def _not_followed(time: float, end: float) -> StepCollapseError:
    return StepCollapseError(
        f"the potential changes within less than any step from t = {time:.15g} on, of {end:.15g}, "
        "and what it does there cannot be followed; ask for times nearer to 0",
        time=time,
    )
