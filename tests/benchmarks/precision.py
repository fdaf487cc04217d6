"""Work against precision: 1000 samples over 10 periods of an elliptic motion, as numbers and as a picture.

``python -m tests.benchmarks.precision`` draws the picture again from the table in docs/performance.md.
"""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from service.dynamics.motion import COLUMNS
from service.dynamics.problem import TimePeriods
from service.dynamics.sampling import exact_instants
from service.dynamics.solution.dense_output import RADIUS
from service.jobs.records import Solved
from service.storage.codecs.packing import decode_arrays
from tests.benchmarks.costs import PROBLEMS
from tests.benchmarks.measuring import Effort, Result, Table, clock, in_words, median
from tests.benchmarks.motions import SAMPLES, FloatArray, Measured, elliptic, taylor_of_elliptic
from tests.benchmarks.report import PICTURE, REPORT
from tests.benchmarks.whole.jobs import job_of
from workers.calibration.measurement import samples_of
from workers.solvers.compiled.solve import TOLERANCES

RTOLS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13)
TOLS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16)
LEAST = "2e-15"
"""A tolerance that doubles do not keep."""
PERIODS = 10
COMPILED, JOB, SCIPY, HEYOKA = "compiled solver", "whole job", "DOP853", "heyoka"
Curves = dict[str, list[Result]]
TITLE = "Work against precision"
UNITS = {"µs": 1e-6, "ms": 1e-3, "s": 1.0}


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
        "the tiers do neither (targets 2 and 3). A whole job has its windows from the store, as a worker "
        "gets them, and computes the stored series as well; "
        f"for {LEAST} its samples are rounded from enclosures."
    )
    return Table(TITLE, remark, ("way", "tier or tolerance", "time", "error"), rows)


def draw(found: Curves, path: Path) -> None:
    """Draw error against time into an SVG: kernels beside bare integrations, and whole jobs beside them."""
    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = path.name  # the same picture for the same numbers
    figure, both = plt.subplots(1, 2, figsize=(11, 5), sharex=True, sharey=True, layout="constrained")
    for axes, (way, title) in zip(both, {COMPILED: "kernels", JOB: "whole jobs"}.items(), strict=True):
        for name, marker in ((way, "o"), (SCIPY, "D"), (HEYOKA, "v")):
            ordered = sorted(found[name], key=lambda point: point.error)
            errors, seconds = [p.error for p in ordered], [p.seconds for p in ordered]
            axes.loglog(errors, seconds, "--" if name == way else "-", marker=marker, label=name)
        for point in found[way]:
            place = point.error, point.seconds
            axes.annotate(point.name, place, (4, 5), textcoords="offset points", fontsize=8)
        axes.set_title(f"Work against precision: {title}")
        axes.set_xlabel("largest error of the six variables")
        axes.grid(visible=True, which="major", alpha=0.3)
        axes.legend()
    axes.margins(x=0.1)
    axes.invert_xaxis()  # that of both
    both[0].set_ylabel("seconds for 1000 samples over 10 periods")
    figure.suptitle("A = 2C, V = −γ₁ + 1/(20 γ₃²)")
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def read(page: str) -> Curves:
    """Return the points of the table that :func:`table` has made, from a page that has it."""
    _, _, rest = page.partition(f"## {TITLE}\n")
    found: Curves = {COMPILED: [], JOB: [], SCIPY: [], HEYOKA: []}
    for line in rest.partition("\n## ")[0].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] in found:
            way, name, taken, error = cells
            number, unit = taken.split()
            found[way].append(Result(name, float(number) * UNITS[unit], float(error)))
    return found


def _point(
    motion: Measured, grid: FloatArray, name: str, action: Callable[[], FloatArray], repeats: int
) -> Result:
    return Result(name, median(action, repeats), motion.error(grid, action()))


def certified_job(effort: Effort) -> Result:
    """Return what a whole job takes at the tier certified, and its largest proven radius."""
    solve = _job({"tier": "certified"})
    columns = decode_arrays(solve().samples)
    radius = max(float(columns[f"{name}.{RADIUS}"].max()) for name in COLUMNS)
    return Result("certified", median(solve, effort.repeats(5)), radius)


def _job(accuracy: dict[str, str]) -> Callable[[], Solved]:
    time_ = {"periods": PERIODS, "samples": SAMPLES}
    return job_of({**PROBLEMS["A = 2C"], "time": time_, "accuracy": accuracy})


def _by_job(motion: Measured, name: str, accuracy: dict[str, str], repeats: int) -> Result:
    solve = _job(accuracy)
    columns = decode_arrays(solve().samples)
    turns = exact_instants(TimePeriods(Fraction(PERIODS), SAMPLES))
    return Result(name, median(solve, repeats), motion.error_after(turns, samples_of(columns)[0]))


def _by_heyoka(motion: Measured, state: FloatArray, grid: FloatArray, tol: float, repeats: int) -> Result:
    integrator = taylor_of_elliptic(state, tol)
    taken = []
    for _ in range(repeats):
        integrator.time, integrator.state[:] = 0.0, state
        began = clock()
        samples = np.asarray(integrator.propagate_grid(grid)[-1])
        taken.append(clock() - began)
    return Result(f"{tol:.0e}", float(np.median(taken)), motion.error(grid, samples))


if __name__ == "__main__":
    draw(read(REPORT.read_text(encoding="utf-8")), PICTURE)
