"""Work against precision: 1000 samples over 10 periods of an elliptic motion, as numbers and as a picture."""

import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from service.dynamics.problem import TimePeriods
from service.dynamics.sampling import exact_instants
from service.storage.codecs.arrays import decode_arrays
from tests.benchmarks.costs import PROBLEMS
from tests.benchmarks.measuring import Effort, Result, Table, clock, in_words, median
from tests.benchmarks.motions import SAMPLES, FloatArray, Measured, elliptic, taylor_of_elliptic
from workers.calibration.reference import samples_of
from workers.computation.compute import solve_document
from workers.solvers.compiled.batch import TOLERANCES

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)
TOLS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16)
LEAST = "2e-15"
"""A tolerance that doubles do not keep."""
PERIODS = 10
COMPILED, JOB, SCIPY, HEYOKA = "compiled solver", "whole job", "DOP853", "heyoka"
Curves = dict[str, list[Result]]


def curves(effort: Effort) -> Curves:
    """Return a point for every tier and every tolerance of the rivals, by way."""
    motion = elliptic()
    grid, state = motion.grid(0, PERIODS), motion.state()
    few = 3 if effort.is_quick else 1
    found: Curves = {COMPILED: [], JOB: [], SCIPY: [], HEYOKA: []}
    for tier in TOLERANCES:
        found[COMPILED].append(
            _point(motion, grid, tier, lambda: motion.solved(tier).sample(grid), effort.repeats(25))  # noqa: B023
        )
        found[JOB].append(_by_job(motion, tier, {"tier": tier}, effort.repeats(10)))
    found[JOB].append(_by_job(motion, LEAST, {"tolerance": LEAST}, effort.repeats(10)))
    for rtol in RTOLS[::few]:
        by_scipy = lambda: motion.by_scipy(state, grid, rtol)  # noqa: B023, E731
        found[SCIPY].append(_point(motion, grid, f"{rtol:.0e}", by_scipy, 1))
    for tol in TOLS[::few]:
        found[HEYOKA].append(_by_heyoka(motion, state, grid, tol, effort.repeats(5)))
    return found


def table(found: Curves) -> Table:
    """Return the points as a table."""
    rows = tuple(
        (way, point.name, in_words(point.seconds), f"{point.error:.1e}")
        for way, points in found.items()
        for point in points
    )
    remark = (
        "A = 2C, 1000 samples over 10 periods. Integrators pay for every period and lose digits with time; "
        "the tiers do neither (targets 2 and 3). A whole job computes the stored series as well; "
        f"for {LEAST} its samples are rounded from enclosures."
    )
    return Table("Work against precision", remark, ("way", "tier or tolerance", "time", "error"), rows)


def draw(found: Curves, path: Path) -> None:
    """Draw error against time into a PNG."""
    mpl.use("Agg")
    figure, axes = plt.subplots(figsize=(8, 5), layout="constrained")
    for (way, points), marker in zip(found.items(), "osDv", strict=True):
        ordered = sorted(points, key=lambda point: point.error)
        errors, seconds = [p.error for p in ordered], [p.seconds for p in ordered]
        line = "--" if way in (COMPILED, JOB) else "-"
        axes.loglog(errors, seconds, line, marker=marker, label=way)
        if way in (COMPILED, JOB):
            for point in points:
                axes.annotate(
                    point.name, (point.error, point.seconds), (4, 5), textcoords="offset points", fontsize=8
                )
    axes.margins(x=0.1)
    axes.invert_xaxis()
    axes.set_xlabel("largest error of the six variables")
    axes.set_ylabel("seconds for 1000 samples over 10 periods")
    axes.set_title("Work against precision, A = 2C, V = −γ₁ + 1/(20 γ₃²)")
    axes.grid(visible=True, which="major", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _point(
    motion: Measured, grid: FloatArray, name: str, action: Callable[[], FloatArray], repeats: int
) -> Result:
    return Result(name, median(action, repeats), motion.error(grid, action()))


def _by_job(motion: Measured, name: str, accuracy: dict[str, str], repeats: int) -> Result:
    time_ = {"periods": PERIODS, "samples": SAMPLES}
    document = json.dumps({**PROBLEMS["A = 2C"], "time": time_, "accuracy": accuracy})
    seconds = median(lambda: solve_document(document), repeats)
    columns = decode_arrays(solve_document(document).samples)
    turns = exact_instants(TimePeriods(Fraction(PERIODS), SAMPLES))
    return Result(name, seconds, motion.error_after(turns, samples_of(columns)[0]))


def _by_heyoka(motion: Measured, state: FloatArray, grid: FloatArray, tol: float, repeats: int) -> Result:
    integrator = taylor_of_elliptic(state, tol)
    taken = []
    for _ in range(repeats):
        integrator.time, integrator.state[:] = 0.0, state
        began = clock()
        samples = np.asarray(integrator.propagate_grid(grid)[-1])
        taken.append(clock() - began)
    return Result(f"{tol:.0e}", float(np.median(taken)), motion.error(grid, samples))
