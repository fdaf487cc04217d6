"""The six variables as a function of time, from the phase and the time map."""

from collections.abc import Iterable

import numpy as np

from service.dynamics.bounds import largest
from service.dynamics.solution.dense_output import chebyshev_coefficients, chebyshev_points
from workers.solvers.assembly.dense import FloatArray, Sampler
from workers.solvers.assembly.time_map import CHECKED_POINTS, UNSEEN_DEPARTURE_FACTOR, TimeMap, sum_series
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.graded import Graded, refine_near_poles
from workers.solvers.orbits.orbit import Orbit
from workers.solvers.quadrature.ellipse import DEGREE

KNOWN_BITS, KNOWN = 54, 2.0**-54
"""Least relative accuracy of a variable's ball, or largest radius: either will do."""


def phase_sampler(orbit: Orbit, time_map: TimeMap) -> Sampler:
    """Return the six variables as a function of the time map's own times, from 0 to its total.

    It raises PrecisionLostError where the balls of a state are wider than the rounding of doubles.
    """

    def sample(times: FloatArray) -> FloatArray:
        panels, places = time_map.phase_at(times)
        return _states(orbit, time_map, zip(panels.tolist(), places.tolist(), strict=True))

    return sample


def series_sampler(orbit: Graded, time_map: TimeMap) -> tuple[Sampler, float]:
    """Return the same by series in the phase, in which everything is smooth on each panel; and its error.

    A state costs a hundred times less. Next to a pole what is small is told relative to itself. The error is
    UNSEEN_DEPARTURE_FACTOR times the largest departure between the nodes. PrecisionLostError is raised at
    once.
    """
    panels, nodes = range(len(time_map.times) - 1), chebyshev_points(DEGREE)
    series, departure = [], 0.0
    for panel in panels:
        states = _states(orbit, time_map, [(panel, x) for x in (*nodes.tolist(), *CHECKED_POINTS)])
        series.append(chebyshev_coefficients(states[: len(nodes)]))
        told = np.polynomial.chebyshev.chebval(np.array(CHECKED_POINTS), series[-1]).T
        departure = largest((departure, float(np.abs(told - states[len(nodes) :]).max())))
    columns: FloatArray = np.stack(series, axis=2)

    def sample(times: FloatArray) -> FloatArray:
        panels, x = time_map.phase_at(times)
        left, right = time_map.edges[panels], time_map.edges[panels + 1]
        states = np.ascontiguousarray(sum_series(columns, panels, x).T)
        sines = orbit.sines(np.where(x < 0.0, left, right) + 0.5 * (right - left) * (x - np.copysign(1.0, x)))
        refine_near_poles(orbit.orbit.loop, states, sines)
        return states

    return sample, UNSEEN_DEPARTURE_FACTOR * departure


def _states(orbit: Orbit, time_map: TimeMap, places: Iterable[tuple[int, float]]) -> FloatArray:
    rows = []
    for panel, x in places:
        state = orbit.state(time_map.theta(panel, x))
        rows.append([float(value) for value in state])
        if any(value.rel_accuracy_bits() < KNOWN_BITS and not value.rad() < KNOWN for value in state):
            raise PrecisionLostError("the variables are known to fewer digits than a double has")
    return np.array(rows)
