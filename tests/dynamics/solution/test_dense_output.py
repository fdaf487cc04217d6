from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import chebyshev

from service.dynamics.solution.dense_output import (
    Advance,
    DenseOutput,
    OutsideHorizonError,
    Period,
    chebyshev_coefficients,
    chebyshev_points,
    reduce_time,
    split_time,
)

ULP = 2.0**-52


def dense(function, breaks, degree, period=None, error=0.0) -> DenseOutput:
    """Interpolate ``function`` of times, which returns (times, columns)."""
    x = chebyshev_points(degree)
    pieces = [
        chebyshev_coefficients(function(left + (right - left) * (1 + x) / 2))
        for left, right in pairwise(breaks)
    ]
    return DenseOutput(("a", "b"), np.array(breaks, dtype=float), np.array(pieces), period, error)


def waves(times):
    return np.stack([np.sin(times), np.cos(2 * times)], axis=-1)


@pytest.mark.parametrize("degree", [1, 2, 7, 16, 64, 200])
def test_points_are_symmetric_extrema(degree):
    x = chebyshev_points(degree)
    assert x[0] == 1.0
    assert x[-1] == -1.0
    assert np.all(x == -x[::-1])
    # The extrema of T_n, sine's rounding times its slope.
    assert np.abs(np.cos(degree * np.arccos(x)) - (-1.0) ** np.arange(degree + 1)).max() <= 1e-15 * degree**2


@pytest.mark.parametrize("degree", [1, 2, 7, 16, 64, 200])
def test_coefficients_give_the_values_back(degree):
    values = np.random.default_rng(1).standard_normal((degree + 1, 3))
    series = chebyshev_coefficients(values)
    back = chebyshev.chebval(chebyshev_points(degree), series).T
    # Near the ends T_n has the slope n², by which the rounding of a point is seen; 8 ulp for the sums.
    assert np.abs(back - values).max() <= ULP * (8 + degree**2)


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=30))
def test_a_polynomial_is_its_own_series(series):
    degree = len(series) - 1
    values = chebyshev.chebval(chebyshev_points(degree), series)
    # Both sums have up to 30 terms of size one.
    assert np.abs(chebyshev_coefficients(values) - series).max() <= 60 * ULP


def test_values_between_the_breaks_are_those_of_the_function():
    breaks = [-1.0, 0.5, 0.75, 3.0]
    solution = dense(waves, breaks, 30)
    times = np.concatenate([np.linspace(-1.0, 3.0, 401), breaks])
    # Truncation at degree 30 over 2.25 is below 1e-20; sums of size one are rounded.
    assert np.abs(solution(times) - waves(times)).max() <= 8 * ULP


def test_both_sides_of_a_break_belong_to_their_own_piece():
    coefficients = np.array([[[1.0], [0.0]], [[2.0], [0.0]]])
    steps = DenseOutput(("a",), np.array([0.0, 1.0, 2.0]), coefficients, None, 0.0)
    times = np.array([0.0, np.nextafter(1.0, 0.0), 1.0, np.nextafter(1.0, 2.0), 2.0])
    assert steps(times)[:, 0].tolist() == [1.0, 1.0, 2.0, 2.0, 2.0]


def test_the_digits_of_a_time_do_not_depend_on_the_others():
    solution = dense(waves, [-1.0, 0.5, 0.75, 3.0], 30)
    times = np.random.default_rng(5).uniform(-1.0, 3.0, 5000)
    together = solution(times)
    # More than two blocks; the single ones are at both sides of where a block ends.
    for k in (0, 1, 2047, 2048, 4095, 4096, 4999):
        assert np.array_equal(solution(times[k : k + 1])[0], together[k])
    assert np.array_equal(solution(times[::-1]), together[::-1])


@pytest.mark.parametrize("time", [-1e-300, np.nextafter(2.0, 3.0), np.inf, np.nan])
def test_times_outside_are_refused(time):
    solution = dense(waves, [0.0, 2.0], 20)
    with pytest.raises(OutsideHorizonError, match="where this solution was computed"):
        solution(np.array([1.0, time]))


def test_no_times_give_no_rows():
    assert dense(waves, [0.0, 2.0], 20)(np.zeros(0)).shape == (0, 2)


periods = st.floats(1e-3, 1e3).flatmap(
    lambda hi: st.floats(-0.5, 0.5).map(lambda part: Period(hi, part * float(np.spacing(hi)), 0.0))
)


