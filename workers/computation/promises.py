"""Holds what was computed against the accuracy that was asked for, and computes in units that allow it."""

from collections.abc import Callable, Mapping
from math import inf
from typing import TypeVar

import numpy as np

from service.dynamics.accuracy import GroupError, keeps
from service.dynamics.bounds import is_within, largest
from service.dynamics.equations.orientation import (
    PRECESSION,
    QUATERNION,
    orientation_columns,
    orientation_errors,
)
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import Motion
from service.dynamics.problem import Accuracy, PlanarMotion, Problem, StateMotion
from service.dynamics.solution.dense_output import DenseOutput
from workers.solvers.choose import QUICK_SPEED
from workers.solvers.errors import AccuracyNotMetError, OwnUnitsNeededError
from workers.solvers.integration.errors import StepCollapseError
from workers.solvers.units import Units, speed_of, speed_of_state

T = TypeVar("T")

PLAIN = (AccuracyNotMetError, OwnUnitsNeededError)
"""Errors that tell no times: others would tell them in the units they were met in."""


def in_units(problem: Problem, solve: Callable[[Units], T]) -> T:
    """Return ``solve`` of the units in which the motion keeps what is asked, which may be the client's own.

    Raises
    ------
    AccuracyNotMetError
        It is not kept in either.
    """
    accuracy = problem.accuracy
    if accuracy.measure == "relative" or _is_quick(problem):
        return _in_own(problem, speed_of(problem), solve)
    try:
        return solve(Units())
    except (*PLAIN, StepCollapseError) as missed:
        if isinstance(missed, AccuracyNotMetError) and type(missed) not in PLAIN:
            raise
        speed = missed.speed if isinstance(missed, OwnUnitsNeededError) else speed_of(problem)
        reached = missed.reached if isinstance(missed, AccuracyNotMetError) else inf
        # Less of the error than this may be that of γ, but then more of it is that of ω.
        may_do = (
            is_within(reached, 2.0 * speed * accuracy.tolerance) if reached < inf else speed >= QUICK_SPEED
        )
        is_relative = accuracy.measure == "above 1" or isinstance(missed, StepCollapseError)
        if is_relative and speed >= 2.0 and may_do:
            return _in_own(problem, speed, solve)
        is_plain = isinstance(missed, AccuracyNotMetError) and missed.group is None
        if is_plain and 1.0 < speed < inf:
            raise _of_both(reached, accuracy.tolerance, speed) from None
        raise


def _is_quick(problem: Problem) -> bool:
    """Tell whether a motion is so quick that it is solved in its own units from the beginning.

    Of planar motions in doubles, and of classical ones, this is seen when they miss what is asked.
    """
    if isinstance(problem.motion, StateMotion):
        return speed_of_state(problem.motion) >= QUICK_SPEED
    is_proven = problem.accuracy.tier == "certified" and isinstance(problem.motion, PlanarMotion)
    return is_proven and speed_of(problem) >= QUICK_SPEED


def _in_own(problem: Problem, speed: float, solve: Callable[[Units], T]) -> T:
    units, accuracy = Units.of(speed, problem.body), problem.accuracy
    try:
        return solve(units)
    except DynamicsError as fault:
        if isinstance(fault, AccuracyNotMetError) and fault.group is not None:
            raise
        if type(fault) in PLAIN and isinstance(fault, AccuracyNotMetError) and speed > 0.0:
            reached = fault.reached * max(1.0, units.quick)
            is_relative = accuracy.measure != "absolute"
            raise _of_both(reached, accuracy.tolerance, speed, is_relative=is_relative) from None
        if not units.k:
            raise
    # What is told of times, and how the motion ends, is told in the client's units.
    return solve(Units())


def _of_both(
    reached: float, tolerance: float, speed: float, *, is_relative: bool = False
) -> AccuracyNotMetError:
    """Return the error that tells an absolute error and one relative to the speed."""
    group = ("omega", GroupError(reached, speed))
    return AccuracyNotMetError(reached, tolerance, group=group, is_relative=is_relative)


def errors_of(motion: Motion, attitude: DenseOutput | None) -> dict[str, GroupError]:
    """Return the errors by groups over the asked times, beside their sizes; none without samples."""
    if not len(motion.times):
        return {}
    return {**motion.group_errors, **({} if attitude is None else errors_of_attitude(motion, attitude))}


def errors_of_attitude(motion: Motion, attitude: DenseOutput) -> dict[str, GroupError]:
    """Return the errors of the quaternion and of each angle over the asked times, beside their sizes."""
    columns = orientation_columns(attitude, motion.times, motion.low_parts)
    errors = orientation_errors(attitude, motion.times)
    groups = {"quaternion": QUATERNION, **{name: (name,) for name in PRECESSION if name in columns}}
    return {
        group: GroupError(
            largest(errors[name] for name in names),
            largest(float(np.abs(columns[name]).max(initial=0.0)) for name in names),
        )
        for group, names in groups.items()
    }


def require_promise(accuracy: Accuracy, groups: Mapping[str, GroupError]) -> None:
    """Refuse errors that are more than was asked for.

    Tiers and absolute tolerances of the attitude are kept where it is computed; and the tier ``certified``
    promises its proven radii, not what doubles make of them.

    Raises
    ------
    AccuracyNotMetError
        They are.
    """
    is_relative = accuracy.measure == "relative"
    for name, group in groups.items():
        is_asked = is_relative or (name in ("omega", "gamma") and accuracy.tier != "certified")
        if is_asked and not keeps(accuracy, [group]):
            raise AccuracyNotMetError(
                group.absolute, accuracy.tolerance, group=(name, group), is_relative=is_relative
            )
