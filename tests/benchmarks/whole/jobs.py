"""Whole jobs, from the document to the outcome, beside their bare kernel and beside bare integrations."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import heyoka as hy
import numpy as np

from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.problem import PlanarMotion, TimePeriods
from service.dynamics.sampling import exact_instants
from service.jobs.records import Solved
from service.storage.codecs.packing import decode_arrays
from service.verdicts.examination import examine_problems
from tests.benchmarks.cached_examinations import forgetful
from tests.benchmarks.measuring import Effort, Result, Table, clock, in_words, median
from tests.benchmarks.motions import DOUBLE, LIBRATION, NU_1, FloatArray, Measured
from tests.support.examinations import examination_of
from tests.support.heyoka_integrator import HeyokaAlgebra
from tests.support.planar import body, formula
from workers.calibration.measurement import samples_of
from workers.computation.compute import solve_document
from workers.solvers.compiled.solve import TOLERANCES, Tier

PERIODS = 10
GENERAL = body("17/10", 1, "13/10")
TOLS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16)
RTOLS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 3e-14)
KERNELS, INTEGRATIONS, FASTER = 25, 3, 3
"""A job may cost so many kernels and so many bare integrations, and a kernel is to be so much faster."""


@dataclass(frozen=True)
class Whole:
    """A problem as a document, and as the motion that the rivals integrate."""

    motion: Measured
    document: Mapping[str, object]


def problems() -> tuple[Whole, ...]:
    """Return a motion in elliptic functions and one of a general ratio of moments."""
    alpha = Fraction(4, 5)
    return (
        Whole(
            Measured("A = 2C", DOUBLE, formula("-g1 + 1/(20*g3^2)", DOUBLE), NU_1),
            {
                "body": {"A": 2, "B": "3/2", "C": 1},
                "potential": {"type": "expression", "expression": "-g1 + 1/(20*g3^2)"},
                "motion": {"type": "planar", "nu": 1},
            },
        ),
        Whole(
            Measured("α = 1.7", GENERAL, formula(LIBRATION, GENERAL), PlanarMotion(alpha)),
            {
                "body": {"A": "17/10", "B": "13/10", "C": 1},
                "potential": {"type": "expression", "expression": LIBRATION},
                "motion": {"type": "planar", "lambda": str(alpha)},
            },
        ),
    )


def jobs(effort: Effort) -> Table:
    """Return whole jobs at every tier, each beside the cheapest integration of no larger error."""
    rows: list[tuple[str, ...]] = []
    for problem in problems()[: 1 if effort.is_quick else None]:
        grid, state = problem.motion.grid(0, PERIODS), problem.motion.state()
        integrations = {
            "heyoka": list(_by_heyoka(problem.motion, state, grid, effort)),
            "DOP853": list(_by_scipy(problem.motion, state, grid, effort)),
        }
        for tier in TOLERANCES:
            kernel = _kernel(problem.motion, tier, grid, effort)
            job = whole_job(problem, tier, effort)
            rows.append(_row(problem.motion.name, kernel, job, integrations))
    remark = (
        f"{PERIODS} periods, 1000 samples; a job is examined already, as a worker gets it, and is no "
        "repetition of the last one. The kernel is the compiled solver with its samples. heyoka and DOP853 "
        "are bare integrations of the same samples from the exact state, each at the loosest tolerance whose "
        "error is not larger than the job's, or at the one that comes closest; compiling heyoka is not "
        f"counted. Asked: at most {KERNELS} kernels and {INTEGRATIONS} integrations by heyoka a job, a "
        f"kernel {FASTER} times faster than heyoka."
    )
    heads = (
        "motion", "tier", "job", "error", "kernel", "its error", "job / kernel",
        "heyoka", "job / heyoka", "heyoka / kernel", "DOP853", "DOP853 / job",
    )  # fmt: skip
    return Table("Whole jobs", remark, heads, tuple(rows))


def whole_job(problem: Whole, tier: str, effort: Effort) -> Result:
    """Return what a job takes in a process that has its windows from the store, and its error."""
    time_ = {"periods": PERIODS, "samples": 1000}
    solve = job_of({**problem.document, "time": time_, "accuracy": {"tier": tier}})
    columns = decode_arrays(solve().samples)
    turns = exact_instants(TimePeriods(Fraction(PERIODS), 1000))
    error = problem.motion.error_after(turns, samples_of(columns)[0])
    return Result(tier, median(solve, effort.repeats(15)), error)


def job_of(document: Mapping[str, object]) -> Callable[[], Solved]:
    """Return what a worker does with a problem: its windows come with it, and nothing is known before."""
    asked = examination_of([document])
    found = json.loads(examine_problems(json.dumps(asked)))["found"]
    text, windows = json.dumps(document), found[asked["problems"][0]["windows"]]

    def solve() -> Solved:
        outcome = solve_document(text, windows)
        assert isinstance(outcome, Solved), outcome
        return outcome

    return forgetful(solve)


def _row(
    name: str, kernel: Result | None, job: Result, integrations: Mapping[str, Sequence[Result]]
) -> tuple[str, ...]:
    heyoka, scipy = (_of_no_larger_error(found, job.error) for found in integrations.values())
    seconds, error, kernels, faster = _beside_kernel(kernel, job, heyoka)
    return (
        name,
        job.name,
        in_words(job.seconds),
        f"{job.error:.1e}",
        seconds,
        error,
        kernels,
        str(heyoka),
        _judged(job.seconds / heyoka.seconds, most=INTEGRATIONS),
        faster,
        str(scipy),
        f"{scipy.seconds / job.seconds:.3g}×",
    )


def _beside_kernel(kernel: Result | None, job: Result, heyoka: Result) -> tuple[str, str, str, str]:
    """Return the kernel's time and error, the job's ratio to it, and heyoka's."""
    if kernel is None:
        return "not by it alone", "", "", ""
    return (
        in_words(kernel.seconds),
        f"{kernel.error:.1e}",
        _judged(job.seconds / kernel.seconds, most=KERNELS),
        _judged(heyoka.seconds / kernel.seconds, least=FASTER),
    )