@given(periods, st.integers(-(2**52), 2**52), st.floats(0, 1))
def test_reduced_times_are_the_exact_remainders(period, turns, part):
    """Up to 2^52 periods no digit is lost beyond the one rounding of the result (and of n lo)."""
    exact_period = Fraction(period.hi) + Fraction(period.lo)
    time = float(turns * exact_period + Fraction(part) * exact_period)
    local = Fraction(float(reduce_time(np.array([time]), period)[0]))
    assert 0 <= local <= Fraction(period.hi)
    gap = (local - Fraction(time)) % exact_period
    gap = min(gap, exact_period - gap)
    # n lo is a product and a difference, each rounded: 2 ulp of at most 2^52 · ulp(hi)/2 ~ hi/2.
    assert gap <= 4 * Fraction(ULP) * Fraction(period.hi)


def test_error_stays_below_1e_15_after_many_periods():
    """2π to a hundred bits: sin and cos come back after 1e8 periods as after none."""
    lo = 2.4492935982947064e-16
    turn = Period(2 * np.pi, lo, 0.0)
    breaks = np.linspace(0.0, turn.hi, 5).tolist()
    solution = dense(waves, breaks, 30, turn)
    exact = Fraction(turn.hi) + Fraction(lo)
    times, expected = [], []
    for turns in (0, 1, 10**5, 10**8, -(10**8)):
        for phase in (0.1, 1.0, 3.0, 6.0):
            time = float(turns * exact + Fraction(phase))
            times.append(time)
            expected.append(float(Fraction(time) - turns * exact))
    values = waves(np.array(expected))
    assert np.abs(solution(np.array(times)) - values).max() <= 8 * ULP


def test_error_at_adds_rounding_and_what_the_phase_does():
    plain = dense(waves, [0.0, 2.0], 20, error=1e-12)
    assert 1e-12 < plain.error_at(np.array([1.0])) < 1.01e-12
    assert plain.error_at(np.zeros(0)) == 1e-12
    turn = Period(2 * np.pi, 2.4492935982947064e-16, 1e-12)
    solution = dense(waves, np.linspace(0.0, turn.hi, 5).tolist(), 30, turn)
    early, late = (solution.error_at(np.array([0.1 + n * turn.hi])) for n in (0, 1000))
    # sin moves by cos(0.1) = 0.995 of the phase: at most 1.6 % of the period's error, then 1000 times it.
    assert early < 3e-14
    assert late == pytest.approx(0.995e-9, rel=1e-3)


@given(st.floats(-1, 1), st.floats(0, 20), st.floats(0, 6.28))
def test_a_phase_that_is_lost_is_claimed_however_far_it_is(part, phase, time):
    """Whatever the phase is within its bound, even after whole periods: the claim covers the difference."""
    turn = Period(2 * np.pi, 2.4492935982947064e-16, phase / 1000)
    solution = dense(waves, np.linspace(0.0, turn.hi, 5).tolist(), 30, turn)
    late = np.array([time + 1000 * turn.hi])
    there = waves(late + part * phase)
    claimed = solution.errors_at(late)
    # 1000 turns as a double are off by roundings of 6000, and the series by a few.
    allowed = np.array(list(claimed.values())) + 8 * ULP * 1000 * turn.hi
    assert (np.abs(there - solution(late)) <= allowed).all()
    # Not beyond the range, of which the coefficients tell a bound.
    assert max(claimed.values()) <= 4


@given(st.floats(1e-3, 1e3), st.integers(-(10**6), 10**6))
def test_claims_grow_where_no_double_counts_the_periods(hi, offset):
    """A period known exactly, and so many of them that n is no double: the state is any on the orbit."""
    period = Period(hi, 0.0, 0.0)
    scale = 2 * np.pi / hi

    def columns(times):
        return np.stack([np.sin(scale * times), np.cos(scale * times)], axis=-1)

    solution = dense(columns, np.linspace(0.0, hi, 5).tolist(), 30, period)
    for turns in (2**51, 2**53, 2**57):
        time = float((turns + offset) * Fraction(hi) + Fraction(hi) / 3)
        exact = columns(np.array([float(Fraction(time) % Fraction(hi))]))
        found, claimed = solution(np.array([time]))[0], solution.errors_at(np.array([time]))
        # The reference: its time is rounded once.
        assert (np.abs(found - exact[0]) <= np.array(list(claimed.values())) + 8 * ULP).all()
        # Below 2^52 as sharp as ever, beyond never above the range.
        assert max(claimed.values()) <= (1e-13 if turns < 2**52 else 4)


