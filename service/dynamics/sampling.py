"""The times at which a solution is sampled."""

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.dense_output import Period
from service.dynamics.errors import DynamicsError
from service.dynamics.problem import TimeList, Times, TimeSpan

FloatArray = NDArray[np.float64]


class PeriodNeededError(DynamicsError):
    """Times were asked in periods of a motion that has none."""

    code = "period_needed"


def sample_times(times: Times, period: Period | None) -> FloatArray:
    """Return the asked times, shape (n,), each the double nearest to the exact time.

    Raises
    ------
    PeriodNeededError
        Periods are asked for and ``period`` is None.
    """
    if isinstance(times, TimeList):
        return np.array([float(t) for t in times.times])
    if isinstance(times, TimeSpan):
        start, stop = times.start, times.stop
    elif period is not None:
        start, stop = Fraction(0), times.periods * (Fraction(period.hi) + Fraction(period.lo))
    else:
        raise PeriodNeededError(
            "times in periods need a periodic motion; give start and stop", pointer="/time"
        )
    if times.samples == 1:
        return np.array([float(start)])
    step = (stop - start) / (times.samples - 1)
    # Over one denominator: a quotient of integers is rounded once, and costs a tenth of a Fraction.
    whole = start.denominator * step.denominator
    first, increment = int(start * whole), int(step * whole)
    return np.array([(first + increment * k) / whole for k in range(times.samples)])
