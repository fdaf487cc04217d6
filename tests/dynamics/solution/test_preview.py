"""Previews: the told deviation is a bound, hardly above what there is, and few points are enough."""

import math
from itertools import pairwise

import numpy as np
import pytest

from service.dynamics.solution.dense_output import (
    Advance,
    DenseOutput,
    Period,
    chebyshev_coefficients,
    chebyshev_points,
)
from service.dynamics.solution.preview import PIXEL_SHARE, deviation, preview_times

ERROR = 1e-12


def interpolated(functions, breaks, period=None, **further):
    """Return the dense output of some functions of time, to within rounding."""
    middle, half = (breaks[1:] + breaks[:-1]) / 2, np.diff(breaks) / 2
    pieces = [
        chebyshev_coefficients(np.stack([f(m + h * chebyshev_points(24)) for f in functions], axis=1))
        for m, h in zip(middle, half, strict=True)
    ]
    names = tuple(f"f{k}" for k in range(len(functions)))
    return DenseOutput(names, breaks, np.array(pieces), period, ERROR, **further)


def narrow(time):
    """A pulse whose width is a fiftieth of the whole."""
    return 1.0 / (1.0 + ((time - 0.6) / 0.02) ** 2)


WAVES = interpolated(
    [np.cos, lambda t: np.sin(2 * t)], np.linspace(0, 2 * math.pi, 9), Period(2 * math.pi, 0.0, 1e-15)
)
PULSE = interpolated([narrow, lambda t: 0 * t + 3.0], np.linspace(0.0, 1.0, 60))
GROWING = interpolated(
    [lambda t: t + 0.1 * np.sin(t)], np.linspace(0, 2 * math.pi, 9), Period(2 * math.pi, 0.0, 1e-15),
    advances={"f0": Advance(2 * math.pi, 0.0, 0.0)},
)  # fmt: skip
LINE = interpolated([lambda t: 3 * t - 1], np.linspace(0.0, 1.0, 3))


def columns_of(dense):
    return lambda times: dict(zip(dense.columns, dense(times).T, strict=True))


def told(dense, times):
    return deviation(dense, {name: (name,) for name in dense.columns}, times, columns_of(dense))


def seen(dense, times):
    """The largest difference at very many times, as a share of the range."""
    fine = np.linspace(times[0], times[-1], 400_001)
    curve, corners = dense(fine), dense(times)
    shares = [
        np.abs(curve[:, k] - np.interp(fine, times, corners[:, k])).max() / extent
        for k in range(curve.shape[1])
        if (extent := np.ptp(curve[:, k])) > 1e-9
    ]
    return max(shares, default=0.0)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("count", [2, 3, 40, 200, 1000])
@pytest.mark.parametrize(
    ("dense", "start", "stop"),
    [(WAVES, 0.0, 2 * math.pi), (WAVES, -1.0, 20.0), (PULSE, 0.0, 1.0), (PULSE, 0.3, 0.59),
     (GROWING, 0.0, 40.0), (LINE, 0.0, 1.0)],
)  # fmt: skip
def test_the_told_deviation_is_a_bound_and_hardly_more(dense, start, stop, count):
    times = preview_times(dense, start, stop, count)
    assert (len(times), times[0], times[-1]) == (count, start, stop)
    assert (np.diff(times) >= 0).all()
    bound, found = told(dense, times), seen(dense, times)
    # Rounding of the values, some ulp of them, is no part of the theorem.
    assert found <= bound + 1e-13
    # Checks at a sixteenth of a distance leave 1/256 of its own error open, times what the bound of f''
    # exceeds its largest value by: at most 2 · 23 in a piece of degree 24, whose f'' varies, hence 128 here.
    assert bound <= 1.5 * found + 1e-12


@pytest.mark.parametrize(
    ("dense", "start", "stop"), [(WAVES, 0.0, 2 * math.pi), (WAVES, 1.0, 13.0), (PULSE, 0.0, 1.0)]
)
def test_two_hundred_points_are_less_than_a_pixel_off(dense, start, stop):
    times = preview_times(dense, start, stop, 200)
    assert told(dense, times) < PIXEL_SHARE


def test_points_are_where_the_curve_is_bent():
    times = preview_times(PULSE, 0.0, 1.0, 200)
    even = np.linspace(0.0, 1.0, 200)
    # The error of n equal steps is h²/8 max|f''|, that of steps by the curvature (∫√|f''|)²/8n²: for a
    # pulse of this width a twentieth of it, and a share of even steps costs a little.
    assert told(PULSE, times) < told(PULSE, even) / 10
    assert np.count_nonzero(np.abs(times - 0.6) < 0.06) > 100


def test_twice_as_many_points_are_four_times_as_near():
    errors = [told(WAVES, preview_times(WAVES, 0.0, 2 * math.pi, count)) for count in (101, 201, 401)]
    for coarse, fine in pairwise(errors):
        # Second order; the places of the nodes of f'' leave some per cent.
        assert coarse / fine == pytest.approx(4.0, rel=0.15)


def test_of_more_periods_than_can_be_followed_nothing_is_told():
    assert told(WAVES, preview_times(WAVES, 0.0, 1e9, 200)) == 1.0


def test_a_point_has_no_deviation():
    times = preview_times(WAVES, 2.0, 2.0, 5)
    assert set(times) == {2.0}
    assert told(WAVES, times) == 0.0
