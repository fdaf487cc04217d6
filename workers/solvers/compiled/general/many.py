"""Motions from any state side by side: of one formula, each with its own numbers.

None has a digit of another, nor has it other digits alone.
"""

import math

import numpy as np
from numpy.typing import NDArray

from workers.solvers.compiled.general.run_pair import NUMBERS, RUNS, VERIFIED, lanes_of, settle
from workers.solvers.compiled.general.sampling import values_at
from workers.solvers.compiled.general.steps import STATE, new_pieces, take_steps
from workers.solvers.compiled.kernels import kernel
from workers.solvers.compiled.lanes import LANES
from workers.solvers.compiled.records import Asked, Models

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TOLERANCE_SHARES = (0.0, 1.0, 0.5, 0.25)
"""The local tolerances of the runs, as shares of the way from the fine to the coarse one, in logarithms."""
MOST_STEPS = 2**14
"""Longer runs are left to code that keeps one at a time: those of all lanes would take some hundred MB."""


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
            for a in range(STATE):
                starts[a, lane] = states[begin + n, a] if has_own_start else others[begin + n, a]
                moments[a, lane] = (
                    models.moments[model, a] if has_own_model else models.other_moments[model, a]
                )
            for k in range(len(constants)):
                constants[k, lane] = (
                    models.slope_constants[model, k]
                    if has_own_model
                    else models.other_slope_constants[model, k]
                )
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
