"""A steady rotation as a function of time: a constant."""

import numpy as np
from numpy.typing import NDArray

from service.dynamics.classical.placed import Placed
from service.dynamics.solution.dense_output import DenseOutput

FloatArray = NDArray[np.float64]


def constant(placed: Placed, span: tuple[float, float]) -> DenseOutput:
    """Return the motion over a span of times; each variable is the double nearest to its value."""
    state = np.array([float(x) for x in (*placed.start.omega, *placed.start.gamma)])
    rounding = float(np.spacing(np.abs(state).max()))
    first, last = span
    breaks = np.array([first, last if last > first else first + 1.0])
    return DenseOutput(("p", "q", "r", "g1", "g2", "g3"), breaks, state.reshape(1, 1, 6), None, rounding)
