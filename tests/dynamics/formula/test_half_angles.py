"""1 - cos x is written 2 sin(x/2)² where it divides, and 1 - g2² as g1² + g3²: with the digits next to 0."""

import mpmath
import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.real import ScalarAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.rewriting import known_at_poles, with_half_angles
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import format_tree
from service.dynamics.verdict.simple_form import is_simplified, simplified
from tests.support.planar import body, formula


@pytest.mark.parametrize(
    "text",
    [
        "g1/(1-cos(g2-1/3))",
        "g1/(cos(2*g2)-1)^3",
        "g1*(3-3*cos(g2))^(-1/2)",
        "log(-2*cos(g2)+2)",
        "1/(abs(-1+cos(g2*g1))+g3/(5*cos(g2)-5))",
    ],
)
def test_the_value_is_the_same_and_no_cosine_is_left(text):
    tree = parse(text)
    rewritten = with_half_angles(tree)
    assert "cos" not in format_tree(rewritten)
    with ctx.workprec(128):
        for place in (("0.3", "0.7", "-0.2"), ("-0.5", "-0.11", "0.8")):
            values = [
                compile_tape(each).evaluate(BallAlgebra(), tuple(map(arb, place)))
                for each in (tree, rewritten)
            ]
            assert values[0].overlaps(values[1]) or not values[0].is_finite()


@pytest.mark.parametrize("text", ["1-cos(g2)", "g1/(1-2*cos(g2))", "g1/(1+cos(g2))", "cos(g2)/(1-g1)", "-g1"])
def test_what_does_not_divide_or_is_another_sum_stays_as_it_is(text):
    tree = parse(text)
    assert with_half_angles(tree) is tree


def test_a_quotient_keeps_its_digits_next_to_the_zero():
    own = body(2, 1)
    typed = formula("(2*g1^2+g3^2)/(1-cos(g2))", own)
    simple = simplified(typed)
    assert is_simplified(simple)
    with mpmath.workdps(50):
        expected = mpmath.mpf(1) / (1 - mpmath.cos(mpmath.mpf(2) ** -30))
    value = compile_tape(parse(format_tree(simple.tree))).evaluate(
        BallAlgebra(), (arb(0), arb(2) ** -30, arb(1))
    )
    # 53 bits, of which 1 - cos x loses 2 log2(1/x) = 60: all.
    assert abs(float(value) / float(expected) - 1) < 1e-14


@pytest.mark.parametrize(
    "text", ["sqrt(1-g2^2)*g1", "1/(g2^2-1)^2", "log(2-2*g2^4)+1/g3", "g1/(g2-g2^3)", "exp(-1/(1-g2^2))"]
)
def test_a_factor_that_vanishes_at_both_poles_is_the_distance_from_them(text):
    stated = compile_tape(parse(text))
    rewritten = known_at_poles(stated)
    with ctx.workprec(400):
        third, first = arb("1e-40"), arb("3e-30")
        place = first, (1 - first * first - third * third).sqrt(), third
        known = stated.evaluate(BallAlgebra(), place)
        # Of 1 − g2² about 200 of 400 bits are left.
        assert rewritten.evaluate(BallAlgebra(), place).overlaps(known)
    found = rewritten.evaluate(ScalarAlgebra(), [float(each) for each in place])
    # A dozen roundings; exp(−1/x) has no digit there, and is 0.
    assert abs(found - float(known)) <= 1e-14 * abs(float(known))


@pytest.mark.parametrize("text", ["sqrt(1-g2)", "1/(1-g1^2)", "g2^2", "1/(2-g2^2)"])
def test_what_vanishes_elsewhere_stays(text):
    stated = compile_tape(parse(text))
    assert known_at_poles(stated).instructions == stated.instructions
