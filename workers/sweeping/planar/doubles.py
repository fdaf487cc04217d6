"""Computes many motions of one program in compiled doubles, bit for bit like single ones.

At the end: the results of a block of neighbouring points, which are filled in group by group.
"""

import math
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.motion import COLUMNS
from service.dynamics.numerics import printed_error
from service.dynamics.problem import PlanarMotion, StartAtPoint, TimePeriods, Times
from service.dynamics.reduction.windows import NoMotionError
from service.dynamics.sampling import SampleTimes, sample_times, sample_times_of_each
from service.dynamics.solution.dense_output import EPSILON, Period
from service.schemas.sweep.sweep import Sweep
from workers.solvers.compiled.evaluation.program import Program
from workers.solvers.compiled.frame import logarithm_of, make_frame, with_rests
from workers.solvers.compiled.motion import ALL
from workers.solvers.compiled.records import FOUND, Found, Records, copied, new_records
from workers.solvers.compiled.solve import (
    NO_TIMES,
    START_ULPS,
    Batch,
    BatchResult,
    Tier,
    bounds_of,
    is_kept,
    solve_batch,
)
from workers.solvers.compiled.time_map.sampling import sample_one
from workers.solvers.compiled.workspace import WORKSPACE
from workers.solvers.units import Units

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

NO_MOTION, INVALID, INADMISSIBLE = NoMotionError.code, "invalid_problem", "inadmissible_potential"


@dataclass(frozen=True, slots=True)
class BlockResult:
    """Motions of one program, NaN where one was not decided."""

    periods: FloatArray
    """Shape (sets,)."""
    period_errors: FloatArray
    errors: FloatArray
    """Bound of the error of each one's samples; inf where not decided."""
    times: FloatArray
    """Shape (sets, times), or (times,) if all have the same."""
    samples: FloatArray
    """Shape (sets, times, columns)."""
    passes_pole: BoolArray
    is_kept: BoolArray
    """The motions that have the digits of ``high`` within a period."""
    approaches: FloatArray | None
    """Poisson variables of points on the way to each pole, shape (sets, 2, POLE_DEPTHS, 3).

    None where nobody needs to look there.
    """
    speeds: FloatArray
    """Largest |p| or |r| of each, about."""

    def in_units(self, units: Units) -> "BlockResult":
        """Return what was solved in these units in the client's; nothing changes in the client's own."""
        if not units.k:
            return self
        samples = self.samples * units.of_columns(COLUMNS) if self.samples.shape[2] else self.samples
        return replace(
            self,
            periods=self.periods * units.slow,
            period_errors=self.period_errors * units.slow,
            errors=self.errors * max(1.0, units.quick),
            times=self.times * units.slow,
            samples=samples,
            speeds=self.speeds * units.quick,
        )

    def with_others(self, indices: IntArray, others: "BlockResult") -> "BlockResult":
        """Return these motions with ``others`` at ``indices``, where another way has solved them."""
        solved = others.is_kept
        indices = indices[solved]

        def put(mine: FloatArray, theirs: FloatArray) -> FloatArray:
            whole = mine.copy()
            whole[indices] = theirs[solved]
            return whole

        passes_pole, kept = self.passes_pole.copy(), self.is_kept.copy()
        passes_pole[indices], kept[indices] = others.passes_pole[solved], True
        return replace(
            self,
            periods=put(self.periods, others.periods),
            period_errors=put(self.period_errors, others.period_errors),
            errors=put(self.errors, others.errors),
            times=put(self.times, others.times) if self.times.ndim > 1 else self.times,
            samples=put(self.samples, others.samples) if self.samples.shape[2] else self.samples,
            passes_pole=passes_pole,
            is_kept=kept,
            speeds=put(self.speeds, others.speeds),
        )


POLE_DEPTHS = (1.0 / math.cosh(13.0), 1e-9, 1e-14, 1e-25, 1e-50, 1e-100)
"""|sin v| from the last point near a pole that the solver looks at to where one power is left."""


