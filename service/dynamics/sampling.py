"""The sample times of a solution, exact until they are reduced by the period.

A value belongs to the exact time that was asked: 1/3, not the double beside it; half of the true
period, not of its double. Solvers in doubles take a time as the sum of two doubles; the enclosures
take :func:`exact_instants`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.problem import TimeList, TimePeriods, Times, TimeSpan
from service.dynamics.solution.dense_output import Period, rest_of_product, split_double, two_product

FloatArray = NDArray[np.float64]

MAX_SAMPLES_CACHED = 4096
"""Largest number of samples for which the numbers of periods are cached."""
_WHOLE_DOUBLES = 2**53
"""Every integer up to it is a double."""


class PeriodNeededError(DynamicsError):
    """The times are in periods, and the motion has none."""

    code = "period_needed"


@dataclass(frozen=True, slots=True)
class SampleTimes:
    """Times as sums ``doubles`` + ``low_parts``, shape (n,) each."""

    doubles: FloatArray
    """Each the double nearest to the exact time: what is shown."""
    low_parts: FloatArray
    """Exact times minus these, rounded to doubles; 0 where a time is a double."""


def sample_times(times: Times, period: Period | None) -> SampleTimes:
    """Return the requested times; for times in periods, multiples of the sum hi + lo.

    Raises
    ------
    PeriodNeededError
        The times are in periods and ``period`` is None.
    """
    if not isinstance(times, TimePeriods):
        return _in_doubles(times)
    if period is None:
        raise PeriodNeededError(
            "times in periods need a periodic motion; give start and stop", pointer="/time"
        )
    turns, high, low = _turns(times)
    return _multiples(turns, high, low, period.hi, period.lo)


def sample_times_of_each(times: TimePeriods, periods: FloatArray) -> SampleTimes:
    """Return the requested times for many periods, shape (periods,): arrays of shape (periods, samples).

    Each row is, to the last bit, what :func:`sample_times` returns for its period alone.
    """
    turns, high, low = _turns(times)
    return _multiples(turns, high, low, periods[:, None], 0.0)


_Turns = tuple[SampleTimes, FloatArray, FloatArray]
"""Numbers of periods, and two halves of their doubles: see :func:`.split_double`."""


def _turns(times: TimePeriods) -> _Turns:
    """Return the numbers of periods; lists and sweeps ask for the same ones with each problem."""
    if times.samples <= MAX_SAMPLES_CACHED:
        return _few_turns(times)
    found = _in_doubles(times)
    return found, *split_double(found.doubles)


@lru_cache(maxsize=16)
def _few_turns(times: TimePeriods) -> _Turns:
    found = _in_doubles(times)
    high, low = split_double(found.doubles)
    # Every caller has the same arrays.
    for each in (found.doubles, found.low_parts, high, low):
        each.flags.writeable = False
    return found, high, low


def _multiples(
    turns: SampleTimes, high: FloatArray, low: FloatArray, hi: FloatArray | float, lo: float
) -> SampleTimes:
    """Return so many times the periods hi + lo."""
    product = turns.doubles * hi
    rest = rest_of_product(product, high, low, hi) + (turns.doubles * lo + turns.low_parts * hi)
    # The product is the larger part: the difference is exact (Dekker's sum).
    doubles = product + rest
    return SampleTimes(doubles, rest - (doubles - product))


def exact_instants(times: Times) -> list[Fraction]:
    """Return the exact requested times; for times in periods, the exact numbers of periods."""
    if isinstance(times, TimeList):
        return list(times.times)
    first, step, whole = _progression(times)
    return [Fraction(first + step * k, whole) for k in range(times.samples)]


def _progression(times: TimeSpan | TimePeriods) -> tuple[int, int, int]:
    """Return integers (first, step, whole): the k-th of equidistant times is (first + step k)/whole."""
    start, stop = (
        (Fraction(0), times.periods) if isinstance(times, TimePeriods) else (times.start, times.stop)
    )
    step = (stop - start) / max(times.samples - 1, 1)
    whole = start.denominator * step.denominator
    return int(start * whole), int(step * whole), whole


def _in_doubles(times: Times) -> SampleTimes:
    if isinstance(times, TimeList):
        return _split((t.numerator, t.denominator) for t in times.times)
    first, step, whole = _progression(times)
    last = first + step * (times.samples - 1)
    if max(abs(first), abs(last), whole) > _WHOLE_DOUBLES:
        return _split((first + step * k, whole) for k in range(times.samples))
    numerators = (first + step * np.arange(times.samples)).astype(np.float64)
    doubles = numerators / whole
    # The remainder of a division of doubles is a double.
    product, rest = two_product(doubles, float(whole))
    return SampleTimes(doubles, ((numerators - product) - rest) / whole)


def _split(ratios: Iterable[tuple[int, int]]) -> SampleTimes:
    """Return quotients of integers, of any size, as sums of two doubles."""
    doubles, low_parts = list[float](), list[float]()
    for numerator, denominator in ratios:
        # Python divides integers with one rounding.
        double = numerator / denominator
        above, below = double.as_integer_ratio()
        doubles.append(double)
        low_parts.append((numerator * below - above * denominator) / (denominator * below))
    return SampleTimes(np.array(doubles), np.array(low_parts))
