r"""The residuals of a run in the six equations, bounded on the whole of every step, by compiled code.

The theorem, the points and the ellipse are those of :mod:`service.dynamics.defect`; what is not settled here,
or breaks a bound, is left to it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from service.dynamics.defect.stretches import ELLIPSE_RHO
from workers.solvers.compiled.blocks import two_sum
from workers.solvers.compiled.evaluation.interpreter import new_registers
from workers.solvers.compiled.general.nodes import (
    HALVES,
    PLACES,
    TAILS,
    put_distances,
    put_gains,
    put_part_states,
    put_series,
    put_whole_states,
    whole_disc,
)
from workers.solvers.compiled.general.series import STATE
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import (
    ROW,
    first_row,
    new_rows,
    number_at,
    place_of,
    put,
    put_number,
    take,
)
from workers.solvers.compiled.records import Equations
from workers.solvers.compiled.shown.states import WIDTH, evaluate, largest_rates
from workers.solvers.compiled.shown.stretches import DEEPEST, HIGHEST_DEGREE, PARTS, are_explained, disc_of

FloatArray = NDArray[np.float64]


@kernel
def _level_for(bounds: FloatArray, share: float) -> int:
    """Return the number of points that leaves out no more than ``share`` in a unit of time; -1 for none."""
    for level in range(len(TAILS)):
        is_settled = True
        for a in range(STATE):
            is_settled = is_settled and TAILS[level] * bounds[a] <= share
        if is_settled:
            return level
    return -1


@kernel
def hold(
    equations: Equations,
    breaks: FloatArray,
    coefficients: FloatArray,
    degrees: int,
    goal: float,
    allowed: float,
    compares: bool,
    claim: float,
    reference: FloatArray,
    slack: float,
) -> tuple[bool, float, float]:
    """Say whether a run from 0 on keeps all bounds; return the bound of |D| and the largest drift too.

    Shapes are (pieces + 1,) and (pieces, at least ``degrees``, LANES). On no stretch may D grow by more than
    ``allowed``. If ``compares``, D may nowhere be beyond twice the ``claim``, and an error ``claim`` explains
    what the integrals do about the ``reference``; their drift is that at the nodes. ``goal`` is what
    interpolation may leave out in all.
    """
    code = equations.gradient.code
    registers, discs = new_registers(code, 1, WIDTH), new_registers(code, 2, 1)
    states, rates, integrals = np.empty((STATE, WIDTH)), np.empty((STATE, WIDTH)), np.empty((3, WIDTH))
    centres, radii, bounds = np.empty(STATE), np.empty(STATE), np.empty(STATE)
    T, waiting = np.empty((HIGHEST_DEGREE + 1, 2)), np.empty((PARTS * DEEPEST + 1, 2))
    gained, lost, first, missing = np.zeros(STATE), np.zeros(STATE), np.empty(STATE), np.zeros(STATE)
    kept = new_rows(2 * WIDTH + 10 * PLACES + 2)
    at_nodes = first_row(kept)
    slopes_at = at_nodes + ROW * WIDTH
    few = slopes_at + ROW * WIDTH
    even = few + 2 * ROW
    odd, integral = even + ROW * PLACES, even + 2 * ROW * PLACES
    own, room = even + 4 * ROW * PLACES, even + 6 * ROW * PLACES
    if degrees > HIGHEST_DEGREE + 1:
        return False, math.nan, math.nan
    rows = place_of(coefficients)
    share = goal / abs(breaks[-1])
    defect, drift, is_first = 0.0, 0.0, True
    for n in range(len(breaks) - 1):
        series = rows + ROW * coefficients.shape[1] * n
        waiting[0, 0], waiting[0, 1] = 0.0, 1.0
        left = 1
        while left > 0:
            left -= 1
            middle, half = waiting[left, 0], waiting[left, 1]
            if half == 1.0:
                whole_disc(series, degrees, few, centres, radii)
            else:
                disc_of(coefficients[n, :degrees], middle, half, ELLIPSE_RHO, centres, radii, T)
            largest_rates(equations, discs, centres, radii, bounds)
            level = _level_for(bounds, share)
            if level < 0:
                if half < 0.5 * PARTS ** (1.0 - DEEPEST):
                    return False, math.nan, math.nan
                for k in range(PARTS):
                    waiting[left + k, 0] = middle + (PARTS - 1.0 - 2.0 * k) * half / PARTS
                    waiting[left + k, 1] = half / PARTS
                left += PARTS
                continue
            if half != 1.0:
                # What is not a whole piece has no series of its own: its points must resolve it.
                level = len(TAILS) - 1
            count = 2 * HALVES[level] + 1
            if half == 1.0:
                put_whole_states(series, degrees, level, at_nodes, room)
            else:
                put_part_states(series, degrees, middle, half, level, at_nodes)
            for m in range(count):
                for a in range(STATE):
                    states[a, m] = number_at(at_nodes, m, a)
            evaluate(equations, registers, states, rates, integrals, count)
            if compares:
                is_good, far = are_explained(
                    equations, discs, states, integrals, count, claim, reference, slack
                )
                if not is_good:
                    return False, math.nan, math.nan
                drift = max(drift, far)
            for m in range(count):
                for a in range(STATE):
                    put_number(slopes_at, m, a, rates[a, m])
            time = 0.5 * (breaks[n + 1] - breaks[n]) * half
            begin = at_nodes + ROW * (count - 1)
            mine, owned = series, degrees
            if half != 1.0:
                put_series(at_nodes, level, room, even, odd)
                for k in range(count):
                    put(own, k, take(even if k % 2 == 0 else odd, k // 2))
                mine, owned = own, count
            put_series(slopes_at, level, room, even, odd)
            put_gains(even, odd, level, time, integral, few)
            put_distances(mine, owned, integral, count + 1, begin, few)
            for a in range(STATE):
                step, within, started = number_at(few, 0, a), number_at(few, 1, a), number_at(begin, 0, a)
                tail = 2.0 * abs(time) * TAILS[level] * bounds[a]
                if not within + tail <= allowed:
                    return False, math.nan, math.nan
                if is_first:
                    first[a] = started
                # D at the beginning of the stretch.
                before = (started - first[a]) - gained[a] - lost[a]
                size = abs(before) + within + tail + missing[a]
                if not size < math.inf:
                    return False, math.nan, math.nan
                defect = max(defect, size)
                missing[a] += tail
                gained[a], rest = two_sum(gained[a], step)
                lost[a] += rest
            is_first = False
    # Up to here the rows have an owner.
    kept[0, 0] = 0.0
    return not compares or defect <= 2.0 * claim, defect, drift