AT_START = SampleTimes(np.zeros(1), np.zeros(1))
LEAST_START_SLOPE = 2.0**-20
"""Least |g1'| and |g3'| at a given start: below, doubles do not tell that the start is inside the window."""


@dataclass(frozen=True, slots=True)
class Sampling:
    """The times and the variables of the samples that are wanted."""

    time: Times
    columns: IntArray
    """Numbers of the six variables; without any only the error at these times is told."""
    has_times: bool = True
    """False if no function of time is asked for: the error is that within one period."""


def sweep_sets(
    body: RigidBody,
    motion: PlanarMotion,
    program: Program,
    rows: FloatArray,
    lambdas_squared: Sequence[fmpq],
    sampling: Sampling,
    tier: Tier,
    starts: FloatArray | None = None,
    times: Sequence[Times] | None = None,
    rests: FloatArray | None = None,
) -> BlockResult | None:
    """Solve the program with each of the ``rows`` of constants, on the curve of the same row's λ².

    ``motion`` gives everything but λ, and but |g1| at its start where there are ``starts``, shape (sets,).
    ``rests`` are what the constants leave out, where the tier asks for them. None if motions of its kind are
    not solved here.
    """
    frame = make_frame(body, motion)
    if frame is None:
        return None
    if rests is None:
        loops = frame.loops(logarithms_of(lambdas_squared))
    else:
        loops = with_rests(frame, body, lambdas_squared)
    return sweep_loops(motion, program, rows, loops, sampling, tier, starts, times, rests)


def sweep_loops(
    motion: PlanarMotion,
    program: Program,
    rows: FloatArray,
    loops: Records,
    sampling: Sampling,
    tier: Tier,
    starts: FloatArray | None = None,
    times: Sequence[Times] | None = None,
    rests: FloatArray | None = None,
) -> BlockResult:
    """Solve the program with each of the ``rows`` on its own loop, as :func:`sweep_sets` does.

    With ``times`` each has its own; else those of ``sampling`` are those of all.
    """
    if starts is not None:
        loops["size_of_g1"] = starts
    batch = Batch(program, rows, loops, tier, columns=sampling.columns, rests=rests)
    late = _lateness(batch) if isinstance(motion.start, StartAtPoint) else np.zeros(len(loops))
    if times is None and isinstance(sampling.time, TimePeriods) and sampling.has_times:
        times = [sampling.time] * len(loops)
    # Times in periods are those of a period's two doubles, where it has two.
    if times is not None and (len(sampling.columns) > 0 or rests is not None):
        return _each_with_its_times(batch, times, late)
    shared = times is None and sampling.has_times
    asked = sample_times(sampling.time, None) if shared else NO_TIMES
    run = solve_batch(replace(batch, times=asked if len(sampling.columns) else NO_TIMES))
    latest = np.abs(asked.doubles).max() if shared else _latest(sampling, times, run.found)
    return _solved(run.loops, run.found, late, latest, asked.doubles, run.samples)


def logarithms_of(lambdas_squared: Sequence[fmpq]) -> list[float]:
    """Return the logarithms of λ as a single problem has them, to the last bit."""
    return [logarithm_of(square) for square in lambdas_squared]


def _lateness(batch: Batch) -> FloatArray:
    """Return the time that the rounding of each given start is worth, as a single motion counts it.

    It is inf where the start may be at an end of the window, or where there is no motion.
    """
    states = np.abs(solve_batch(replace(batch, times=AT_START, columns=ALL)).samples[:, 0])
    slowest = states[:, 4] * np.minimum(states[:, 0], states[:, 2])
    late = np.full(len(slowest), np.inf)
    is_sure = slowest > LEAST_START_SLOPE
    late[is_sure] = START_ULPS * EPSILON / slowest[is_sure]
    return late


