"""Many motions of one program in compiled doubles: the way of a single one, and its very numbers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.dense_output import Period
from service.dynamics.problem import PlanarMotion, TimePeriods, Times
from service.dynamics.sampling import SampleTimes, sample_times
from workers.solvers.spectral import curve, time_map
from workers.solvers.spectral.frame import Frame, make_frame, primed_logarithm
from workers.solvers.spectral.motion import Bounds
from workers.solvers.spectral.program import Program
from workers.solvers.spectral.sampling import sample
from workers.solvers.spectral.solve import MATRIX, PLACES, POINTS, TOLERANCES, Tier
from workers.solvers.spectral.solve_set import solve_sets

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Swept:
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
    approaches: FloatArray
    """Poisson variables of points on the way to each pole, shape (sets, 2, depths, 3); see :data:`DEPTHS`."""


DEPTHS = (1.0 / math.cosh(13.0), 1e-9, 1e-14, 1e-25, 1e-50, 1e-100)
"""|sin v| from the last place near a pole that the solver looks at to where one power is left."""


@dataclass(frozen=True, slots=True)
class Sampling:
    """Where and which variables are wanted."""

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
) -> Swept | None:
    """Solve the program with each of the ``rows`` of constants, on the curve of the same place's λ².

    ``motion`` says everything but λ. None where no motion of its kind is solved here.
    """
    frame = make_frame(body, motion)
    if frame is None:
        return None
    if isinstance(sampling.time, TimePeriods) and len(sampling.columns):
        return _each_with_its_times(frame, program, rows, lambdas_squared, sampling, tier)
    shared = not isinstance(sampling.time, TimePeriods) and sampling.has_times
    nothing = SampleTimes(np.zeros(0), np.zeros(0))
    asked = sample_times(sampling.time, None) if shared else nothing
    times, wanted = asked.doubles, asked if len(sampling.columns) else nothing
    run = _run(frame, program, rows, _given(frame, lambdas_squared), wanted, sampling.columns, tier)
    latest = np.abs(times).max() if shared else _latest(sampling, run.about[:, 1])
    errors = _errors(run.about, latest)
    return _swept(frame, run.loops, run.about, errors, times, run.samples)


@dataclass(frozen=True, slots=True)
class _Run:
    loops: FloatArray
    about: FloatArray
    samples: FloatArray
    panels: FloatArray
    """Of the last set."""


def _run(
    frame: Frame,
    program: Program,
    rows: FloatArray,
    given: FloatArray,
    times: SampleTimes,
    columns: IntArray,
    tier: Tier,
) -> _Run:
    sets = len(rows)
    run = _Run(
        np.repeat(frame.loop[None, :], sets, axis=0),
        np.full((sets, 6), np.nan),
        np.empty((sets, len(times.doubles), len(columns))),
        np.empty((time_map.MAX_PANELS, time_map.COLUMNS)),
    )
    solve_sets(
        program.code,
        program.result,
        rows,
        run.loops,
        given,
        frame.half,
        frame.window,
        frame.wishes,
        TOLERANCES[tier],
        PLACES,
        MATRIX,
        POINTS,
        times.doubles,
        times.rests,
        columns,
        run.panels,
        run.samples,
        run.about,
    )
    return run


def primed_logarithms(frame: Frame, lambdas_squared: Sequence[fmpq]) -> FloatArray:
    """Return the logarithms of λ as a single problem has them, to the last bit."""
    # Python divides integers of any size with one rounding, as a Fraction is turned into a double.
    return np.array(
        [
            primed_logarithm(0.5 * math.log(int(square.p) / int(square.q)), frame.loop)
            for square in lambdas_squared
        ]
    )


def _given(frame: Frame, lambdas_squared: Sequence[fmpq]) -> FloatArray:
    given = np.zeros((len(lambdas_squared), 2))
    given[:, 0] = primed_logarithms(frame, lambdas_squared)
    return given


def _each_with_its_times(
    frame: Frame,
    program: Program,
    rows: FloatArray,
    lambdas_squared: Sequence[fmpq],
    sampling: Sampling,
    tier: Tier,
) -> Swept:
    """Solve one after the other: in periods each motion has times of its own."""
    assert isinstance(sampling.time, TimePeriods)
    given = _given(frame, lambdas_squared)
    shape = (len(rows), sampling.time.samples)
    times, samples = np.full(shape, np.nan), np.full((*shape, len(sampling.columns)), np.nan)
    loops, about = np.empty((len(rows), len(frame.loop))), np.full((len(rows), 6), np.nan)
    nothing = SampleTimes(np.zeros(0), np.zeros(0))
    for n in range(len(rows)):
        one = slice(n, n + 1)
        run = _run(frame, program, rows[one], given[one], nothing, sampling.columns, tier)
        loops[n], about[n] = run.loops[0], run.about[0]
        if about[n, 0]:
            period = Period(float(about[n, 1]), 0.0, float(about[n, 2]))
            asked = sample_times(sampling.time, period)
            times[n], number = asked.doubles, int(about[n, 0])
            sample(run.loops[0], run.panels, number, times[n], asked.rests, sampling.columns, samples[n])
    errors = _errors(about, np.abs(times).max(axis=1))
    return _swept(frame, loops, about, errors, times, samples)


def _swept(
    frame: Frame,
    loops: FloatArray,
    about: FloatArray,
    errors: FloatArray,
    times: FloatArray,
    samples: FloatArray,
) -> Swept:
    passes_pole, approaches = _pass_a_pole(loops, about), _approaches(frame, loops)
    return Swept(about[:, 1], about[:, 2], errors, times, samples, passes_pole, approaches)


def _latest(sampling: Sampling, periods: FloatArray) -> FloatArray:
    """Return the largest |t| of each motion whose times depend on its period."""
    if not isinstance(sampling.time, TimePeriods) or not sampling.has_times:
        return periods
    return np.array(
        [
            np.abs(sample_times(sampling.time, Period(period, 0.0, 0.0)).doubles).max()
            if math.isfinite(period)
            else math.nan
            for period in periods.tolist()
        ]
    )


def _errors(about: FloatArray, latest: FloatArray | float) -> FloatArray:
    bounds = Bounds(about[:, 2], about[:, 3], about[:, 5], about[:, 4])
    errors = bounds.error_at(latest, about[:, 1], about[:, 2])  # type: ignore[arg-type]
    decided = (about[:, 0] > 0.0) & ~np.isnan(errors)
    return np.where(decided, errors, np.inf)


def _pass_a_pole(loops: FloatArray, about: FloatArray) -> BoolArray:
    """Say which motions pass a pole, where v is a multiple of π, as :attr:`SpectralMotion.ends` does."""
    middle = np.arctan2(loops[:, curve.S_MIDDLE], loops[:, curve.C_MIDDLE])
    lower = np.floor((middle - loops[:, curve.HALF]) / np.pi)
    upper = np.floor((middle + loops[:, curve.HALF]) / np.pi)
    with np.errstate(invalid="ignore"):
        passes: BoolArray = (about[:, 0] > 0.0) & ((loops[:, curve.ROTATES] != 0.0) | (lower != upper))
    return passes


def _approaches(frame: Frame, loops: FloatArray) -> FloatArray:
    """Return the points with |sin v| = ``DEPTHS`` on the half of the loop where the motion is asked."""
    depths = np.array(DEPTHS)
    first = loops[:, curve.SIGN1, None] * loops[:, curve.G, None] * depths ** loops[:, curve.ALPHA, None]
    third = frame.half * loops[:, curve.Z, None] * depths
    second = np.sqrt(1.0 - first * first - third * third)
    g1, g3 = (third, first) if frame.loop[curve.MIRRORED] else (first, third)
    return np.stack([np.stack([g1, sign * second, g3], axis=-1) for sign in (1.0, -1.0)], axis=1)
