"""Periodic planar motions: in closed form where there is one, by the quadrature of the orbit else."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.dynamics.dense_output import DenseOutput, Period
from service.dynamics.motion import COLUMNS, Motion
from service.dynamics.problem import Problem
from service.dynamics.reduction.start import StartingPoint
from service.dynamics.reduction.window import Window
from service.dynamics.sampling import sample_times
from workers.solvers.closed_form.solve import solve_closed_form
from workers.solvers.quadrature.dense import Sampler, phase_sampler, resolve_motion
from workers.solvers.quadrature.description import FIRST_PASSAGE, conventions_of, energy_of, evidence_of
from workers.solvers.quadrature.orbit import Orbit, make_orbit
from workers.solvers.quadrature.time_map import make_time_map

FloatArray = NDArray[np.float64]

WELL_CONDITIONED = 1e-12
"""Largest error of a closed form in doubles that is preferred to the quadrature in balls."""


@dataclass(frozen=True, slots=True)
class _Sampled:
    """A motion that can be sampled over one period."""

    sample: Sampler
    period: Period
    passages: FloatArray
    """Times in [0, period) at which a pole is passed, growing."""
    error: float
    """Of a sample, beside the departure of the dense output from it."""
    evidence: Mapping[str, float | int | str]


def solve_periodic(problem: Problem, window: Window, start: StartingPoint) -> Motion:
    """Return the motion from ``start`` in a periodic window; ``quadrature`` leaves closed forms aside."""
    orbit = make_orbit(start)
    motion = None if problem.method == "quadrature" else _in_closed_form(problem, window, start)
    motion = motion or _by_quadrature(orbit)
    period = motion.period
    atol = min(1e-14, 1e-3 * problem.tolerance)
    resolved = resolve_motion(motion.sample, (0.0, period.hi), motion.passages, scale=period.hi, atol=atol)
    error = resolved.error + motion.error
    dense = DenseOutput(COLUMNS, resolved.breaks, resolved.coefficients, period, error)
    times = sample_times(problem.time, period)
    conventions = conventions_of(start)
    return Motion(
        method="quadrature",
        dense=dense,
        times=times,
        samples=dense(times),
        error=dense.error_at(times),
        energy=energy_of(start.arc.loop, orbit.somewhere()),
        window=window,
        aperiodic=None,
        past=None,
        future=None,
        cross_check=None,
        conventions=conventions,
        evidence={
            **motion.evidence,
            **evidence_of(resolved),
            **({FIRST_PASSAGE: float(motion.passages[0])} if conventions else {}),
        },
    )


def _in_closed_form(problem: Problem, window: Window, start: StartingPoint) -> _Sampled | None:
    closed = solve_closed_form(problem.body, problem.potential, start, window)
    if closed is None or not closed.error() <= WELL_CONDITIONED:
        return None
    error = closed.error()
    evidence: dict[str, float | int | str] = {"closed_form": "elliptic functions", "rounding": error}
    return _Sampled(closed.sample, closed.period, closed.passages, error, evidence)


def _by_quadrature(orbit: Orbit) -> _Sampled:
    time_map = make_time_map(orbit.rate, orbit.corners, is_even=orbit.is_even)
    period = time_map.period
    origin = float(time_map.time_at(np.array([orbit.start]))[0])
    on_map = phase_sampler(orbit, time_map)

    def sample(times: FloatArray) -> FloatArray:
        local = times + origin
        local = np.where(local > period.hi, local - period.hi, local)
        return on_map(np.clip(local, 0.0, period.hi))

    passages = np.sort((time_map.time_at(np.array(orbit.corners)) - origin) % period.hi)
    return _Sampled(sample, period, passages, 0.0, time_map.evidence())
