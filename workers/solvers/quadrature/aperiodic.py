"""Solves aperiodic planar motions as functions of time, with their limits in past and future."""

import numpy as np
from flint import ctx
from numpy.typing import NDArray

from service.dynamics.bounds import is_within, largest
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import COLUMNS, AperiodicKind, Asymptote, Estimate, Motion
from service.dynamics.problem import Problem
from service.dynamics.reduction.start import StartingPoint
from service.dynamics.reduction.window import Window
from service.dynamics.sampling import sample_times
from service.dynamics.solution.dense_output import EPSILON, DenseOutput
from workers.solvers.assembly.dense import Sampler, resolve_motion
from workers.solvers.assembly.families import conventions_of, energy_of, evidence_of
from workers.solvers.assembly.time_map import TimeMap
from workers.solvers.errors import EndNotKnownError, PrecisionLostError
from workers.solvers.evidence import with_claim_raised
from workers.solvers.orbits.orbit import starting_state
from workers.solvers.quadrature.flight import Flight, Reach, asymptote, make_flight, reach
from workers.solvers.quadrature.phase_sampler import phase_sampler
from workers.solvers.quadrature.squared_speed import time_map_of

FloatArray = NDArray[np.float64]


DOUBLE_ZERO_BITS = 320
"""Bits with which a double zero, a minimum of P, is found to 2^-140: far beyond exp(-FARTHEST)."""


class MotionEndedError(DynamicsError):
    """All the times asked for lie beyond the end of the motion."""

    code = "motion_ended"


def solve_aperiodic(problem: Problem, window: Window, kind: AperiodicKind, start: StartingPoint) -> Motion:
    """Return the motion from ``start`` in a window of the given ``kind``, over the asked times.

    Where the motion ends in finite time (a collision; a pole that is not
    passed) it is sampled at the asked times before that.

    Raises
    ------
    PeriodNeededError
        Times are asked in periods.
    MotionEndedError
        The motion has ended before all of the asked times.
    EndNotKnownError
        Whether it has ended by one of them cannot be told.
    """
    all_asked = sample_times(problem.time, None)
    times = all_asked.doubles
    if kind == "equilibrium":
        return with_claim_raised(problem.body, problem.potential, _rest(window, start, times))
    if "double" in (start.arc.lower_end, start.arc.upper_end) and ctx.prec < DOUBLE_ZERO_BITS:
        raise PrecisionLostError("a double zero is known to fewer digits than its neighbourhood needs")
    asked = float(np.abs(times).max(initial=0.0))
    flight = make_flight(start)
    past, future = (reach(flight, side, asked) for side in (-1, 1))
    flight = flight.reaching(past.y, future.y)
    time_map = time_map_of(flight)
    origin = float(time_map.time_at(np.array([flight.start]))[0]) + float(flight.after_start)
    ends = _ends(flight, (past, future), time_map, origin)
    lives = _before_the_end(times, ends, problem.tolerance)
    times, low_parts = times[lives], all_asked.low_parts[lives]
    span = (min(0.0, float(times.min())), max(0.0, float(times.max())))
    on_map = phase_sampler(flight, time_map)
    total = time_map.period.hi

    def sample(asked: FloatArray) -> FloatArray:
        # Beyond the map the motion is at its asymptote, to a double's last digit.
        return on_map(np.clip(asked + origin, 0.0, total))

    passages = time_map.time_at(np.array(flight.corners)) - origin if flight.corners else np.zeros(0)
    passages = passages[(passages > span[0]) & (passages < span[1])]
    kinks = time_map.kinks - origin
    marks, widths = time_map.features()
    resolved = resolve_motion(
        sample,
        span if span[0] < span[1] else (0.0, float(np.spacing(1.0))),
        np.sort(np.concatenate([passages, kinks])),
        scale=max(total, asked),
        atol=min(1e-14, 1e-3 * problem.tolerance),
        features=(marks - origin, widths),
    )
    error = resolved.error + _error_of_times(sample, times, 2.0 * time_map.error + 4.0 * EPSILON * total)
    dense = DenseOutput(COLUMNS, resolved.breaks, resolved.coefficients, None, error)
    conventions = conventions_of(start)
    first = passages[np.argmin(np.abs(passages))] if len(passages) else np.inf
    motion = Motion(
        method="quadrature",
        dense=dense,
        times=times,
        samples=dense(times, low_parts),
        error=dense.error_at(times),
        samples_kind="estimate",
        function_kind="estimate",
        energy=energy_of(start.arc.loop, flight.somewhere()),
        window=window,
        aperiodic=kind,
        past=ends[0],
        future=ends[1],
        cross_check=None,
        conventions=conventions,
        evidence={**time_map.evidence(), **evidence_of(resolved)},
        low_parts=low_parts,
        first_passage=float(abs(first)) if conventions and len(passages) else None,
    )
    return with_claim_raised(problem.body, problem.potential, motion)


def _rest(window: Window, start: StartingPoint, times: FloatArray) -> Motion:
    """Return the constant motion at a double zero of p²."""
    state = starting_state(start)
    values = np.array([float(value) for value in state])
    uncertain = largest(float(value.rad()) for value in state) + float(start.v.rad())
    span = np.array([min(0.0, float(times.min())), max(1.0, float(times.max()))])
    dense = DenseOutput(COLUMNS, span, values[None, None, :], None, uncertain + EPSILON)
    at = Asymptote("equilibrium", None, None, (float(values[3]), float(values[4]), float(values[5])))
    return Motion(
        method="quadrature",
        dense=dense,
        times=times,
        samples=dense(times),
        error=dense.error_at(times),
        samples_kind="estimate",
        function_kind="estimate",
        energy=energy_of(start.arc.loop, start.v),
        window=window,
        aperiodic="equilibrium",
        past=at,
        future=at,
        cross_check=None,
        conventions=(),
        evidence={},
    )


def _ends(
    flight: Flight, reaches: tuple[Reach, Reach], time_map: TimeMap, origin: float
) -> tuple[Asymptote, Asymptote]:
    """Return past and future."""
    error = 2.0 * time_map.error + 4.0 * EPSILON * time_map.period.hi
    arrivals = [Estimate(at - origin, error, "estimate") for at in (0.0, time_map.period.hi)]
    past, future = (asymptote(flight, found, at) for found, at in zip(reaches, arrivals, strict=True))
    return past, future


def _before_the_end(
    times: FloatArray, ends: tuple[Asymptote, Asymptote], tolerance: float
) -> NDArray[np.bool_]:
    """Say at which of the times there is a motion."""
    past, future = (end.time for end in ends)
    kept = np.ones(len(times), dtype=np.bool_)
    for side, end in ((-1.0, past), (1.0, future)):
        if end is None:
            continue
        before = side * times < side * end.value - end.error
        # The times beyond may be before the end just as well, where its error is no small one: next to a
        # place that the motion passes all but at rest, a part of the way may be charged as its own error.
        if not before.all() and not is_within(end.error, tolerance):
            raise EndNotKnownError(end.value, end.error, tolerance)
        kept &= before
    if not kept.any():
        lives = [f"{name} t = {end.value:.15g}" for name, end in (("from", past), ("until", future)) if end]
        raise MotionEndedError(
            f"the motion lasts {' '.join(lives)} only, and all the asked times are outside", pointer="/time"
        )
    return kept


def _error_of_times(sample: Sampler, times: FloatArray, by: float) -> float:
    """Return what an error of the time by ``by`` does to the six variables at ``times``."""
    before, after = sample(times - by), sample(times + by)
    return float(np.abs(after - before).max(initial=0.0))
