"""Runs of motions from any state, their differences, and what they leave of the equations, at once.

Motions of one formula go side by side, each with its own numbers: none has a digit of another, nor has it
other digits alone. What is decided here needs no other code; what is not is left to
:mod:`workers.solvers.integration`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.general.growth import grown
from workers.solvers.compiled.general.sampling import compare, new_values_at, values_at, widen
from workers.solvers.compiled.general.steps import (
    ARRIVED,
    COUNT,
    FAILED,
    STATE,
    TIME_SPACING,
    new_pieces,
    seen,
    take_steps,
)
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import LANES
from workers.solvers.compiled.records import Asked, Equations, Models
from workers.solvers.compiled.residual.residual import hold

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
VERIFIED, INACCURATE, OPEN, COLLIDED = range(4)
"""All bounds are kept; they are, but the error is more than is allowed; something is not decided here; all
bounds are kept up to a singularity of the potential."""
RUNS = 4
"""Runs of a motion. Two may have lost the same by chance, four hardly have: see :func:`_run_all`."""
NUMBERS = 7
"""Numbers of a motion: error, difference, energy, its error, defect, drift, and the error's part by
growth."""
LAST_STEPS = 8
"""Last steps, by which the steps towards a singularity are seen to shrink."""
TOLERANCE_SHARES = (0.0, 1.0, 0.5, 0.25)
"""The local tolerances of the runs, as shares of the way from the fine to the coarse one, in logarithms."""
MOST_STEPS = 2**14
"""Longer runs are left to code that keeps one at a time: those of all lanes would take some hundred MB."""


@kernel
def _joined(
    back: FloatArray, before: FloatArray, forth: FloatArray, after: FloatArray, length: int
) -> tuple[FloatArray, FloatArray]:
    """Return runs from t = 0 both ways as one function of time."""
    m, n = len(back) - 1, len(forth) - 1
    if m == 0:
        return forth, after[:n]
    breaks, series = np.empty(m + n + 1), np.empty((m + n, length, LANES))
    for k in range(m + 1):
        breaks[k] = back[m - k]
    for k in range(1, n + 1):
        breaks[m + k] = forth[k]
    for k in range(m):
        sign = 1.0
        for j in range(length):
            for a in range(LANES):
                series[k, j, a] = sign * before[m - 1 - k, j, a]
            sign = -sign
    for k in range(n):
        for j in range(length):
            for a in range(LANES):
                series[m + k, j, a] = after[k, j, a]
    return breaks, series


@kernel
def _holds(
    equations: Equations,
    breaks: FloatArray,
    series: FloatArray,
    length: int,
    largest: float,
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
    allowed = defects * largest
    goal = min(goal * abs(breaks[-1]), 0.1 * allowed * len(series))
    return hold(equations, breaks, series, length, goal, allowed, compares, claim, reference, slack, 0.0)


@kernel
def lanes_of(asked: Asked) -> int:
    """Return how many lanes a motion has: those of its runs, on one side of t = 0 or on both."""
    return 2 * RUNS if asked.first < 0.0 < asked.last else RUNS


@kernel
def _seen(pieces: FloatArray, first: int, second: int, counts: IntArray) -> tuple[int, float]:
    """Return how many coefficients of two runs doubles can see, and the largest."""
    length, largest = seen(pieces[first, : counts[first]])
    if second != first:
        other, size = seen(pieces[second, : counts[second]])
        length, largest = max(length, other), max(largest, size)
    return length, largest


def beyond_first_order(error: float, size: float) -> float:
    """Return what a motion may differ by that differs by ``error`` to first order; ``size`` is its own.

    A motion that passes an unstable axis at a distance u, and another at u (1 - x), leave it as much apart in
    time as log(1 - x) says, of which x is the first order; beyond x = 1 nothing is known.
    """
    return error / (1.0 - error / size) if error < size else math.inf


_beyond_first_order = kernel(beyond_first_order)
"""The same for kernels: where none is compiled, the other one is called."""


def time_left(breaks: FloatArray) -> float:
    """Return how far the singularity is beyond the end of a run: its steps shrink in proportion to that."""
    last = len(breaks) - 1
    step, many = float(breaks[last] - breaks[last - 1]), min(LAST_STEPS, last - 1)
    if many < 1:
        return step
    before = float(breaks[last - many] - breaks[last - many - 1])
    ratio = math.pow(abs(step / before), 1.0 / many)
    return step * ratio / (1.0 - ratio) if ratio < 0.9 else 10.0 * step


_time_left = kernel(time_left)


@kernel
def _speed(series: FloatArray, time: float) -> float:
    """Return how fast the fastest variable goes on the whole in a step with this series."""
    most = 0.0
    for a in range(STATE):
        gone = 0.0
        for k in range(1, COUNT, 2):
            gone += series[k, a]
        most = max(most, abs(gone))
    return 2.0 * most / abs(time)


@kernel
def _collision(
    equations: Equations,
    lanes: IntArray,
    statuses: IntArray,
    steps: IntArray,
    all_breaks: FloatArray,
    pieces: FloatArray,
    sizes: FloatArray,
    apart: FloatArray,
    asked: Asked,
    found: FloatArray,
) -> int:
    """Say whether finer runs that do not arrive keep the equations up to a singularity.

    Fill in the first time of one, its error, and the sizes of the gradient that tell it.
    """
    status = OPEN
    for side in range(2):
        lane, count = lanes[side], steps[side]
        if statuses[lane] == ARRIVED or (asked.first if side == 0 else asked.last) == 0.0:
            continue
        if statuses[lane] != FAILED or not sizes[lane, 1] > asked.singular * sizes[lane, 0] or count == 0:
            return OPEN
        breaks, own = all_breaks[lane, : count + 1], pieces[lane, :count]
        length, largest = seen(own)
        allowed = asked.fine_defect * largest
        # Next to the singularity it runs into, a run is not asked what is there.
        limit, verified = (1.0 - asked.before_the_end) * abs(breaks[count]), 0
        while verified < count and abs(breaks[verified]) < limit:
            verified += 1
        is_kept, _, _ = hold(
            equations,
            breaks[: verified + 1],
            own[:verified],
            length,
            0.1 * allowed * count,
            allowed,
            False,
            math.inf,
            np.zeros(3),
            0.0,
            0.0,
        )
        if not is_kept:
            return OPEN
        left, gap = _time_left(breaks), 0.0
        time = breaks[count] + left
        for run in range(1, RUNS):
            other = lanes[2 * run + side]
            if statuses[other] != FAILED or steps[2 * run + side] == 0:
                return OPEN
            rival = all_breaks[other, : steps[2 * run + side] + 1]
            gap = max(gap, abs(rival[len(rival) - 1] + _time_left(rival) - time))
        deviations = grown(
            equations, breaks[: verified + 1], own, length, apart, asked.noise, asked.tail, largest
        )
        late = (
            asked.safety
            * deviations[verified]
            / _speed(own[verified - 1], breaks[verified] - breaks[verified - 1])
        )
        if status == OPEN or abs(time) < abs(found[0]):
            found[0], found[2], found[3] = time, sizes[lane, 0], sizes[lane, 1]
            found[1] = asked.safety * gap + abs(left) + late + TIME_SPACING * abs(time)
        status = COLLIDED
    return status


@kernel
def settle(
    models: Models,
    model: int,
    lane: int,
    statuses: IntArray,
    counts: IntArray,
    all_breaks: FloatArray,
    pieces: FloatArray,
    sizes: FloatArray,
    apart: FloatArray,
    check: FloatArray,
    asked: Asked,
    found: FloatArray,
) -> tuple[int, FloatArray, FloatArray, int]:
    """Compare the runs from ``lane`` on, hold them against the equations; see :func:`solve_pairs`.

    ``apart`` says how far the state may be from the one that is meant. Return the breaks, series and degrees
    of the finer run too.
    """
    width = lanes_of(asked)
    lanes, steps = np.empty(2 * RUNS, dtype=np.int64), np.zeros(2 * RUNS, dtype=np.int64)
    equations = Equations(models.program, models.constants[model], models.moments[model])
    has_arrived = True
    for run in range(2 * RUNS):
        # Where one side is empty its runs have no steps, and are said to be in the lanes of the other.
        lanes[run] = lane + (run if width == 2 * RUNS else run // 2)
        if (asked.first if run % 2 == 0 else asked.last) != 0.0:
            steps[run] = counts[lanes[run]]
        has_arrived = has_arrived and statuses[lanes[run]] == ARRIVED
    if not has_arrived:
        status = _collision(equations, lanes, statuses, steps, all_breaks, pieces, sizes, apart, asked, found)
        return status, all_breaks[lane], pieces[lane], 1
    if steps[0] + steps[1] == 0:
        return OPEN, all_breaks[lane], pieces[lane], 1
    length, largest = _seen(pieces, lanes[0], lanes[1], counts)
    breaks, series = _joined(
        all_breaks[lanes[0], : steps[0] + 1],
        pieces[lanes[0]],
        all_breaks[lanes[1], : steps[1] + 1],
        pieces[lanes[1]],
        length,
    )
    none = np.empty(0)
    start = new_values_at(breaks, series, length, np.zeros(1), none)
    values = new_values_at(breaks, series, length, check, none)
    gaps = np.zeros(values.shape)
    other_length, other_largest = 1, 0.0
    for other in range(2, 2 * RUNS, 2):
        back, forth = lanes[other], lanes[other + 1]
        own_length, own_largest = _seen(pieces, back, forth, counts)
        if other == 2:
            other_length, other_largest = own_length, own_largest
        other_breaks, other_series = _joined(
            all_breaks[back, : steps[other] + 1],
            pieces[back],
            all_breaks[forth, : steps[other + 1] + 1],
            pieces[forth],
            own_length,
        )
        widen(values, new_values_at(other_breaks, other_series, own_length, check, none), gaps)
    error, difference, energy, stray, reference = compare(
        equations, start[0], values, gaps, check, asked.safety, asked.rounding
    )
    growth = 0.0
    if error <= asked.tolerance or asked.is_last:
        for run in range(2):
            if steps[run] > 0:
                own = all_breaks[lanes[run], : steps[run] + 1]
                deviations = grown(
                    equations, own, pieces[lanes[run]], length, apart, asked.noise, asked.tail, largest
                )
                growth = max(growth, _beyond_first_order(asked.safety * np.max(deviations), largest))
        error += growth
    is_accurate = error <= asked.tolerance
    if not (is_accurate or asked.is_last):
        return INACCURATE, breaks, series, length
    goal = max(asked.goal * error, asked.finest * max(1.0, largest)) / (asked.last - asked.first)
    defect, drift = 0.0, 0.0
    for run in range(4):
        # A motion that is accurate enough needs no more than this: the other runs only measure how errors
        # grow, and what they leave of the equations makes the difference larger.
        if is_accurate and run >= 2:
            break
        is_fine = run < 2
        is_good, by_defect, by_drift = _holds(
            equations,
            all_breaks[lanes[run], : steps[run] + 1],
            pieces[lanes[run], : steps[run]],
            length if is_fine else other_length,
            largest if is_fine else other_largest,
            asked.fine_defect if is_fine else asked.coarse_defect,
            goal if is_fine else math.inf,
            is_accurate,
            error,
            reference,
            stray,
        )
        if not is_good:
            return OPEN, breaks, series, length
        if is_fine:
            defect, drift = max(defect, by_defect), max(drift, by_drift)
    found[0], found[1], found[2], found[3] = error, difference, energy, stray
    found[4], found[5], found[6] = defect, drift, growth
    return (VERIFIED if is_accurate else INACCURATE), breaks, series, length


@kernel
def _run_all(
    models: Models,
    which: IntArray,
    states: FloatArray,
    others: FloatArray,
    begin: int,
    count: int,
    asked: Asked,
    pieces: FloatArray,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Run some motions; the lanes of each are backward and forward, run by run.

    The first is the fine one. Of a problem that rounded numbers might as well have meant the second has all,
    and runs as coarsely as is asked; the third has its state, and the fourth its constants, by steps between.
    Where the rounding of one is by chance what the first has lost, that of another is not.
    """
    width = lanes_of(asked)
    used = width * count
    starts, ends, tolerances = np.empty((STATE, used)), np.empty(used), np.empty(used)
    constants = np.empty((models.slope_constants.shape[1], used))
    moments = np.empty((STATE, used))
    for n in range(count):
        model = which[begin + n]
        for lane in range(width * n, width * (n + 1)):
            run = (lane - width * n) // (width // RUNS)
            is_back = (lane - width * n) % 2 == 0 if width == 2 * RUNS else asked.first < 0.0
            ends[lane] = asked.first if is_back else asked.last
            tolerances[lane] = asked.fine * math.pow(asked.coarse / asked.fine, TOLERANCE_SHARES[run])
            has_own_start, has_own_model = run in (0, 3), run in (0, 2)
            own_constants, own_moments = models.slope_constants, models.moments
            if not has_own_model:
                own_constants, own_moments = models.other_slope_constants, models.other_moments
            for a in range(STATE):
                starts[a, lane] = states[begin + n, a] if has_own_start else others[begin + n, a]
                moments[a, lane] = own_moments[model, a]
            for k in range(len(constants)):
                constants[k, lane] = own_constants[model, k]
    return take_steps(
        models.slopes,
        models.gradient,
        constants,
        moments,
        models.registers,
        starts,
        ends,
        tolerances,
        min(asked.max_steps, MOST_STEPS),
        math.inf,
        asked.collapsed,
        pieces,
    )


