"""The compiled evaluation of a stored solution: the bits of its own."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.solution.dense_output import Advance, DenseOutput, OutsideHorizonError, Period
from tests.support.witnesses.compiled_evaluation import evaluate

BREAKS = np.array([0.0, 0.2, 0.25, 0.9, 1.7, 2.0])
PERIOD = Period(2.0, 3e-17, 1e-15)


def stored(degree: int, columns: int, period: Period | None = PERIOD) -> DenseOutput:
    """Return series of random coefficients, some of them zero."""
    rng = np.random.default_rng(degree)
    coefficients = rng.standard_normal((len(BREAKS) - 1, degree + 1, columns))
    coefficients[:, :, -1] *= rng.integers(0, 2, degree + 1)
    return DenseOutput(tuple("abcdef"[:columns]), BREAKS, coefficients, period, 0.0)


def bits(values):
    """Tell zeros of either sign, and all else, apart."""
    return np.ascontiguousarray(values).tobytes()


# The first call may compile.
@settings(deadline=None)
@given(
    st.integers(0, 23),
    st.integers(1, 6),
    st.lists(st.floats(-1e15, 1e15) | st.sampled_from(BREAKS.tolist()), max_size=20),
)
def test_every_bit_is_that_of_the_stored_solution(degree, columns, times):
    dense = stored(degree, columns)
    assert bits(evaluate(dense, np.array(times))) == bits(dense(np.array(times)))


def test_many_times_in_any_order_are_evaluated_as_single_ones():
    dense = stored(20, 6)
    # More than two blocks of 1024.
    times = np.random.default_rng(1).uniform(-1e6, 1e6, 3000)
    assert bits(evaluate(dense, times)) == bits(dense(times))


def test_columns_that_grow_do_so_by_their_advance():
    dense = replace(stored(5, 2), advances={"b": Advance(0.5, 1e-17)})
    times = np.array([0.3, 4e9, -1e6])
    assert bits(evaluate(dense, times)) == bits(dense(times))


def test_columns_can_be_asked_for_alone():
    dense, times = stored(20, 6), np.linspace(-3.0, 50.0, 200)
    assert bits(evaluate(dense.only("be"), times)) == bits(dense(times)[:, [1, 4]])


def test_a_motion_that_is_not_periodic_is_evaluated_within_its_breaks():
    dense = stored(9, 3, None)
    times = np.concatenate([BREAKS, np.linspace(0.0, 2.0, 50)])
    assert bits(evaluate(dense, times)) == bits(dense(times))
    for outside in (-1e-300, 2.5, np.nan):
        with pytest.raises(OutsideHorizonError, match="where this solution was computed"):
            evaluate(dense, np.array([1.0, outside]))


def test_no_times_give_no_rows():
    assert evaluate(stored(3, 2), np.zeros(0)).shape == (0, 2)
