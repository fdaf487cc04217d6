"""Computes motions sampled from proven enclosures: the certified tier, and motions that fall back on it."""

from dataclasses import replace
from math import inf, nextafter, ulp

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.bounds import is_within, largest
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import COLUMNS, Motion
from service.dynamics.problem import Accuracy, PlanarMotion, Problem, TimePeriods
from service.dynamics.sampling import exact_instants
from service.dynamics.solution.ball_columns import JOIN_BITS, RADIUS, parts_for, split
from service.dynamics.solution.dense_output import Period
from workers.solvers.certified.certify import Certified
from workers.solvers.certified.errors import CertifiedUnavailableError
from workers.solvers.choose import choose_enclosures, enclose
from workers.solvers.errors import AccuracyNotMetError, is_known, require_period_known
from workers.solvers.evidence import with_samples_raised

FloatArray = NDArray[np.float64]

CHECKED_TOLERANCE = 1e-9
"""Tolerance of the function of time that is stored beside the enclosures, where a cross-check wants it."""


def beside_enclosures(problem: Problem) -> Accuracy:
    """Return the accuracy of the function of time between the enclosures.

    Its error is reported separately and never blocks the enclosures; only a cross-check
    needs it to be small.
    """
    return Accuracy(CHECKED_TOLERANCE if problem.method == "both" else float("inf"), "certified")


def certified_samples(problem: Problem, motion: Motion) -> tuple[Motion, Certified, dict[str, FloatArray]]:
    """Return ``motion`` with proven samples, the enclosures, and the columns that hold them.

    The columns hold the times too: the values belong to the exact times, of which the motion has doubles.

    Raises
    ------
    CertifiedUnavailableError
        There is no enclosure of this kind of motion.
    """
    if not isinstance(problem.motion, PlanarMotion):
        raise DynamicsError("the certified tier is for planar motions", pointer="/accuracy/tier")
    found = _certify(problem, motion)
    parts = parts_for(problem.accuracy.bits)
    rows = [[split(ball, parts) for ball in state] for state in found.states]
    first = np.array([[doubles[0] for doubles, _ in row] for row in rows])
    proven = replace(_with_samples(problem, motion, found, first), conventions=found.conventions)
    return proven, found, {**_columns(rows, parts), **_times(found, motion, parts)}


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
        found = _certify(problem, motion)
    except CertifiedUnavailableError:
        require_period_known(motion.dense.period, problem.tolerance)
        raise AccuracyNotMetError(motion.error, problem.tolerance) from None
    if not is_known(motion.dense.period, problem.tolerance):
        # The function of time is one of wrong times: no two values of a variable differ by more than this.
        wrong = 2.0 * float(np.abs(motion.dense.coefficients).sum(axis=1).max(initial=0.0))
        dense = replace(motion.dense, period=_rounded(found.period), error=motion.dense.error + wrong)
        motion = replace(motion, dense=dense)
        require_period_known(dense.period, problem.tolerance)
    rounded = np.array([[float(ball.mid()) for ball in state] for state in found.states])
    proven = _with_samples(problem, motion, found, rounded)
    if not is_within(proven.error, problem.tolerance):
        raise AccuracyNotMetError(min(motion.error, proven.error), problem.tolerance)
    return replace(proven, enclosed_by=found.method)


def _certify(problem: Problem, motion: Motion) -> Certified:
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


def _rounded(period: arb) -> Period:
    """Return a ball as the sum of two doubles and a bound."""
    hi = float(period)
    lo = float(period - arb(hi))
    return Period(hi, lo, float(abs(period - arb(hi) - arb(lo)).abs_upper()))


def _with_samples(problem: Problem, motion: Motion, found: Certified, samples: FloatArray) -> Motion:
    """Return ``motion`` with ``samples``, and how far these are from the truth, or from its integrals."""
    error = largest(
        (
            _error(ball, double)
            for state, row in zip(found.states, samples.tolist(), strict=True)
            for ball, double in zip(state, row, strict=True)
        ),
    )
    proven = replace(motion, samples=samples.reshape(-1, len(COLUMNS)), error=error)
    return with_samples_raised(problem.body, problem.potential, proven)


def _columns(rows: list[list[tuple[list[float], float]]], parts: int) -> dict[str, FloatArray]:
    columns: dict[str, FloatArray] = {}
    for index, name in enumerate(COLUMNS):
        for part in range(1, parts):
            columns[f"{name}.{part}"] = np.array([row[index][0][part] for row in rows])
        columns[f"{name}.{RADIUS}"] = np.array([row[index][1] for row in rows])
    return columns


def _times(found: Certified, motion: Motion, parts: int) -> dict[str, FloatArray]:
    """Return what the doubles leave of the exact times, as columns that go with ``t``; none if nothing."""
    with ctx.workprec(JOIN_BITS):
        left = [at - arb(t) for at, t in zip(found.times, motion.times.tolist(), strict=True)]
    if all(ball == 0 for ball in left):
        return {}
    rows = [split(ball, parts - 1) for ball in left]
    columns = {f"t.{part}": np.array([doubles[part - 1] for doubles, _ in rows]) for part in range(1, parts)}
    return {**columns, f"t.{RADIUS}": np.array([radius for _, radius in rows])}


def _error(ball: arb, double: float) -> float:
    """Return a bound of the distance of the decimal that ``double`` is written as from the true number."""
    return nextafter(float(abs(ball - arb(double)).abs_upper()) + 0.5 * ulp(double), inf)
