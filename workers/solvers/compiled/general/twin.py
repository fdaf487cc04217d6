"""Two runs of a motion from any state, their difference, and what they leave of the equations, at once.

What is decided here needs no other code; what is not is left to :mod:`workers.solvers.integration`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.general.held import hold
from workers.solvers.compiled.general.records import Asked, Formula, Gradient
from workers.solvers.compiled.general.sampling import compare
from workers.solvers.compiled.general.series import STATE
from workers.solvers.compiled.general.steps import ARRIVED, take_steps
from workers.solvers.compiled.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

HELD, INACCURATE, OPEN = range(3)
"""All bounds are kept; they are, but the error is more than is allowed; something is not decided here."""


@kernel
def _side(
    slopes: Gradient, moments: FloatArray, state: FloatArray, end: float, tolerance: float, asked: Asked
) -> tuple[bool, FloatArray, FloatArray]:
    """Return whether a run arrives at ``end``, its breaks and its series; to t = 0 nothing is run."""
    if end == 0.0:
        return True, np.zeros(1), np.zeros((0, 1, STATE))
    status, breaks, series = take_steps(
        slopes.code,
        slopes.constants,
        slopes.gradient,
        moments,
        slopes.registers,
        state,
        end,
        tolerance,
        asked.max_steps,
        math.inf,
        asked.collapsed,
    )
    return status == ARRIVED, breaks, series


@kernel
def _joined(
    back: FloatArray, before: FloatArray, forth: FloatArray, after: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return runs from t = 0 both ways as one function of time."""
    m, n = len(back) - 1, len(forth) - 1
    if m == 0:
        return forth, after
    breaks = np.empty(m + n + 1)
    series = np.zeros((m + n, max(before.shape[1], after.shape[1]), STATE))
    for k in range(m + 1):
        breaks[k] = back[m - k]
    for k in range(1, n + 1):
        breaks[m + k] = forth[k]
    for k in range(m):
        sign = 1.0
        for j in range(before.shape[1]):
            for a in range(STATE):
                series[k, j, a] = sign * before[m - 1 - k, j, a]
            sign = -sign
    for k in range(n):
        for j in range(after.shape[1]):
            for a in range(STATE):
                series[m + k, j, a] = after[k, j, a]
    return breaks, series


@kernel
def _largest(series: FloatArray) -> float:
    size = 0.0
    for x in series.flat:
        size = max(size, abs(x))
    return size


@kernel
def _holds(
    formula: Formula,
    slopes: Gradient,
    moments: FloatArray,
    breaks: FloatArray,
    series: FloatArray,
    defects: float,
    goal: float,
    compares: bool,
    claim: float,
    reference: FloatArray,
    slack: float,
) -> tuple[bool, float, float]:
    """Hold a run against the equations; ``defects`` is what a step may leave, relative to the variables."""
    if len(breaks) == 1:
        return True, 0.0, 0.0
    allowed = defects * _largest(series)
    goal = min(goal * abs(breaks[-1]), 0.1 * allowed * len(series))
    return hold(
        formula,
        slopes,
        moments,
        breaks,
        series,
        goal,
        allowed,
        compares,
        claim,
        reference,
        slack,
    )


@kernel
def solve_twin(
    formula: Formula,
    slopes: Gradient,
    moments: FloatArray,
    other_slopes: Gradient,
    other_moments: FloatArray,
    state: FloatArray,
    other_state: FloatArray,
    check: FloatArray,
    asked: Asked,
) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    """Run finely from ``state``, less so from ``other_state``, and hold both against the equations.

    The second run has the constants of a problem that rounded ones might as well have meant. Return how that
    ends, breaks and series of the finer run, and error, difference, energy, its error, defect and drift.
    """
    found = np.full(6, math.nan)
    nothing = np.zeros(1), np.zeros((0, 1, STATE))
    is_good, back, before = _side(slopes, moments, state, asked.first, asked.fine, asked)
    if not is_good:
        return OPEN, nothing[0], nothing[1], found
    is_good, forth, after = _side(slopes, moments, state, asked.last, asked.fine, asked)
    if not is_good or len(back) + len(forth) == 2:
        return OPEN, nothing[0], nothing[1], found
    is_good, other_back, other_before = _side(
        other_slopes, other_moments, other_state, asked.first, asked.coarse, asked
    )
    if not is_good:
        return OPEN, nothing[0], nothing[1], found
    is_good, other_forth, other_after = _side(
        other_slopes, other_moments, other_state, asked.last, asked.coarse, asked
    )
    if not is_good:
        return OPEN, nothing[0], nothing[1], found
    breaks, series = _joined(back, before, forth, after)
    other_breaks, other_series = _joined(other_back, other_before, other_forth, other_after)
    error, difference, energy, stray, reference = compare(
        formula.code,
        formula.constants,
        formula.result,
        moments,
        breaks,
        series,
        other_breaks,
        other_series,
        check,
        asked.safety,
        asked.rounding,
    )
    is_accurate = error <= asked.tolerance
    goal = max(asked.goal * error, asked.finest * max(1.0, _largest(series))) / (asked.last - asked.first)
    defect, drift = 0.0, 0.0
    for side in range(2):
        run, pieces = (back, before) if side == 0 else (forth, after)
        is_good, by_defect, by_drift = _holds(
            formula,
            slopes,
            moments,
            run,
            pieces,
            asked.fine_defect,
            goal,
            is_accurate,
            error,
            reference,
            stray,
        )
        if not is_good:
            return OPEN, breaks, series, found
        defect, drift = max(defect, by_defect), max(drift, by_drift)
        run, pieces = (other_back, other_before) if side == 0 else (other_forth, other_after)
        is_good, _, _ = _holds(
            formula,
            slopes,
            moments,
            run,
            pieces,
            asked.coarse_defect,
            math.inf,
            False,
            math.inf,
            reference,
            stray,
        )
        if not is_good:
            return OPEN, breaks, series, found
    found[0], found[1], found[2], found[3] = error, difference, energy, stray
    found[4], found[5] = defect, drift
    return (HELD if is_accurate else INACCURATE), breaks, series, found
