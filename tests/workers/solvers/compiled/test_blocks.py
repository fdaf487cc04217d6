"""Exact sums, and the order in which times go through their intervals."""

from fractions import Fraction

import numpy as np

from workers.solvers.compiled.workspace import sort_by_interval, two_sum


def test_a_sum_and_what_it_leaves_out_are_exact():
    draws = np.random.default_rng(1)
    for _ in range(200):
        a, b = (draws.normal(size=2) * 10.0 ** draws.integers(-20, 20, 2)).tolist()
        total, rest = two_sum(a, b)
        assert total == a + b
        assert Fraction(total) + Fraction(rest) == Fraction(a) + Fraction(b)


def test_times_are_sorted_by_the_interval_they_are_in():
    draws = np.random.default_rng(2)
    starts = np.sort(draws.uniform(0.0, 1.0, 7))
    local = draws.uniform(-0.2, 1.2, 100)
    home, order = np.empty(100, dtype=np.int64), np.empty(100, dtype=np.int64)
    begins = np.empty(8, dtype=np.uint64)
    sort_by_interval(starts, local, home, begins, order)
    assert sorted(order.tolist()) == list(range(100))
    assert begins[0] == 0
    assert begins[-1] == 100
    for n in range(7):
        # What is before all intervals belongs to the first.
        expected = np.clip(np.searchsorted(starts, local, side="right") - 1, 0, 6) == n
        assert set(order[int(begins[n]) : int(begins[n + 1])].tolist()) == set(np.flatnonzero(expected))