def _each_with_its_times(batch: Batch, asked_of: Sequence[Times], late: FloatArray) -> BlockResult:
    """Solve one after the other: each motion has times of its own, as it has in periods."""

    def solve(n: int) -> BatchResult:
        one = slice(n, n + 1)
        rests = None if batch.rests is None else batch.rests[one]
        return solve_batch(
            replace(batch, constants=batch.constants[one], loops=batch.loops[one], rests=rests)
        )

    asked = partial(_asked, asked_of)
    return solve_one_by_one(batch.loops, batch.columns, solve, asked, asked_of[0].samples, late)


def _asked(asked_of: Sequence[Times], n: int, period: Period) -> SampleTimes:
    return sample_times(asked_of[n], period)


def solve_one_by_one(
    given: Records,
    columns: IntArray,
    solve: Callable[[int], BatchResult | None],
    asked: Callable[[int, Period], SampleTimes],
    count: int,
    late: FloatArray | None = None,
) -> BlockResult:
    """Solve the motions of the ``given`` loops, one after the other, and sample each where that is asked.

    ``solve`` returns a motion by its number; ``asked`` so many times by its number and period. Without a
    ``late`` time for each motion they have the digits of ``high`` if they are solved. Where no times are
    asked the error is that within a period.
    """
    sets = len(given)
    times, samples = np.full((sets, count), np.nan), np.full((sets, count, len(columns)), np.nan)
    loops, found, workspace = copied(given), new_records(FOUND, sets), new_records(WORKSPACE)
    for name in found.dtype.names or ():
        found[name] = 0 if name == "panels" else np.nan
    for n in range(sets):
        run = solve(n)
        if run is None:
            continue
        loops[n], found[n] = run.loops[0], run.found[0]
        about = run.found[0]
        if about.panels and count:
            low = float(run.loops[0].period_lo)
            at = asked(n, Period(float(about.period), low, float(about.period_error)))
            times[n] = at.doubles
            if len(columns):
                sample_one(run.loops, run.panels, times[n], at.low_parts, columns, workspace, samples[n])
    latest = np.abs(times).max(axis=1) if count else found["period"]
    return _solved(loops, found, late, latest, times, samples)


def _solved(
    loops: Records,
    found: Records,
    late: FloatArray | None,
    latest: FloatArray | float,
    times: FloatArray,
    samples: FloatArray,
) -> BlockResult:
    bounds = bounds_of(found)
    bounds = bounds if late is None else replace(bounds, time=bounds.time + late)
    # Of samples up to |t| = latest; inf where not decided.
    errors = bounds.error_at(latest, found["period"], found["period_error"])
    is_solved = (found["panels"] > 0) & ~np.isnan(errors)
    has_digits = late is None or is_kept(bounds, found["period"], found["period_error"])
    # What the second double of a period says is left out of the first.
    period_errors = np.abs(loops["period_lo"]) + found["period_error"]
    return BlockResult(
        found["period"],
        period_errors,
        np.where(is_solved, errors, np.inf),
        times,
        samples,
        _pass_a_pole(loops, found),
        is_solved & has_digits,
        _approaches(loops),
        found["largest"],
    )


def _latest(sampling: Sampling, times: Sequence[Times] | None, found: Records) -> FloatArray:
    """Return the largest |t| of each motion, which has times of its own; without times that is its period."""
    periods: FloatArray = found["period"]
    if times is None or not sampling.has_times:
        return periods
    first = times[0]
    if isinstance(first, TimePeriods) and all(each is first for each in times):
        latest: FloatArray = np.abs(sample_times_of_each(first, periods).doubles).max(axis=1)
        return latest
    ends = [
        np.abs(sample_times(asked, _period(about)).doubles).max()
        for asked, about in zip(times, found, strict=True)
    ]
    return np.array(ends)


def _period(about: Found) -> Period:
    return Period(float(about.period), 0.0, float(about.period_error))


def _pass_a_pole(loops: Records, found: Records) -> BoolArray:
    """Tell which motions pass a pole, where v is a multiple of π, as :attr:`SpectralMotion.ends` does."""
    middle = np.arctan2(loops["s_middle"], loops["c_middle"])
    lower = np.floor((middle - loops["half_width"]) / np.pi)
    upper = np.floor((middle + loops["half_width"]) / np.pi)
    with np.errstate(invalid="ignore"):
        passes: BoolArray = (found["panels"] > 0) & (loops["rotates"] | (lower != upper))
    return passes


