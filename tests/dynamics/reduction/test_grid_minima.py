"""What a grid shows of p²: where balls need not look for a place at which it nearly vanishes."""

from fractions import Fraction
from math import pi

import numpy as np
import pytest
from flint import arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.separatrices import are_apart, grid_minima_of
from service.dynamics.reduction.windows import REDUCTION_BITS
from tests.support.planar import body, formula

BODY = body("17/10", 1)
Q = "(A*g1^2+C*g3^2)"


def loops_of(text, *lambdas):
    with ctx.workprec(REDUCTION_BITS):
        return [make_loop(BODY, formula(text, BODY), PlanarMotion(Fraction(each))) for each in lambdas]


def place_of(loop, height):
    """Return v at a height, by halving: g2 falls as v grows."""
    low, high = 0.0, pi
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(loop.point(arb(middle)).g2) > height else (low, middle)
    return low


def test_a_simple_zero_is_passed_plainly_and_a_narrow_pair_is_not():
    for gap, is_plain in ((None, True), ("1/10^7", False), ("1/10^12", False)):
        text = f"{Q}*(g2-1/3)" if gap is None else f"{Q}*((g2-1/3)^2-{gap})"
        for loop in loops_of(text, "1/2", "2"):
            (seen,) = grid_minima_of([loop], 1)
            assert seen.passes_plainly(loop, arb(place_of(loop, 1 / 3))) == is_plain


def test_what_is_narrower_than_the_grid_bends_the_zero():
    """SecondScale the zero at 0.232 p² comes within 1e-9 of 0 once more, at 0.235, in a dent 1/100 wide."""
    (loop,) = loops_of(f"{Q}*(g2-29/125)*((g2-47/200)^2/(1/10000+(g2-47/200)^2)+1/10^9)", "1")
    (seen,) = grid_minima_of([loop], 1)
    assert not seen.passes_plainly(loop, arb(place_of(loop, 29 / 125)))


@pytest.mark.parametrize("height", [0, 1 / 50, 1 / 3, -2 / 3])
def test_a_near_rest_is_low_next_to_its_place(height):
    loops = loops_of(f"{Q}*((g2-{Fraction(height).limit_denominator(1000)})^2+1/10^9)", "1/2", "1", "2")
    for loop, seen in zip(loops, grid_minima_of(loops, 1), strict=True):
        # Half a step, and the neighbour where both are equally low.
        assert min(abs(v - place_of(loop, height)) for v in seen.lowest()) < 1.01 * pi / 256
        assert seen.is_far_at_equator == (abs(height) > 0.1)


def test_many_loops_show_what_each_shows():
    loops = loops_of(f"{Q}*(g2^2-1/2+g2^3/5)", *("1/3", "1", "3"))
    for loop, seen in zip(loops, grid_minima_of(loops, -1), strict=True):
        (own,) = grid_minima_of([loop], -1)
        assert np.array_equal(own.is_low, seen.is_low)
        assert np.array_equal(own.slopes, seen.slopes, equal_nan=True)
        assert own.is_far_at_equator == seen.is_far_at_equator


def test_places_are_apart_unless_two_are_close():
    assert are_apart([arb(1), arb("1.1"), arb(-2)])
    assert not are_apart([arb(1), arb(2), arb("1.05")])


def test_p_squared_is_that_of_the_point_to_the_last_bit():
    with ctx.workprec(REDUCTION_BITS):
        for loop in loops_of(f"{Q}*(g2^2-1/2+g2^3/5)", "1/3", "3"):
            for v in ("1/10", "1", "3/2", "3"):
                sine, cosine = (arb(1) * Fraction(v).numerator / Fraction(v).denominator).sin_cos()
                one, other = loop.radicand_from(sine, cosine), loop.point_from(sine, cosine).P
                assert (one.mid().man_exp(), one.rad().man_exp()) == (
                    other.mid().man_exp(),
                    other.rad().man_exp(),
                )
