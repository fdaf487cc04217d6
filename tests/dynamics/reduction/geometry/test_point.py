"""A place of the loop is on the unit sphere and on its curve, in every arithmetic, to the last digits."""

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.reduction.geometry.point import (
    BALLS,
    RANGES,
    REALS,
    CurvePlace,
    LoopNumbers,
    bends_of,
    gamma_of,
    make_equator,
    place_of,
    r_over_p,
    rates_of,
    speed_factor,
)

ALPHAS = [1.25, 2.0, 3.5, 17.0]
Z, G = 0.8, 0.6


def ball_place(functions, sine, cosine, alpha):
    return place_of(functions, sine, cosine, make_equator(arb(Z), arb(G), arb(alpha)))


def reals(*numbers):
    return make_equator(*map(np.asarray, numbers))


@given(st.floats(-3.14, 3.14).filter(lambda v: abs(v) > 1e-6), st.sampled_from(ALPHAS))
def test_the_place_is_on_the_sphere_and_on_the_curve(v, alpha):
    first, second, third, c = ball_place(BALLS, *arb(v).sin_cos(), alpha)
    # Z² + G² is 1 but for their roundings. 53 bits, a few roundings each: 1e-14 is some 90 of them.
    assert abs(first**2 + second**2 + third**2 - 1) < 1e-14
    curve = first / arb(G) / (abs(third) / arb(Z)) ** arb(alpha)
    assert abs(curve - 1) < 1e-13
    assert (c * arb(v).cos() / second).contains(1)


@given(st.floats(1e-300, 3.1415926), st.sampled_from(ALPHAS))
def test_doubles_are_in_the_balls_but_for_some_roundings(v, alpha):
    sine, cosine = np.sin(np.array([v])), np.cos(np.array([v]))
    with np.errstate(all="ignore"):
        found = place_of(REALS, sine, cosine, reals(Z, G, alpha))
    with ctx.workprec(2000):
        exact = ball_place(BALLS, arb(float(sine[0])), arb(float(cosine[0])), alpha)
        for value, ball in zip(found, exact, strict=True):
            # Sine and cosine are each rounded: next to a pole or the equator one of them tells the place,
            # and between 2α and 4α roundings of the other are in log s. A power loses as many as its exponent
            # has: some 700 log₂ e · 2^-53. Doubles end at 1e-308.
            assert abs(arb(float(value[0])) - ball) < abs(ball) * 2.0**-40 + 1e-307


@pytest.mark.parametrize("alpha", ALPHAS)
def test_no_digits_are_lost_at_the_equator(alpha):
    distances = 10.0 ** -np.arange(1.0, 100.0)
    square = np.sin(distances) ** 2
    log_sine = REALS.log_sine(np.cos(distances), square)
    # With Z = 0 and G = 1, c² is R.
    found = REALS.c_squared(reals(0.0, 1.0, alpha), log_sine, square)
    with ctx.workprec(800):
        for distance, value in zip(distances, found, strict=True):
            u = arb(distance).sin() ** 2
            exact = -(arb(alpha) * (-u).log1p()).expm1() / u
            # The square, the logarithm, its multiple, expm1 and the quotient: 2^-53 each, or two of them.
            assert abs(arb(value) / exact - 1) < 8 * 2.0**-52


def test_at_the_equator_the_quotient_is_its_limit():
    *place, c = (float(each[0]) for each in place_of(REALS, np.ones(1), np.zeros(1), reals(Z, G, 3.5)))
    assert c == pytest.approx(np.sqrt(Z**2 + 3.5 * G**2), rel=1e-15)
    assert place == [G, 0.0, Z]


@given(st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 1.0), st.sampled_from(ALPHAS))
def test_the_range_holds_every_value(one, other, share, alpha):
    """Also of ranges that hold the equator, where v is π/2 - distance."""
    low, high = min(one, other), max(one, other)
    wide = arb(low).union(arb(high))
    found = ball_place(RANGES, wide.cos(), wide.sin(), alpha)
    inside = arb(low + share * (high - low))
    if inside > 0:
        values = ball_place(BALLS, inside.cos(), inside.sin(), alpha)
        assert all(each.overlaps(value) for each, value in zip(found, values, strict=True))


def curve_place(curve, v):
    sine, cosine = v.sin_cos()
    power, u = abs(sine) ** curve.beyond, cosine * cosine
    c = (curve.Z**2 + curve.first**2 * (1 - abs(sine) ** (2 * curve.alpha)) / u).sqrt()
    return CurvePlace(sine, cosine, power, sine.sgn(), c)


@given(
    st.floats(-3.0, 3.0).filter(lambda v: abs(v) > 0.1 and abs(abs(v) - 1.5708) > 0.1),
    st.sampled_from([(1.25, 1), (2, 1), (3.5, -1), (17, 1)]),
    st.booleans(),
)
def test_derivatives_and_speeds_are_those_of_the_place(v, numbers, mirrored):
    alpha, sign = numbers
    with ctx.workprec(400):
        C, v = arb("0.7"), arb(v)
        curve = LoopNumbers(arb(sign * G), arb(Z), arb(alpha), arb(alpha - 1), alpha * C, C, mirrored)
        at, h = curve_place(curve, v), arb(2) ** -80
        below, middle, above = (gamma_of(curve, curve_place(curve, v + k * h)) for k in (-1, 0, 1))
        u = at.cosine**2
        # ∫ t (1 − tu)^(α−2) dt over [0, 1], twice, by parts.
        s = 1 - u
        mean = 2 * (1 - s**curve.beyond * (1 + curve.beyond * u)) / (u * u * curve.alpha * curve.beyond)
        rates, bends = rates_of(curve, at), bends_of(curve, at, at.power / at.sine, mean)
        for low, here, high, rate, bend in zip(below, middle, above, rates, bends, strict=True):
            # Differences leave out h² times the third and the fourth derivative, which 0.1 from pole and
            # equator are below 1e9: 1e-39; second ones are rounded by 2^-400/h².
            assert abs((high - low) / (2 * h) - rate) < 1e-38
            assert abs((high - 2 * here + low) / (h * h) - bend) < 1e-38
        g1, _, g3 = middle[::-1] if mirrored else middle
        Q = curve.A * g1 * g1 + C * g3 * g3
        # With P = C g3 D/((A − C) A g1) and h − V = Q D/(2 (A − C) g1 g3).
        assert abs(speed_factor(curve, at.power) - 2 * C * g3 * g3 / (curve.A * Q)) < 1e-100
        assert abs(r_over_p(curve, at) + curve.A * g1 / (C * g3)) < 1e-100
