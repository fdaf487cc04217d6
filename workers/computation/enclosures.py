"""Motions with enclosures: samples that are rounded ones, the attitude, and the columns that hold them."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import inf, nextafter, ulp

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.accuracy import GroupError
from service.dynamics.equations.orientation import QUATERNION
from service.dynamics.errors import MissingMomentError
from service.dynamics.motion import COLUMNS, Motion
from service.dynamics.numerics import is_within, largest
from service.dynamics.problem import Problem, TimePeriods
from service.dynamics.sampling import exact_instants
from service.dynamics.solution.dense_output import JOIN_BITS, RADIUS, Period, split
from workers.solvers.certified.certify import Certified
from workers.solvers.choose import choose_enclosures, enclose, proven_start
from workers.solvers.errors import (
    AccuracyNotMetError,
    CertifiedUnavailableError,
    is_known,
    require_period_known,
)
from workers.solvers.evidence import with_samples_raised
from workers.solvers.orientation.advance import with_proven_attitude

FloatArray = NDArray[np.float64]


def with_tolerance_kept(problem: Problem, motion: Motion) -> Motion:
    """Return ``motion``; if its samples or its period are worse than the tolerance, with rounded enclosures.

    Its function of time is unchanged and has its own error.

    Raises
    ------
    AccuracyNotMetError
        There is no enclosure of this kind of motion, or its rounding to doubles is worse as well;
        of the period it is a PeriodNotKnownError.
    """
    if is_within(motion.error, problem.tolerance) and is_known(motion.dense.period, problem.tolerance):
        return motion
    try:
        enclosed = enclosed_motion(problem, motion)
    except CertifiedUnavailableError:
        require_period_known(motion.dense.period, problem.tolerance)
        raise AccuracyNotMetError(motion.error, problem.tolerance) from None
    motion = with_period_known(motion, enclosed, problem.tolerance)
    rounded = np.array([[float(ball.mid()) for ball in state] for state in enclosed.states])
    proven = with_samples(problem, motion, enclosed, rounded)
    if not is_within(proven.error, problem.tolerance):
        raise AccuracyNotMetError(min(motion.error, proven.error), problem.tolerance)
    return replace(proven, enclosed_by=enclosed.method)


def with_period_known(motion: Motion, enclosed: Certified, tolerance: float) -> Motion:
    """Return ``motion`` with the enclosed period and times if its period is not known to this tolerance.

    Raises
    ------
    PeriodNotKnownError
        Its rounding to doubles is worse as well.
    """
    if is_known(motion.dense.period, tolerance):
        return motion
    # The function of time is one of wrong times: no two values of a variable differ by more than this.
    wrong = 2.0 * float(np.abs(motion.dense.coefficients).sum(axis=1).max(initial=0.0))
    assert enclosed.period is not None
    dense = replace(motion.dense, period=Period.of(enclosed.period), error=motion.dense.error + wrong)
    require_period_known(dense.period, tolerance)
    # Parts of the period that were asked for are later, or sooner.
    times = np.array([float(at) for at in enclosed.times])
    left = np.array([float(at - arb(t)) for at, t in zip(enclosed.times, times.tolist(), strict=True)])
    return replace(motion, dense=dense, times=times, low_parts=left, place_error=None)


def enclosed_motion(problem: Problem, motion: Motion) -> Certified:
    """Return the enclosures of a planar motion at its times; raises CertifiedUnavailableError."""
    period = motion.dense.period
    return enclose(
        problem.body,
        problem.potential,
        problem.motion,
        # Without any function of time there are no samples.
        exact_instants(problem.time) if len(motion.times) else [],
        problem.accuracy.bits,
        methods=choose_enclosures(problem).asked,
        about_a_period=period.hi if period is not None and isinstance(problem.time, TimePeriods) else None,
    )


def with_attitude(problem: Problem, motion: Motion, enclosed: Certified) -> Certified:
    """Return the enclosures of a planar motion with its attitude if that is asked for and can be proven."""
    if "orientation" not in problem.outputs or motion.window is None:
        return enclosed
    goes_round = motion.window.arcs[0].is_whole_loop
    with suppress(CertifiedUnavailableError, MissingMomentError):
        return with_proven_attitude(problem, *proven_start(problem), enclosed, goes_round=goes_round)
    return enclosed


def with_samples(problem: Problem, motion: Motion, enclosed: Certified, samples: FloatArray) -> Motion:
    """Return ``motion`` with ``samples``, and how far these are from the truth, or from its integrals."""
    error = largest(
        (
            _error(ball, double)
            for state, row in zip(enclosed.states, samples.tolist(), strict=True)
            for ball, double in zip(state[: len(COLUMNS)], row, strict=True)
        ),
    )
    proven = replace(motion, samples=samples.reshape(-1, len(COLUMNS)), error=error, samples_kind="theorem")
    if enclosed.method == "steps":
        return proven
    return with_samples_raised(problem.body, problem.potential, proven)


def errors_of_enclosed(
    enclosures: Mapping[str, FloatArray], errors: Mapping[str, GroupError]
) -> dict[str, GroupError]:
    """Return the errors of the samples of a proven attitude, which are the first parts of its enclosures."""
    found = dict[str, GroupError]()
    for group, names in {"quaternion": QUATERNION, "psi1": ("psi1",), "psi3": ("psi3",)}.items():
        if group not in errors or not all(name in enclosures for name in names):
            continue
        # What a double leaves out, and half a unit of the decimal it is written as.
        bounds = [
            sum((np.abs(rows) for name, rows in enclosures.items() if name.startswith(f"{own}.")), 0.0)
            + 0.5 * np.spacing(np.abs(enclosures[own]))
            for own in names
        ]
        absolute = nextafter(float(np.max(bounds, initial=0.0)), inf)
        found[group] = replace(errors[group], absolute=absolute)
    return found


def columns_of_enclosures(
    enclosed: Certified, motion: Motion, rows: Sequence[Sequence[tuple[list[float], float]]], parts: int
) -> dict[str, FloatArray]:
    """Return the columns of states that are split into ``parts``, and of the times they belong to."""
    return {**_enclosed_columns(enclosed.columns, rows, parts), **_times(enclosed, motion, parts)}


def _enclosed_columns(
    names: tuple[str, ...], rows: Sequence[Sequence[tuple[list[float], float]]], parts: int
) -> dict[str, FloatArray]:
    """Return the further parts and the radii; of the attitude the first parts too, which no motion has."""
    columns: dict[str, FloatArray] = {}
    for index, internal in enumerate(names):
        name = internal.removeprefix("local_")
        if index >= len(COLUMNS):
            columns[name] = np.array([row[index][0][0] for row in rows])
        for part in range(1, parts):
            columns[f"{name}.{part}"] = np.array([row[index][0][part] for row in rows])
        columns[f"{name}.{RADIUS}"] = np.array([row[index][1] for row in rows])
    return columns


def _times(enclosed: Certified, motion: Motion, parts: int) -> dict[str, FloatArray]:
    """Return what the doubles leave of the exact times, as columns that go with ``t``; none if nothing."""
    with ctx.workprec(JOIN_BITS):
        left = [at - arb(t) for at, t in zip(enclosed.times, motion.times.tolist(), strict=True)]
    if all(ball == 0 for ball in left):
        return {}
    rows = [split(ball, parts - 1) for ball in left]
    columns = {f"t.{part}": np.array([doubles[part - 1] for doubles, _ in rows]) for part in range(1, parts)}
    return {**columns, f"t.{RADIUS}": np.array([radius for _, radius in rows])}


def _error(ball: arb, double: float) -> float:
    """Return a bound of the distance of the decimal that ``double`` is written as from the true number."""
    return nextafter(float(abs(ball - arb(double)).abs_upper()) + 0.5 * ulp(double), inf)