@kernel
def solve_pair(
    models: Models, state: FloatArray, other: FloatArray, check: FloatArray, asked: Asked
) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    """Solve one motion of the first model as :func:`solve_pairs` does.

    Return how that ends, breaks and series of the finer run, and what is found.
    """
    states, others, which = np.empty((1, STATE)), np.empty((1, STATE)), np.zeros(1, dtype=np.int64)
    apart = np.empty(STATE)
    for a in range(STATE):
        states[0, a], others[0, a], apart[a] = state[a], other[a], abs(state[a] - other[a])
    room = new_pieces(lanes_of(asked))
    statuses, counts, all_breaks, pieces, sizes = _run_all(models, which, states, others, 0, 1, asked, room)
    found = np.full(NUMBERS, math.nan)
    status, breaks, series, length = settle(
        models, 0, 0, statuses, counts, all_breaks, pieces, sizes, apart, check, asked, found
    )
    return status, breaks.copy(), series[:, :length, :STATE].copy(), found


@kernel
def solve_pairs(
    models: Models,
    which: IntArray,
    states: FloatArray,
    others: FloatArray,
    check: FloatArray,
    asked: Asked,
    times: FloatArray,
    rests: FloatArray,
    endings: IntArray,
    found: FloatArray,
    samples: FloatArray,
) -> None:
    """Run finely from each of ``states``, less so from ``others``, and hold the runs against the equations.

    ``which`` has the models of the motions. Fill in how each ends; its error, difference, energy, the error
    of that, defect and drift; and where it is held its values at ``times``. The shapes are (n,), (n, 6) and
    (n, rows, LANES) with at least as many rows as times, rounded up to a multiple of 4. An error that is more
    than is allowed is told of the last runs alone: that of others is not held against the equations.
    """
    together = LANES // lanes_of(asked)
    room, apart = new_pieces(LANES), np.empty(STATE)
    for begin in range(0, len(states), together):
        count = min(together, len(states) - begin)
        statuses, counts, all_breaks, pieces, sizes = _run_all(
            models, which, states, others, begin, count, asked, room
        )
        for n in range(count):
            place = begin + n
            for a in range(STATE):
                apart[a] = abs(states[place, a] - others[place, a])
            status, breaks, series, length = settle(
                models,
                which[place],
                n * lanes_of(asked),
                statuses,
                counts,
                all_breaks,
                pieces,
                sizes,
                apart,
                check,
                asked,
                found[place],
            )
            endings[place] = status
            if status == VERIFIED and samples.shape[1] > 0:
                values_at(breaks, series, length, times, rests, samples[place])
