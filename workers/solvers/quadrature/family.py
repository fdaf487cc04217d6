"""The family of solvers by quadrature in balls, which takes every planar motion.

Aperiodic motions are functions of time with limits in the past and in the future.
"""

from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from math import inf
from typing import TypeVar

import numpy as np
from flint import ctx
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.motion import COLUMNS, AperiodicKind, Asymptote, Estimate, Motion
from service.dynamics.numerics import is_within, largest
from service.dynamics.potentials.angular_part.along_curve import LoopCurve
from service.dynamics.potentials.families.general_solution import (
    SIGNS,
    AlongCurve,
    GeneralPotential,
    along_curve,
)
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import StartingPoint, Window, require_known_ends
from service.dynamics.sampling import sample_times
from service.dynamics.solution.dense_output import EPSILON, DenseOutput
from workers.solvers.assembly.dense import Sampler, TimeMap, resolve_motion
from workers.solvers.assembly.families import (
    Declined,
    PeriodicPlace,
    Place,
    Sampled,
    conventions_of,
    energy_of,
    evidence_of,
    make_periodic,
)
from workers.solvers.errors import EndNotKnownError, PrecisionLostError
from workers.solvers.evidence import with_claim_raised
from workers.solvers.orbits.near_rest import SlowOrbit
from workers.solvers.orbits.orbit import Graded, Libration, Rotation, graded, starting_state
from workers.solvers.quadrature.flight import Flight, Reach, asymptote, make_flight, reach
from workers.solvers.quadrature.squared_speed import CACHED_TIME_MAPS, time_map_of
from workers.solvers.quadrature.time_map import GradedSamples, make_time_map, phase_sampler, series_sampler

FloatArray = NDArray[np.float64]

DOUBLE_ZERO_BITS = 320
"""Bits with which a double zero, a minimum of P, is found to 2^-140: far beyond exp(−FARTHEST_Y)."""


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
    flight = replace(flight, first=past.y, last=future.y)
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


class QuadratureFamily:
    """See :class:`workers.solvers.assembly.families.Family`."""

    def takes(self, problem: Problem, place: Place) -> bool:
        """Take every motion."""
        return True

    def promise(self, problem: Problem) -> float:
        """Promise nothing: what it reaches, it claims."""
        return inf

    def solve(self, problem: Problem, place: Place) -> Motion | Declined:
        """Return the motion; that of a window that is not periodic is never declined.

        Raises
        ------
        LeavesDomainError, FlatZeroError
            The motion ends where no quadrature knows the way to.
        PrecisionLostError
            More bits are needed.
        QuadratureNotConvergedError, DenseOutputNotResolvedError
            The motion has more detail than the largest number of panels or pieces holds.
        WindowBlockedError
            p² is negative inside the window.
        PeriodNeededError, MotionEndedError
            The times asked for are not there: the motion has no period, or has ended before.
        """
        require_known_ends(place.window)
        place = _by_series(place)
        if isinstance(place, PeriodicPlace):
            return make_periodic(problem, place, _by_time_map(place))
        kind = place.window.kind
        assert kind != "periodic"
        # Refused by their ends.
        assert kind != "edge"
        assert kind != "standstill"
        return solve_aperiodic(problem, place.window, kind, place.start)


@dataclass(frozen=True, slots=True)
class _OnLoop:
    """A potential without a formula on a loop, told from others by all that it depends on there."""

    potential: GeneralPotential
    lambda_squared: Fraction
    precision: int
    loop: Loop = field(compare=False)


@lru_cache(maxsize=CACHED_TIME_MAPS)
def _along(asked: _OnLoop) -> AlongCurve:
    loop = asked.loop
    return along_curve(asked.potential, LoopCurve(loop.alpha, loop.Z, loop.G, loop.mirrored))


AnyPlace = TypeVar("AnyPlace", bound=Place)


def _by_series(place: AnyPlace) -> AnyPlace:
    """Return the place; where V is an integral, and F no sum of powers, with V by series on the curve."""
    arc = place.start.arc
    loop, potential = arc.loop, arc.loop.potential
    if not isinstance(potential, GeneralPotential) or all(potential.powers_of_w(*s) for s in SIGNS.values()):
        return place
    along = replace(loop, potential=_along(_OnLoop(potential, loop.lambda_squared, ctx.prec, loop)))
    return replace(place, start=replace(place.start, arc=replace(arc, loop=along)))


def _by_time_map(place: PeriodicPlace) -> Sampled:
    orbit = place.orbit if isinstance(place.orbit, SlowOrbit) else graded(place.orbit) or place.orbit
    time_map = (
        time_map_of(orbit)
        if isinstance(orbit, Libration | Rotation)
        else make_time_map(orbit.rate, orbit.corners + orbit.junctions, is_even=orbit.is_even)
    )
    period, departures = time_map.period, np.zeros(1)
    origin = float(time_map.time_at(np.array([orbit.start]))[0])
    on_map = phase_sampler(orbit, time_map)
    if isinstance(orbit, Graded):
        on_map, departures = series_sampler(orbit, time_map)

    def on_turn(times: FloatArray) -> FloatArray:
        local = times + origin
        return np.clip(np.where(local > period.hi, local - period.hi, local), 0.0, period.hi)

    def sample(times: FloatArray) -> FloatArray:
        return on_map(on_turn(times))

    def departures_at(times: FloatArray) -> FloatArray:
        return np.asarray(departures[time_map.phase_at(on_turn(times))[0]], np.float64)

    passages = np.sort((time_map.time_at(np.array(orbit.corners)) - origin) % period.hi)
    kinks = np.sort((time_map.kinks - origin) % period.hi)
    times, widths = time_map.features()
    features = (times - origin) % period.hi, widths
    # The phase of the start, too, has its time from the map.
    late = 2.0 * time_map.error
    own = None
    if isinstance(orbit, Graded):
        own = GradedSamples(sample, passages, period, late, departures_at)
    return Sampled(
        sample,
        period,
        passages,
        largest(departures.tolist()),
        time_map.evidence(),
        late=own,
        time_error=late,
        features=features,
        kinks=kinks,
    )
