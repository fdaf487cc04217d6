"""Targets 7 and 8: many problems of one structure, and the second problem of a process."""

import json
import multiprocessing
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial

import numpy as np

from service.sandbox import Sandbox
from service.schemas.sweep.reading import read_sweep
from service.schemas.sweep.sweep import Sweep
from service.storage.codecs.packing import SOLVED, ChunkPoints, decode_arrays
from tests.benchmarks.measuring import Effort, Result, Row, faster, in_turns
from tests.benchmarks.motions import FloatArray
from tests.benchmarks.sweep_service import VARIABLES, integrate, measured, sweep_document
from workers.computation.compute import solve_document
from workers.sweeping.local_pool import LocalPool

WORKERS = (1, 2)
SETS, SAMPLES = 10_000, 200
COMPARED = 40
"""Sets that the pool integrates; the time of the others is taken in proportion."""
SEED = 7
SECONDS = 600.0
"""Limit of a chunk: none is meant to reach it."""
Job = tuple[float, float, FloatArray, FloatArray]
Run = Callable[[], ChunkPoints]


def sweep(effort: Effort) -> list[Row]:
    """Target 7: 10 000 sets of 200 samples as `polhode sweep` computes them, against a pool of solve_ivp."""
    document = sweep_document(SETS, SEED)
    read = read_sweep(document, max_points=SETS)
    with _crews(document, read) as (alone, together):
        found = together()
        seconds = in_turns((alone, together), effort.repeats(5), time.perf_counter)
    grid, places = found.series["t"][0], range(COMPARED)
    values = [tuple(map(float, read.values(place))) for place in places]
    motions = [measured(*numbers) for numbers in values]
    samples = [np.array([found.series[name][place] for name in VARIABLES]).T for place in places]
    jobs = [(a, b, one[0], grid) for (a, b, _), one in zip(values, samples, strict=True)]
    theirs, theirs_seconds = _by_pool(jobs)
    ours_error = max(motion.error(grid, one) for motion, one in zip(motions, samples, strict=True))
    theirs_error = max(motion.error(grid, one) for motion, one in zip(motions, theirs, strict=True))
    same = sum(_has_the_digits(read, place, samples[place]) for place in places)
    solved = found.outcomes.count(SOLVED)
    claimed = f"{solved:,} solved, claimed {np.nanmax(found.numbers['error']):.0e}"
    ways = [
        Result(f"polhode sweep --workers {workers}", took, ours_error, claimed)
        for workers, took in zip(WORKERS, seconds, strict=True)
    ]
    pool_seconds = theirs_seconds * SETS / COMPARED
    rival = Result("two processes, DOP853 1e-10", pool_seconds, theirs_error, f"from {COMPARED} sets")
    what, ratio = f"{SETS:,} sets, {SAMPLES} samples each", "≥ 300× (stretch 2000×), ≤ 1e-9"
    timed = [faster(7, what, 300, 1e-9, way, rival, asked=ratio) for way in reversed(ways)]
    digits, asked = f"{same} of {COMPARED}", "sweep and single job: the very same numbers"
    return [*timed, Row(7, "every digit of a set", asked, digits, same == COMPARED, ways[-1], None)]


@contextmanager
def _crews(document: object, read: Sweep) -> Iterator[tuple[Run, ...]]:
    """Yield what computes the whole sweep, for each of WORKERS; its processes have begun."""
    with ExitStack() as opened:
        runs = []
        for workers in WORKERS:
            sandbox = opened.enter_context(closing(Sandbox(workers, preload=["workers.sweeping.rows"])))
            runs.append(partial(_run, document, read, sandbox, workers))
            runs[-1]()
        yield tuple(runs)


def _run(document: object, read: Sweep, sandbox: Sandbox, workers: int) -> ChunkPoints:
    pool = LocalPool(read, document, sandbox, way="compiled", workers=workers, seconds=SECONDS)
    parts = [part for computed in pool.points(lambda: False) if computed is not None for part in computed[1:]]
    return ChunkPoints(
        [outcome for part in parts for outcome in part.outcomes],
        {name: np.concatenate([part.numbers[name] for part in parts]) for name in read.keep},
        {name: np.concatenate([part.series[name] for part in parts]) for name in read.series_columns},
    )


def _has_the_digits(read: Sweep, place: int, samples: FloatArray) -> bool:
    """Tell whether a point of the sweep has each bit of the job of its own document."""
    outcome = solve_document(json.dumps(read.document(place)))
    columns = decode_arrays(outcome.samples)
    return np.array_equal(samples, np.array([columns[name] for name in VARIABLES]).T)


def _by_pool(jobs: list[Job]) -> tuple[FloatArray, float]:
    with multiprocessing.get_context("fork").Pool(2) as pool:
        pool.map(partial(integrate, 1e-10), jobs[:2])
        began = time.perf_counter()
        found = np.array(pool.map(partial(integrate, 1e-10), jobs, chunksize=5))
        return found, time.perf_counter() - began


FRESH = """
import time
from fractions import Fraction
import numpy as np
from tests.benchmarks.motions import DOUBLE, NU_1, Measured
from tests.support.planar import formula
motions = [Measured(a, DOUBLE, formula(f"-{a}*g1 + 1/(20*g3^2)", DOUBLE), NU_1) for a in ("3/2", "5/4")]
times = np.linspace(0.0, 20.0, 1000)
for motion in motions:
    began = time.perf_counter()
    samples = motion.solved("standard").sample(times)
    print(time.perf_counter() - began, motion.error(times, samples))
"""


def known_structure(_: Effort) -> list[Row]:
    """Target 8: the first and the second problem of a fresh process."""
    answer = subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, check=True)
    rival, ours = (
        Result(name, float(seconds), float(error))
        for name, (seconds, error) in zip(
            ("first", "second"), (line.split() for line in answer.stdout.splitlines()), strict=True
        )
    )
    what = "the second problem of a structure in a fresh process"
    return [faster(8, what, 5, 1e-10, ours, rival, asked="starts ≥ 5× faster than the first")]
