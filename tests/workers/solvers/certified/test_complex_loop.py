from fractions import Fraction

import pytest
from flint import acb, arb, ctx

from service.dynamics.problem import PlanarMotion
from service.dynamics.reduction.geometry.loop import make_loop
from tests.support.planar import body, formula
from workers.solvers.complex_plane.complex_loop import ComplexLoop

FRACTIONAL = "(A*g1^2 + C*g3^2)*(g2^2 - 1/2 + g2/5) - abs(g1)^(2*(A-C)/A)/3 + abs(g3)^(-2*(A-C)/C)/50"


def curve(A, text, side=1, C=1, **signs) -> ComplexLoop:
    rigid_body = body(A, C)
    potential = formula(text, rigid_body)
    loop = make_loop(rigid_body, potential, PlanarMotion(Fraction(6, 5), **signs))
    return ComplexLoop(loop, potential.tape, arb(1) / 3, side)


@pytest.mark.parametrize(
    ("A", "C", "side"),
    [(2, 1, 1), (3, 1, -1), (4, 1, 1), ("17/10", 1, -1), (3, 5, 1), (100, 3, 1), (70, 1, 1)],
)
@pytest.mark.parametrize("v", [("0.7", "0.05"), ("1.5", "-0.1"), ("2.1", "0")])
def test_slope_and_curvature_are_those_of_difference_quotients(A, C, side, v):
    with ctx.workprec(256):
        at, step = side * acb(*map(arb, v)), arb(2) ** -40
        loop = curve(A, FRACTIONAL, side, C, g3_sign=side if A != 3 or C != 5 else 1)

        def N(v):
            return loop.N(loop.place(v, analytic=True), analytic=True)

        place = loop.place(acb(arb(at.real.mid(), step), arb(at.imag.mid(), step)), analytic=True)
        slope, bend = loop.slope_and_curvature(place, analytic=True)
        # Real and imaginary parts are averages of those of the derivatives on the way.
        assert ((N(at + step) - N(at - step)) / (2 * step)).overlaps(slope)
        assert ((N(at + step) - 2 * N(at) + N(at - step)) / step**2).overlaps(bend)
        assert loop.slope(place, analytic=True).overlaps(slope)
        wide = at + acb(arb(0, 2.0**-6), arb(0, 2.0**-6))
        for corner in (acb(1, 1), acb(-1, 1), acb(0, -1), acb(0)):
            inside = at + corner * arb(2) ** -6
            assert loop.expanded_N(wide).overlaps(N(inside))


@pytest.mark.parametrize("A", [2, 3, 4, "17/10", 70])
def test_the_place_lies_on_the_sphere_and_on_the_curve(A):
    with ctx.workprec(256):
        loop = curve(A, "-g1")
        for v in (acb(arb("0.3")), acb(arb("1.57")), acb.pi() / 2, acb(arb("1.2"), arb("0.2"))):
            g1, g2, g3 = loop.gamma(loop.place(v, analytic=True))
            assert (g1 * g1 + g2 * g2 + g3 * g3 - 1).contains(0)
            if v.imag != 0:
                continue  # the logarithm of g1 has another branch
            alpha = loop.loop.alpha
            ratio = g3 / (g1.log() * alpha.denominator / alpha.numerator).exp()
            assert (ratio - acb(arb(6) / 5)).contains(0)


@pytest.mark.parametrize(
    ("A", "text", "is_holomorphic"),
    [
        (4, "abs(g1)^(3/2)", True),
        (4, "abs(g1)*g2", True),
        (2, "abs(g1)", True),
        (3, "abs(g1)^(4/3) + g1^2", True),
        (3, "g1", False),
        (4, "abs(g1)^(5/4)", False),
        (4, "abs(g3)", False),
        (4, "abs(g3)^2", True),
        (4, "log(abs(g1))", False),
        (2, "sqrt(abs(g1))", False),
    ],
)
def test_what_is_holomorphic_at_a_pole_is_known_there(A, text, is_holomorphic):
    loop = curve(A, text, side=0)
    about = acb(arb(0, 0.125), arb(0, 0.125))
    assert loop.N(loop.place(about, analytic=True), analytic=True).is_finite() is is_holomorphic


def test_a_logarithm_is_not_followed_across_its_cut():
    # Its derivative is finite there: that alone must not pass for holomorphic.
    with ctx.workprec(128):
        loop = curve(3, "log(g2)")
        across = acb(arb(2.0, 0.5), arb(0, 0.5))
        at = loop.place(across, analytic=True)
        assert at.c.is_finite()
        assert not loop.slope(at, analytic=True).is_finite()
        assert not loop.slope_and_curvature(at, analytic=True)[1].is_finite()
