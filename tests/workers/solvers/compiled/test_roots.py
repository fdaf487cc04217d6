"""Rational potentials of bodies with A = 2C: the radicand, its roots and the period."""

import math
from fractions import Fraction

import pytest
from flint import arb, ctx, fmpq

from service.dynamics.problem import PlanarMotion
from tests.support.planar import body, formula
from workers.solvers.compiled.evaluation.curve import factor_by_roots
from workers.solvers.compiled.frame import make_frame
from workers.solvers.compiled.rational import find_stretch, period_of_x, rational_orbit, rational_radicand

DOUBLE = body(2, 1)
ONE = PlanarMotion(Fraction(1))


def test_the_radicand_is_that_of_the_potential():
    # Of V = −g1 on nu = 1: 2C P = 1·nu·x^0.
    radicand = rational_radicand(DOUBLE, formula("-g1", DOUBLE), ONE)
    assert radicand.power == 0
    assert list(radicand.polynomial.coeffs()) == [fmpq(1, 2)]


@pytest.mark.parametrize("text", ["exp(g1)", "g1*g2", "abs(g1)^(1/3)"])
def test_what_is_not_rational_has_none(text):
    assert rational_radicand(DOUBLE, formula(text, DOUBLE), ONE) is None


def test_roots_are_the_ends_of_the_stretch():
    # P = −(x − 1/5)(x − 1/2)/(2x) on the curve nu = 1.
    text = "-(7/10*g1 - 1/20/g3^2 - 1/2*(g1^2-g2^2))"
    radicand = rational_radicand(DOUBLE, formula(text, DOUBLE), ONE)
    assert radicand.power == 1
    with ctx.workprec(192):
        stretch = find_stretch(radicand, None)
        assert stretch.low_is_root
        assert stretch.high_is_root
        # A rounding of 192 bits.
        assert abs(stretch.lo - fmpq(1, 5)) < 1e-50
        assert abs(stretch.hi - fmpq(1, 2)) < 1e-50
        assert find_stretch(radicand, 1) is None


def test_the_period_is_that_of_the_equation_of_motion():
    """The period is the integral of dx/√(4x/ν (x1−x)(x−x2) P), by the balls' own rule."""
    radicand = rational_radicand(DOUBLE, formula("-g1 + 1/(20*g3^2)", DOUBLE), ONE)
    with ctx.workprec(192):
        stretch = find_stretch(radicand, None)
        period = period_of_x(stretch)
        x1 = (arb(5).sqrt() - 1) / 2
        assert stretch.x1.overlaps(x1)
    assert period.error < 1e-24 * period.hi


def test_the_product_of_roots_is_the_radicand():
    frame = make_frame(DOUBLE, ONE)
    radicand = rational_radicand(DOUBLE, formula("-g1 + 1/(20*g3^2)", DOUBLE), ONE)
    loops, _ = rational_orbit(radicand, ONE, frame)
    loop = loops[0]
    assert loop.by_roots
    middle = math.atan2(loop.s_middle, loop.c_middle)
    for share in (-0.7, -0.2, 0.0, 0.5, 0.9):
        v = middle + share * loop.half_width
        x = loop.g * math.sin(v) ** 2
        below, above = (1.0 + share) * loop.half_width, (1.0 - share) * loop.half_width
        polynomial = sum(
            float(int(a.p) / int(a.q)) * x**k for k, a in enumerate(radicand.polynomial.coeffs())
        )
        P = abs(polynomial) * x**-radicand.power
        K = factor_by_roots(loop, below, above, math.sin(v), math.cos(v))
        # P is a difference of numbers of size 1.
        assert K * below * above == pytest.approx(P, rel=1e-12)