def _approaches(loops: Records) -> FloatArray:
    """Return the points with |sin v| = ``POLE_DEPTHS`` on the half of the loop where the motion is asked."""
    depths = np.array(POLE_DEPTHS)
    first = (loops["sign1"] * loops["g"])[:, None] * depths ** loops["alpha"][:, None]
    third = loops["half"][:, None] * loops["z"][:, None] * depths
    second = np.sqrt(1.0 - first * first - third * third)
    mirrored = loops["mirrored"][:, None]
    g1, g3 = np.where(mirrored, third, first), np.where(mirrored, first, third)
    return np.stack([np.stack([g1, sign * second, g3], axis=-1) for sign in (1.0, -1.0)], axis=1)


@dataclass(frozen=True, slots=True)
class SolvedBlock:
    """Some neighbouring points; those neither ``solved`` nor ``refused`` are left to single jobs."""

    solved: BoolArray
    """Shape (points,)."""
    refused: Mapping[str, BoolArray]
    """The points that certainly end with the error of this code, shape (points,)."""
    numbers: Mapping[str, FloatArray]
    """The kept numbers, each of shape (points,)."""
    series: Mapping[str, FloatArray]
    """The functions of time, each of shape (points, samples)."""

    @property
    def is_open(self) -> BoolArray:
        """Tell which are left."""
        undecided: BoolArray = ~np.logical_or.reduce([self.solved, *self.refused.values()])
        return undecided


class FoundPoints:
    """The results of a block, filled in group by group."""

    def __init__(self, sweep: Sweep, count: int) -> None:
        self.solved, self.refused = np.zeros(count, dtype=np.bool_), dict[str, BoolArray]()
        self.numbers = {name: np.full(count, np.nan) for name in sweep.keep}
        self.series = {name: np.full((count, sweep.samples), np.nan) for name in sweep.series_columns}

    def refuse(self, code: str, indices: IntArray) -> None:
        """Note that these points end with an error."""
        if len(indices):
            self.refused.setdefault(code, np.zeros(len(self.solved), dtype=np.bool_))[indices] = True

    def block(self) -> SolvedBlock:
        """Return all of it."""
        return SolvedBlock(self.solved, self.refused, self.numbers, self.series)

    def add(
        self, indices: IntArray, solved: BoolArray, numbers: Mapping[str, FloatArray], result: BlockResult
    ) -> None:
        """Fill in the points of a group."""
        self.solved[indices] = solved
        numbers = {**numbers, **printed_errors(numbers, self.numbers)}
        for name, column in self.numbers.items():
            if name in numbers:
                column[indices] = numbers[name]
        for k, name in enumerate(name for name in self.series if name != "t"):
            at = COLUMNS.index(name) if result.samples.shape[2] == len(COLUMNS) else k
            self.series[name][indices] = result.samples[:, :, at]
        if "t" in self.series:
            self.series["t"][indices] = result.times

    def put(self, indices: IntArray, block: SolvedBlock) -> None:
        """Fill in points that were solved as a block of their own."""
        self.solved[indices] = block.solved
        for code, points in block.refused.items():
            self.refuse(code, indices[points])
        for mine, theirs in ((self.numbers, block.numbers), (self.series, block.series)):
            for name, column in theirs.items():
                mine[name][indices] = column


def printed_errors(numbers: Mapping[str, FloatArray], kept: Container[str]) -> dict[str, FloatArray]:
    """Return the ``kept`` errors of period and energy, as those of the decimals that a job writes."""
    return {
        f"{name}.error": np.array(
            list(map(printed_error, numbers[name].tolist(), numbers[f"{name}.error"].tolist()))
        )
        for name in ("period", "energy")
        if f"{name}.error" in kept and f"{name}.error" in numbers
    }
