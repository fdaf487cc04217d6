"""The family of solvers by quadrature in balls, which takes every planar motion."""

from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from math import inf
from typing import TypeVar

import numpy as np
from flint import ctx
from numpy.typing import NDArray

from service.dynamics.bounds import largest
from service.dynamics.motion import Motion
from service.dynamics.potentials.angular_part.along_curve import LoopCurve
from service.dynamics.potentials.families.general_solution import (
    SIGNS,
    AlongCurve,
    GeneralPotential,
    along_curve,
)
from service.dynamics.problem import Problem
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.window import require_known_ends
from workers.solvers.assembly.families import Declined, PeriodicPlace, Place
from workers.solvers.assembly.periodic import Sampled, make_periodic
from workers.solvers.orbits.graded import Graded, graded
from workers.solvers.orbits.near_rest import SlowOrbit
from workers.solvers.orbits.orbit import Libration, Rotation
from workers.solvers.quadrature.aperiodic import solve_aperiodic
from workers.solvers.quadrature.phase_sampler import GradedSamples, phase_sampler, series_sampler
from workers.solvers.quadrature.squared_speed import KEPT, time_map_of
from workers.solvers.quadrature.time_map import make_time_map

FloatArray = NDArray[np.float64]


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


@lru_cache(maxsize=KEPT)
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
