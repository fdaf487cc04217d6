"""Targets 7 and 8: many problems of one structure, and the second problem of a process."""

import multiprocessing
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
from scipy.integrate import solve_ivp

from service.dynamics.problem import PlanarMotion
from tests.benchmarks.measuring import Effort, Result, Row, faster, in_turns
from tests.benchmarks.motions import DOUBLE, FloatArray, Measured
from tests.support.planar import formula
from workers.solvers.spectral.program import make_program, parametric_program
from workers.solvers.spectral.solve import Sweep, solve_many

STRUCTURE = "a*g1 + b/g3^2"
SETS, SAMPLES = 10_000, 200
HALVES = (slice(0, SETS // 2), slice(SETS // 2, SETS))
"""One for each thread: as many as the rival has processes."""
COMPARED = 40
"""Sets that the pool integrates; the time of the others is taken in proportion."""
Job = tuple[float, float, FloatArray, FloatArray]


def sweep(effort: Effort) -> list[Row]:
    """Target 7: 10 000 sets of 200 samples against a pool of two processes with solve_ivp."""
    program, constants = parametric_program(STRUCTURE, ("a", "b"))
    draws = np.random.default_rng(7)
    rows = np.repeat(constants[None, :], SETS, axis=0)
    rows[:, 0], rows[:, 1] = -draws.uniform(0.5, 2.0, SETS), draws.uniform(0.01, 0.04, SETS)
    lambdas = draws.uniform(0.7, 1.4, SETS)
    grid, motion = np.linspace(0.0, 20.0, SAMPLES), PlanarMotion(Fraction(1))
    solve_many(DOUBLE, program, rows[:2], motion, grid, lambdas=lambdas[:2])

    def part(sets: slice) -> Sweep:
        return solve_many(DOUBLE, program, rows[sets], motion, grid, lambdas=lambdas[sets])

    def by_threads() -> list[Sweep]:
        with ThreadPoolExecutor(len(HALVES)) as threads:
            return list(threads.map(part, HALVES))

    found = part(slice(None))
    alone, together = in_turns((lambda: part(slice(None)), by_threads), effort.repeats(5), time.perf_counter)
    decided = np.isfinite(found.errors)
    ours_error, theirs_error, same = 0.0, 0.0, 0
    jobs = [(rows[k, 0], rows[k, 1], found.samples[k, 0], grid) for k in range(COMPARED)]
    theirs, theirs_seconds = _by_pool(jobs)
    for k in range(COMPARED):
        text = f"({Fraction(rows[k, 0])})*g1 + ({Fraction(rows[k, 1])})/g3^2"
        single = Measured(text, DOUBLE, formula(text, DOUBLE), PlanarMotion(Fraction(lambdas[k])))
        ours_error = max(ours_error, single.error(grid, found.samples[k]))
        theirs_error = max(theirs_error, single.error(grid, theirs[k]))
        same += _has_the_digits(single, lambdas[k], grid)
    claimed = f"{decided.sum():,} decided, claimed {found.errors[decided].max():.0e}"
    ours = Result(f"sweep, {len(HALVES)} threads", together, ours_error, claimed)
    single_thread = Result("sweep, one thread", alone, ours_error, claimed)
    seconds = theirs_seconds * SETS / COMPARED
    rival = Result("two processes, DOP853 1e-10", seconds, theirs_error, f"from {COMPARED} sets")
    what, ratio = f"{SETS:,} sets, {SAMPLES} samples each, one process", "≥ 300× (stretch 2000×), ≤ 1e-9"
    timed = [faster(7, what, 300, 1e-9, way, rival, asked=ratio) for way in (ours, single_thread)]
    digits = f"{same} of {COMPARED}"
    asked = "sweep and single problem: the very same numbers"
    return [*timed, Row(7, "every digit of a set", asked, digits, same == COMPARED, ours, None)]


def _has_the_digits(single: Measured, lambda_: float, grid: FloatArray) -> bool:
    """Tell whether a sweep of the potential as it is written gives each bit of the single problem."""
    program, constants = make_program(single.potential.tape)
    plain = PlanarMotion(Fraction(1))
    swept = solve_many(DOUBLE, program, constants[None, :], plain, grid, lambdas=np.array([lambda_]))
    return np.array_equal(swept.samples[0], single.solved("standard").sample(grid))


def _by_pool(jobs: list[Job]) -> tuple[FloatArray, float]:
    with multiprocessing.get_context("fork").Pool(2) as pool:
        pool.map(integrate_one, jobs[:2])
        began = time.perf_counter()
        found = np.array(pool.map(integrate_one, jobs, chunksize=5))
        return found, time.perf_counter() - began


def integrate_one(job: Job) -> FloatArray:
    """Integrate one set of the sweep, its equations written out by hand."""
    a, b, state, grid = job

    def rhs(_: float, y: FloatArray) -> tuple[float, ...]:
        p, q, r, g1, g2, g3 = y.tolist()
        V_3 = -2.0 * b / (g3 * g3 * g3)
        return (
            (0.5 * q * r + g2 * V_3) / 2.0,
            (-p * r + g3 * a - g1 * V_3) / 1.5,
            0.5 * p * q - g2 * a,
            r * g2 - q * g3,
            p * g3 - r * g1,
            q * g1 - p * g2,
        )

    span = (0.0, float(grid[-1]))
    return np.asarray(solve_ivp(rhs, span, state, "DOP853", grid, rtol=1e-10, atol=1e-11).y.T)


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