def climbing(advance: Advance, error: float = 0.0) -> DenseOutput:
    """sin t, and t itself in parts of ``advance`` per turn."""
    turn = Period(2 * np.pi, 2.4492935982947064e-16, error)

    def columns(times):
        return np.stack([np.sin(times), advance.hi * times / (2 * np.pi)], axis=-1)

    solution = dense(columns, np.linspace(0.0, turn.hi, 5).tolist(), 30, turn)
    return replace(solution, advances={"b": advance}, errors={"b": 1e-12})


@given(st.integers(-(2**40), 2**40), st.floats(0.01, 0.99))
def test_a_column_that_grows_does_so_by_its_advance(turns, part):
    solution = climbing(Advance(0.7, 3e-17, 0.0))
    exact = Fraction(solution.period.hi) + Fraction(solution.period.lo)
    time = float((turns + Fraction(part)) * exact)
    expected = Fraction(time) / exact * (Fraction(0.7) + Fraction(3e-17))
    periodic, grown = solution(np.array([time]))[0]
    # The rounding of the sum, and of the time within the period.
    assert abs(Fraction(float(grown)) - expected) <= Fraction(ULP) * (abs(expected) + 8)
    # The other column does not grow: its series has errors of a few roundings, and the time within the period
    # that of the next test but one, with a slope of 1 at most.
    assert abs(periodic - np.sin(float(Fraction(time) - turns * exact))) <= (8 + 4 * 2 * np.pi) * ULP


def test_a_column_that_grows_has_no_jump_between_periods():
    solution = climbing(Advance(0.7))
    turn = solution.period.hi
    for time in (-turn, 0.0, turn, 5 * turn):
        around = solution(np.array([np.nextafter(time, -np.inf), time, np.nextafter(time, np.inf)]))[:, 1]
        # The rounding of the value, and of the time that is next to it.
        assert np.ptp(around) <= 8 * ULP * max(1.0, abs(time) / turn)


@given(st.integers(-(2**52), 2**52), st.floats(0, 1))
def test_the_turns_that_passed_are_told(turns, part):
    period = Period(2 * np.pi, 2.4492935982947064e-16, 0.0)
    time = float((turns + Fraction(part)) * (Fraction(period.hi) + Fraction(period.lo)))
    local, passed = split_time(np.array([time]), period)
    back = Fraction(float(passed[0])) * (Fraction(period.hi) + Fraction(period.lo)) + Fraction(
        float(local[0])
    )
    # As in reduce_time: rounded once, and n lo.
    assert abs(back - Fraction(time)) <= 4 * Fraction(ULP) * Fraction(period.hi)


def test_columns_have_errors_of_their_own():
    solution = climbing(Advance(0.7, 0.0, 1e-11))
    first, late = (solution.errors_at(np.array([0.1 + n * 2 * np.pi])) for n in (0, 1000))
    # What is given, and the rounding of values and times of size one.
    assert first["a"] <= 8 * 2 * np.pi * ULP
    assert first["b"] == pytest.approx(1e-12, rel=1e-2)
    assert late["a"] == pytest.approx(first["a"], rel=1e-2)
    # The advance's error once for every period.
    assert late["b"] == pytest.approx(1e-8, rel=1e-3)
    assert solution.error_at(np.array([0.1])) == first["b"]
    # The error of the period does to a column what its slope makes of it.
    slow = climbing(Advance(0.7), 1e-12).errors_at(np.array([0.1 + 1000 * 2 * np.pi]))
    assert slow["b"] == pytest.approx(1e-9 * 0.7 / (2 * np.pi), rel=2e-2)


def test_a_column_asked_alone_has_its_numbers_and_errors():
    both = dense(waves, [0.0, 1.0, 2.0], 20, Period(2.0, 0.0, 1e-12), 1e-13)
    both = replace(both, errors={"b": 1e-10}, advances={"b": Advance(0.5, 0.0, 1e-15)})
    times = np.array([0.3, 7.9, -1e6])
    for k, name in enumerate(("a", "b")):
        alone = both.only([name])
        assert alone.columns == (name,)
        assert np.array_equal(alone(times)[:, 0], both(times)[:, k])
        assert alone.errors_at(times) == {name: both.errors_at(times)[name]}
    assert np.array_equal(both.only(("b", "a"))(times), both(times)[:, ::-1])
    assert both.only(())(times).shape == (3, 0)
