"""The six variables as a function of time, from the phase and the time map."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from service.dynamics.numerics import largest
from service.dynamics.solution.dense_output import (
    Period,
    chebyshev_coefficients,
    chebyshev_points,
    phase_error,
    split_time,
)
from workers.solvers.assembly.dense import VARIABLE_RELATIVE_ROUNDING, FloatArray, Sampler
from workers.solvers.assembly.time_map import CHECKED_POINTS, UNSEEN_DEPARTURE_FACTOR, TimeMap, sum_series
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.graded import Graded, refine_near_poles
from workers.solvers.orbits.orbit import Orbit
from workers.solvers.quadrature.ellipse import PANEL_DEGREE

KNOWN_BITS, KNOWN = 54, 2.0**-54
"""Least relative accuracy of a variable's ball, or largest radius: either will do."""


@dataclass(frozen=True, slots=True)
class GradedSamples:
    """See :class:`workers.solvers.assembly.periodic.SamplesItself`: a motion through poles, at its own times.

    Next to a pole r is a power of time that may be far below the first: pieces claim there, and so
    everywhere, what the rounding of a time does to it. Each time that is asked for has the error that it has
    where it is.
    """

    on_period: Sampler
    """The six variables at times in [0, period]."""
    passages: FloatArray
    """Times in [0, period) at which a pole is passed."""
    period: Period
    time_error: float
    departures: Callable[[FloatArray], FloatArray]
    """Error of a sample at its own phase, of shape (n,)."""

    def resolved(self, pieces: int, atol: float) -> None:
        """Leave the function of time to :func:`workers.solvers.assembly.dense.resolve_motion`."""

    def sample(self, times: FloatArray, low_parts: FloatArray | None = None) -> FloatArray:
        """Return p, q, r, g1, g2, g3, shape (n, 6)."""
        return self.on_period(split_time(times, self.period, low_parts)[0])

    def error_at(self, times: FloatArray) -> float:
        """Return twice what the error of times does at these, where variables are monotone beside a pole."""
        late = phase_error(times, self.period) + self.time_error
        local = split_time(times, self.period)[0]
        here = self.on_period(local)
        moved = [np.abs(self.on_period((local + by) % self.period.hi) - here) for by in (-late, late)]
        away = np.abs(local[:, None] - self.passages)
        beside = np.minimum(away, self.period.hi - away) <= late
        at_poles = np.abs(self.on_period(self.passages) - here[:, None]) * beside[:, :, None]
        rounding = VARIABLE_RELATIVE_ROUNDING * np.abs(here).max(initial=0.0)
        worst = largest(float(each.max(initial=0.0)) for each in (*moved, at_poles))
        departures = (self.departures((local + by) % self.period.hi) for by in (-late, late))
        return 2.0 * worst + largest(float(each.max(initial=0.0)) for each in departures) + float(rounding)


def phase_sampler(orbit: Orbit, time_map: TimeMap) -> Sampler:
    """Return the six variables as a function of the time map's own times, from 0 to its total.

    It raises PrecisionLostError where the balls of a state are wider than the rounding of doubles.
    """

    def sample(times: FloatArray) -> FloatArray:
        panels, places = time_map.phase_at(times)
        return _states(orbit, time_map, zip(panels.tolist(), places.tolist(), strict=True))

    return sample


def series_sampler(orbit: Graded, time_map: TimeMap) -> tuple[Sampler, FloatArray]:
    """Return the same by series in the phase, in which everything is smooth on each panel; and their errors.

    A state costs a hundred times less. Next to a pole what is small is told relative to itself. The errors,
    one of each panel, are UNSEEN_DEPARTURE_FACTOR times the largest departure between the nodes.
    PrecisionLostError is raised at once.
    """
    panels, nodes = range(len(time_map.times) - 1), chebyshev_points(PANEL_DEGREE)
    series, departures = [], list[float]()
    for panel in panels:
        states = _states(orbit, time_map, [(panel, x) for x in (*nodes.tolist(), *CHECKED_POINTS)])
        series.append(chebyshev_coefficients(states[: len(nodes)]))
        told = np.polynomial.chebyshev.chebval(np.array(CHECKED_POINTS), series[-1]).T
        departures.append(float(np.abs(told - states[len(nodes) :]).max()))
    columns: FloatArray = np.stack(series, axis=2)

    def sample(times: FloatArray) -> FloatArray:
        panels, x = time_map.phase_at(times)
        left, right = time_map.edges[panels], time_map.edges[panels + 1]
        states = np.ascontiguousarray(sum_series(columns, panels, x).T)
        sines = orbit.sines(np.where(x < 0.0, left, right) + 0.5 * (right - left) * (x - np.copysign(1.0, x)))
        refine_near_poles(orbit.orbit.loop, states, sines)
        return states

    return sample, UNSEEN_DEPARTURE_FACTOR * np.array(departures)


def _states(orbit: Orbit, time_map: TimeMap, places: Iterable[tuple[int, float]]) -> FloatArray:
    rows = []
    for panel, x in places:
        state = orbit.state(time_map.theta(panel, x))
        rows.append([float(value) for value in state])
        if any(value.rel_accuracy_bits() < KNOWN_BITS and not value.rad() < KNOWN for value in state):
            raise PrecisionLostError("the variables are known to fewer digits than a double has")
    return np.array(rows)
