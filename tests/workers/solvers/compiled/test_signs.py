"""Signs along panels: read from a series as far as its error allows, and never against each other."""

import numpy as np
import pytest

from workers.solvers.compiled.windows.signs import (
    ELLIPSE,
    NODES,
    SLOPE_TAIL,
    VALUE_TAIL,
    is_certain,
    nodes,
    read_panel,
    to_series,
    value_and_slope,
)

X = np.linspace(-1.0, 1.0, 501)


def read(series, error, *, sign=0.0):
    """Return the number of zeros between the ends of one panel from distance 1 to 2 (−1: left open)."""
    state, brackets = np.array([sign, 0.0, 0.0, 0.0]), np.empty((16, 4))
    found = read_panel(series, error, error * NODES**2, 1.0, 2.0, 1.0, state, brackets, 0)
    return found, state, brackets


@pytest.mark.parametrize("pole", [1.2j, 2.5 + 0j, -2.2 + 0.3j])
def test_an_interpolant_departs_by_no_more_than_is_said(pole):
    # 1/(x − pole) is analytic in the ellipse only if the pole is beyond it.
    semi = 0.5 * (ELLIPSE + 1.0 / ELLIPSE), 0.5 * (ELLIPSE - 1.0 / ELLIPSE)
    pole = pole * 2.2
    assert (pole.real / semi[0]) ** 2 + (pole.imag / semi[1]) ** 2 > 1.0
    edge = np.exp(2j * np.pi * np.arange(400) / 400)
    edge = semi[0] * edge.real + 1j * semi[1] * edge.imag
    size = np.abs(1.0 / (edge - pole) + 1.0 / pole).max()
    series = to_series() @ (1.0 / (nodes() - pole)).real
    values = np.array([value_and_slope(series, x) for x in X])
    assert np.abs(values[:, 0] - (1.0 / (X - pole)).real).max() <= VALUE_TAIL * size
    assert np.abs(values[:, 1] + (1.0 / (X - pole) ** 2).real).max() <= SLOPE_TAIL * size


def test_a_series_is_summed_as_numpy_does():
    series = np.random.default_rng(3).normal(size=NODES)
    slopes = np.polynomial.chebyshev.chebder(series)
    for x in X[::50]:
        value, slope = value_and_slope(series, x)
        # Some ten roundings of numbers of size NODES², the largest slope of a polynomial of that degree.
        assert abs(value - np.polynomial.chebyshev.chebval(x, series)) < 1e-13
        assert abs(slope - np.polynomial.chebyshev.chebval(x, slopes)) < 1e-11


def test_a_simple_zero_is_bracketed():
    series = np.zeros(NODES)
    series[:2] = -0.3, 1.0
    # Before it F is negative, as the last certain sign says.
    found, _, brackets = read(series, 1e-6, sign=-1.0)
    assert found == 1
    assert brackets[0, 0] < 1.0 + 0.5 * 1.3 < brackets[0, 2]


def test_a_double_zero_is_left_open():
    series = np.zeros(NODES)
    series[0], series[2] = 0.5, 0.5
    assert read(series, 1e-6)[0] == -1


def test_a_sign_without_zeros_is_told():
    series = np.zeros(NODES)
    series[:2] = -2.0, 1.0
    found, state, _ = read(series, 0.5)
    assert (found, state[0]) == (0, -1.0)


def test_signs_that_change_without_monotony_contradict_each_other():
    state, brackets = np.array([1.0, 0.0, 0.5, 1.0]), np.empty((16, 4))
    assert is_certain(state, -1.0, 1.0, 1.0, 2.0, 1.0, brackets, 0) == -1
