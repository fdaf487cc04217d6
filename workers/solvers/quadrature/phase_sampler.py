"""The six variables as a function of time, from the phase and the time map."""

import numpy as np

from workers.solvers.assembly.dense import FloatArray, Sampler
from workers.solvers.assembly.time_map import TimeMap
from workers.solvers.errors import PrecisionLostError
from workers.solvers.orbits.orbit import Orbit

KNOWN_BITS, KNOWN = 54, 2.0**-54
"""Least relative accuracy of a variable's ball, or largest radius: either will do."""


def phase_sampler(orbit: Orbit, time_map: TimeMap) -> Sampler:
    """Return the six variables as a function of the time map's own times, from 0 to its total.

    It raises PrecisionLostError where the balls of a state are wider than the rounding of doubles.
    """

    def sample(times: FloatArray) -> FloatArray:
        panels, places = time_map.phase_at(times)
        rows = []
        for panel, x in zip(panels, places, strict=True):
            state = orbit.state(time_map.theta(int(panel), float(x)))
            rows.append([float(value) for value in state])
            if any(value.rel_accuracy_bits() < KNOWN_BITS and not value.rad() < KNOWN for value in state):
                raise PrecisionLostError("the variables are known to fewer digits than a double has")
        return np.array(rows)

    return sample
