"""Sums of terms hold against evaluation: what is added as terms is added as numbers."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.exact import added_up, scaled_terms, without_zeros

FRACTIONS = st.fractions(-3, 3, max_denominator=7)
TERMS = st.lists(st.tuples(st.integers(0, 4), FRACTIONS))


def value_of(terms, x):
    return sum((coefficient * x**power for power, coefficient in terms), Fraction(0))


@given(TERMS, FRACTIONS, FRACTIONS)
def test_equal_keys_are_added_and_zeros_left_out_without_changing_the_value(terms, factor, x):
    total = added_up(terms)
    assert list(total) == list(dict.fromkeys(power for power, _ in terms))
    assert value_of(total.items(), x) == value_of(terms, x)
    assert value_of(scaled_terms(total, factor), x) == factor * value_of(terms, x)
    kept = without_zeros(total)
    assert all(kept.values())
    assert value_of(kept.items(), x) == value_of(terms, x)
