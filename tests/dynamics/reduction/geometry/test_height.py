import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.reduction.geometry.height import (
    c_squared_ball,
    c_squared_range,
    log_sine_ball,
    log_sine_real,
    numerator_real,
)

ALPHAS = [1.25, 2.0, 3.5, 17.0]
SHARE = 0.36
"""G²; Z² = 1 − G²."""


def c_squared(v, alpha):
    sine, cosine = arb(v).sin_cos()
    square = cosine * cosine
    return c_squared_ball(
        arb(1) - arb(SHARE), arb(SHARE), arb(2 * alpha), log_sine_ball(sine, square), square
    )


@given(st.floats(1e-6, 1.57), st.sampled_from(ALPHAS))
def test_the_point_is_on_the_unit_sphere(v, alpha):
    sine, cosine = arb(v).sin_cos()
    g1_squared = arb(SHARE) * (2 * arb(alpha) * sine.log()).exp()
    g3_squared = (arb(1) - arb(SHARE)) * sine * sine
    # 53 bits, a few roundings each: 1e-14 is some 90 of them.
    assert abs(g1_squared + g3_squared + c_squared(v, alpha) * cosine * cosine - 1) < 1e-14


@pytest.mark.parametrize("alpha", ALPHAS)
def test_no_digits_are_lost_at_the_equator(alpha):
    distances = 10.0 ** -np.arange(1.0, 100.0)
    cosine = np.sin(distances)
    square = cosine * cosine
    found = numerator_real(alpha, log_sine_real(np.cos(distances), square)) / square
    with ctx.workprec(800):
        for distance, value in zip(distances, found, strict=True):
            u = arb(distance).sin() ** 2
            exact = -(arb(alpha) * (-u).log1p()).expm1() / u
            # The square, the logarithm, its multiple, expm1 and the quotient: 2^-53 each, or two of them.
            assert abs(arb(value) / exact - 1) < 8 * 2.0**-52


@given(st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 1.0), st.sampled_from(ALPHAS))
def test_the_range_holds_every_value(one, other, share, alpha):
    low, high = min(one, other), max(one, other)
    near = (arb(low).sin() ** 2).union(arb(high).sin() ** 2)
    found = c_squared_range(
        arb(1) - arb(SHARE), arb(SHARE), arb(alpha), log_sine_ball((1 - near).sqrt(), near), near
    )
    distance = low + share * (high - low)
    inside = arb(distance).sin() ** 2
    if inside > 0:
        value = c_squared_ball(arb(1) - arb(SHARE), arb(SHARE), arb(2 * alpha), (-inside).log1p() / 2, inside)
        assert found.overlaps(value)
