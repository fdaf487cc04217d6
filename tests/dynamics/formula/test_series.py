"""Series over balls are those of flint, along a curve stay on it, and are exact over algebraic numbers."""

from fractions import Fraction
from math import factorial

import pytest
from flint import arb, arb_series, ctx

from service.dynamics.formula.algebras.algebraic import AlgebraicAlgebra, NotAlgebraicError
from service.dynamics.formula.algebras.ball import BallAlgebra, series_of
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.reduction.geometry.slopes import SeriesAlgebra, along_curve

ORDER = 9
FORMULAS = {
    "exp(x)*x^3": lambda x: x.exp() * x * x * x,
    "log(2+x)/(1-x)": lambda x: (2 + x).log() / (1 - x),
    "sin(x)^2+cos(2*x)": lambda x: x.sin() ** 2 + (2 * x).cos(),
    "tan(x)-x": lambda x: x.tan() - x,
    "(1+x)^(5/3)": lambda x: ((1 + x).log() * arb(5) / 3).exp(),
    "x^(-2)+sqrt(3-x)": lambda x: 1 / (x * x) + (3 - x).sqrt(),
    "(2+x)^x": lambda x: ((2 + x).log() * x).exp(),
    "abs(x-1)*x": lambda x: (1 - x) * x,
}


def tape(text):
    return compile_tape(bind(parse(text), {}, variables=("x",)), ("x",))


@pytest.mark.parametrize("text", FORMULAS)
@pytest.mark.parametrize("at", [Fraction(1, 3), Fraction(-1, 7)])
def test_a_series_is_that_of_flint(text, at):
    with ctx.workprec(200):
        algebra = SeriesAlgebra(BallAlgebra(), ORDER)
        x = algebra.series([arb(at.numerator) / at.denominator, arb(1)])
        found = tape(text).evaluate(algebra, [x])
        with series_of(ORDER + 1):
            known = FORMULAS[text](arb_series([x[0], 1]))
        for k in range(ORDER + 1):
            assert found[k].overlaps(known[k])
            # Of 200 bits a few are lost in ten divisions by 1/7.
            assert found[k].rad() < 1e-40


def test_a_series_about_a_ball_has_those_about_all_its_points():
    with ctx.workprec(100):
        algebra, formula = SeriesAlgebra(BallAlgebra(), ORDER), tape("exp(x)*sin(3*x)/(2+x)")
        wide = formula.evaluate(algebra, [algebra.series([arb(0.25, 0.125), arb(1)])])
        for at in (0.125, 0.2, 0.375):
            point = formula.evaluate(algebra, [algebra.series([arb(at), arb(1)])])
            assert all(one.contains(other) for one, other in zip(wide, point, strict=True))


def test_an_absolute_value_has_no_derivative_where_it_may_have_a_kink():
    algebra = SeriesAlgebra(BallAlgebra(), 3)
    found = tape("abs(x)").evaluate(algebra, [algebra.series([arb(0, 0.1), arb(1)])])
    assert found[0].is_finite()
    assert not any(each.is_finite() for each in found[1:])


def test_exact_coefficients_of_a_remainder_are_zero_up_to_its_order():
    """exp less its Taylor polynomial begins with x^6/6!."""
    algebra = AlgebraicAlgebra()
    series = SeriesAlgebra(algebra, 8)
    x = series.series([algebra.constant(Fraction(0)), algebra.constant(Fraction(1))])
    found = tape("exp(x)-1-x-x^2/2-x^3/6-x^4/24-x^5/120").evaluate(series, [x])
    assert [each.exact for each in found] == [*[0] * 6, *(Fraction(1, factorial(k)) for k in (6, 7, 8))]


def test_a_transcendental_coefficient_is_never_taken_for_zero():
    algebra = AlgebraicAlgebra()
    series = SeriesAlgebra(algebra, 1)
    x = series.series([algebra.constant(Fraction(1)), algebra.constant(Fraction(1))])
    found = tape("sin(x)-sin(x)*(cos(x)^2+sin(x)^2)").evaluate(series, [x])
    with pytest.raises(NotAlgebraicError):
        algebra.is_zero(found[0])


@pytest.mark.parametrize(("A", "C"), [(2, 1), (Fraction(17, 10), 1), (1, 3)])
def test_series_along_a_curve_stay_on_it(A, C):
    """On the sphere, and with |g3|^A |g1|^(-C) the same, to all orders."""
    with ctx.workprec(200):
        algebra = SeriesAlgebra(BallAlgebra(), ORDER)
        place = [arb(2) / 7, arb(-3) / 7, arb(6) / 7]
        g1, g2, g3 = along_curve(BallAlgebra(), (Fraction(A), Fraction(C)), place, ORDER)
        squares = [algebra.multiply(x, x) for x in (g1, g2, g3)]
        whole = algebra.add(algebra.add(*squares[:2]), squares[2])
        curve = algebra.divide(algebra.power(g3, Fraction(A)), algebra.power(g1, Fraction(C)))
        for series, first in ((whole, 1), (curve, None)):
            assert first is None or series[0].overlaps(arb(first))
            assert all(each.contains(0) and each.rad() < 1e-40 for each in series[1:])
