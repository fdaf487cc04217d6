"""1 - cos x is written 2 sin(x/2)² where it divides: the same function, with its digits next to 0."""

import mpmath
import pytest
from flint import arb, ctx

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.rewriting import with_half_angles
from service.dynamics.formula.tape import compile_tape
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
