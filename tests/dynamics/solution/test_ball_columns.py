"""Balls as decimals, and as columns of doubles."""

from fractions import Fraction

import pytest
from flint import arb, ctx, fmpq
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.solution.dense_output import as_decimals, join, split
from tests.support.effort import examples


def exactly(value: arb) -> Fraction:
    mantissa, exponent = value.man_exp()
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


@given(st.integers(-(10**40), 10**40), st.integers(-200, 200), st.integers(0, 10**6), st.integers(-250, 100))
@settings(max_examples=examples(50, 150), deadline=None)
def test_the_decimals_contain_the_ball(mantissa, exponent, radius, radius_exponent):
    with ctx.workprec(256):
        ball = arb(arb(mantissa) * arb(2) ** exponent, (arb(radius) * arb(2) ** radius_exponent).upper())
    value, spread = (Fraction(text) for text in as_decimals(ball))
    middle, half = exactly(ball.mid()), exactly(ball.rad())
    assert abs(value - middle) + half <= spread
    # Three digits of the radius: rounding up and the rounded value add 2 % at most.
    assert spread <= half * Fraction(51, 50) or half == 0


@pytest.mark.parametrize(
    ("ball", "expected"),
    [
        (arb(0), ("0", "0")),
        (arb("0.5"), ("0.5", "0")),
        (arb(-3) / 4, ("-0.75", "0")),
        (arb(12), ("12", "0")),
    ],
)
def test_short_exact_numbers_are_written_in_full(ball, expected):
    assert as_decimals(ball) == expected


def test_what_is_not_finite_has_no_decimals():
    with pytest.raises(ValueError, match="not finite"):
        as_decimals(arb("nan"))


@given(st.integers(-(10**40), 10**40), st.integers(0, 10**6), st.integers(2, 7))
def test_parts_in_doubles_are_the_ball(numerator, width, parts):
    with ctx.workprec(400):
        ball = arb(fmpq(numerator, 3**60), arb(width) * arb(2) ** -300)
        doubles, radius = split(ball, parts)
        assert len(doubles) == parts
    with ctx.workprec(1200):
        assert join(doubles, radius).contains(ball)
        # Each double takes 53 bits: what is left is beyond the last, or the ball's own radius.
        assert (
            radius <= float(abs(ball).upper()) * 2.0 ** (1 - 53 * parts) + 1.001 * float(ball.rad()) + 1e-300
        )
