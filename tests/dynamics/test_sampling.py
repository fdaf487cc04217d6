from fractions import Fraction

import pytest

from service.dynamics.problem import TimeList, TimePeriods, TimeSpan
from service.dynamics.sampling import PeriodNeededError, sample_times
from service.dynamics.solution.dense_output import Period


def test_a_span_has_both_ends_and_no_accumulated_rounding():
    times = sample_times(TimeSpan(Fraction(0), Fraction(1), 11), None).doubles
    assert times.tolist() == [k / 10 for k in range(11)]  # each the double nearest to k/10


def test_one_sample_is_the_start():
    assert sample_times(TimeSpan(Fraction(3), Fraction(5), 1), None).doubles.tolist() == [3.0]


def test_listed_times_keep_their_order():
    assert sample_times(TimeList((Fraction(2), Fraction(-1))), None).doubles.tolist() == [2.0, -1.0]


def test_periods_use_both_parts_of_the_period():
    # hi alone would give 2^53; the low part is half of its ulp, ten thousand times.
    period = Period(1.0, 2.0**-54, 0.0)
    times = sample_times(TimePeriods(Fraction(2**53), 2), period).doubles
    assert times.tolist() == [0.0, float(2**53 + Fraction(1, 2))]
    times = sample_times(TimePeriods(Fraction(2**54), 2), period).doubles
    assert times[1] == float(2**54 + 1)


def test_periods_of_a_motion_without_one_are_refused():
    with pytest.raises(PeriodNeededError, match="give start and stop"):
        sample_times(TimePeriods(Fraction(1), 2), None)
