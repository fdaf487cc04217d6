"""Numbers of twice the digits against balls of 300 bits."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from workers.solvers.compiled.doubled import arithmetic as doubled

# A few 2^-104, of the value or of 1.
ULPS = 2.0**-100
LARGEST = 2.0**-98
"""Powers lose the bits of the size of their logarithm, below 2^5 here: what the kernel's ROUNDING_RATIO
counts on."""
NUMBERS = np.random.default_rng(7).uniform([1e-3, -9.0, -1.0, -1.0], [9.0, 9.0, 1.0, 1.0], (300, 4))


def pairs():
    for a, b, u, v in NUMBERS.tolist():
        yield (a, 2.0**-54 * a * u), (b, 2.0**-54 * b * v)


def ball(value):
    return arb(value[0]) + arb(value[1])


@pytest.mark.parametrize(
    ("name", "exact"),
    [
        ("add", lambda x, y: x + y),
        ("subtract", lambda x, y: x - y),
        ("multiply", lambda x, y: x * y),
        ("divide", lambda x, y: x / y),
        ("power", lambda x, y: x**y),
    ],
)
def test_operations_keep_their_digits(name, exact):
    operation = getattr(doubled, name)
    with ctx.workprec(300):
        worst = max(float(abs(ball(operation(x, y)) / exact(ball(x), ball(y)) - 1)) for x, y in pairs())
    assert worst < (LARGEST if name == "power" else ULPS)


def test_functions_keep_their_digits():
    with ctx.workprec(300):
        for x, y in pairs():
            sine, cosine = doubled.sine_and_cosine(y)
            exact = ball(y).sin_cos()
            assert abs(ball(sine) - exact[0]) < ULPS
            assert abs(ball(cosine) - exact[1]) < ULPS
            assert abs(ball(doubled.exponential(y)) / ball(y).exp() - 1) < ULPS
            assert abs(ball(doubled.logarithm(x)) - ball(x).log()) < ULPS
            assert abs(ball(doubled.root(x)) / ball(x).sqrt() - 1) < ULPS


def test_halves_are_those_of_roots():
    with ctx.workprec(300):
        for exponent in (0.5, -0.5):
            for x, _ in pairs():
                exact = ball(x) ** arb(exponent)
                assert abs(ball(doubled.power(x, (exponent, 0.0))) / exact - 1) < ULPS


def test_what_is_undefined_is_no_number():
    assert np.isnan(doubled.logarithm((0.0, 0.0))[0])
    assert np.isnan(doubled.root((-1.0, 0.0))[0])
    assert np.isnan(doubled.power((-1.0, 0.0), (0.3, 0.0))[0])


def test_a_ball_is_rounded_twice():
    with ctx.workprec(300):
        third = arb(1) / 3
        high, low = doubled.doubled(third)
        assert high == 1 / 3
        assert abs(arb(high) + arb(low) - third) < 2.0**-107
    assert Fraction(high) != Fraction(1, 3)
