"""Zeros of many functions at once, in doubles: against closed forms."""

import numpy as np

from service.dynamics.atlas.curves import zero_between

EXPECTED = np.array([2.0 ** (1 / 3), np.log(5.0), 0.3, 1.0, 0.25, 0.7, 0.6, 0.0])


def several(x):
    """A smooth one, one that grows, a steep one, a flat zero of order 9, one at a place, a jump, a pole."""
    with np.errstate(all="ignore"):
        return np.array(
            [
                x[0] ** 3 - 2.0,
                np.exp(x[1]) - 5.0,
                np.tanh(50.0 * (x[2] - 0.3)),
                (x[3] - 1.0) ** 9,
                x[4] - 0.25,
                1.0 if x[5] > 0.7 else -1e-9,
                1.0 / (x[6] - 0.6),
                np.nan,
            ]
        )


def test_zeros_are_found_to_the_last_bits():
    low, high = np.zeros(8), np.array([2.0, 2.0, 1.0, 3.0, 1.0, 1.0, 1.0, 1.0])
    found = zero_between(several, low, high)
    # Two units in the last place of numbers about 1; what has no value ends, too.
    assert (np.abs(found - EXPECTED)[:-1] < 5e-16).all()


def test_as_close_as_was_asked_and_no_closer():
    calls = []

    def value(x):
        calls.append(None)
        return np.exp(x) - 5.0

    (found,) = zero_between(value, np.array([0.0]), np.array([2.0]), 1e-3)
    assert abs(found - np.log(5.0)) < 2e-3
    # A bisection would take eleven and the two ends; NaN, alone, none at all.
    assert len(calls) < 11
    zero_between(lambda x: calls.append(None) or x * np.nan, np.array([0.0]), np.array([1.0]))
    assert len(calls) < 16