def _judged(ratio: float, *, most: float = np.inf, least: float = 0.0) -> str:
    text = f"{ratio:.3g}×"
    return text if least <= ratio <= most else f"**{text}, missed**"


def _of_no_larger_error(found: Sequence[Result], error: float) -> Result:
    """Return the first, thus the cheapest, whose error is not larger; else the one with the least."""
    return next((each for each in found if each.error <= error), min(found, key=lambda each: each.error))


def _kernel(motion: Measured, tier: Tier, grid: FloatArray, effort: Effort) -> Result | None:
    """Return the compiled solver's time and error; None where it does not keep the tier by itself."""
    found = motion.solved_if_kept(tier)
    if found is None:
        return None
    seconds = median(lambda: motion.solved(tier).sample(grid), effort.repeats(25))
    return Result(tier, seconds, motion.error(grid, found.sample(grid)))


def _by_heyoka(motion: Measured, state: FloatArray, grid: FloatArray, effort: Effort) -> Iterator[Result]:
    g = hy.make_vars("g1", "g2", "g3")
    V = motion.potential.tape.evaluate(HeyokaAlgebra(nearest_double), g)
    gradient = hy.diff_tensors([V], list(g)).gradient
    for tol in TOLS:
        integrator = hy.taylor_adaptive(_equations(motion, g, gradient), state.tolist(), tol=tol)
        taken = []
        for _ in range(effort.repeats(5)):
            integrator.time, integrator.state[:] = 0.0, state
            began = clock()
            samples = np.asarray(integrator.propagate_grid(grid)[-1])
            taken.append(clock() - began)
        yield Result(f"{tol:.0e}", float(np.median(taken)), motion.error(grid, samples))


def _equations(
    motion: Measured, g: Sequence[object], gradient: Sequence[object]
) -> list[tuple[object, object]]:
    A, B, C = float(motion.body.A), float(motion.body.B or 1), float(motion.body.C)
    (p, q, r), (g1, g2, g3), (V_1, V_2, V_3) = hy.make_vars("p", "q", "r"), g, gradient
    return [
        (p, ((B - C) * q * r + g2 * V_3 - g3 * V_2) / A),
        (q, ((C - A) * p * r + g3 * V_1 - g1 * V_3) / B),
        (r, ((A - B) * p * q + g1 * V_2 - g2 * V_1) / C),
        (g1, r * g2 - q * g3),
        (g2, p * g3 - r * g1),
        (g3, q * g1 - p * g2),
    ]


def _by_scipy(motion: Measured, state: FloatArray, grid: FloatArray, effort: Effort) -> Iterator[Result]:
    for rtol in RTOLS[-1:] if effort.is_quick else RTOLS:
        began = clock()
        samples = motion.by_scipy(state, grid, rtol)
        yield Result(f"{rtol:.0e}", clock() - began, motion.error(grid, samples))
