"""A formula taken apart by its parameters is the same formula."""

from fractions import Fraction

import pytest

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.parameters import MAX_PARTS, bind, split_by_parameters
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import format_tree

VALUES = {"a": Fraction(-3, 2), "b": Fraction(7, 5), "c": Fraction(2)}
POINT = (Fraction(2, 7), Fraction(6, 7), Fraction(3, 7))


def value(tree, values):
    tape = compile_tape(bind(tree, values))
    return tape.evaluate(BallAlgebra(), [BallAlgebra().constant(x) for x in POINT])


SEPARABLE = {
    "a*g1 + b/g3^2": ["a", "b"],
    "(a - b)*(g1 + c*g2)": ["a", "a*c", "b", "b*c"],
    "a*(g1 + b*g2)^2 - g1/2": ["", "a", "a*b", "a*b^2"],
    "g1/(a*b^2) - exp(g2)": ["", "a^(-1)*b^(-2)"],
    "(2*a*g1)^3/4": ["a^3"],
    "-(a*g1) - -b": ["a", "b"],
    # What stands in a function or an exponent keeps its number.
    "exp(a*g2)*b*g1": ["b"],
    "b*g1^c + a*c": ["a", "b"],
    "a*g1/(b + c)": ["a"],
}


@pytest.mark.parametrize(("text", "factors"), SEPARABLE.items())
def test_the_parts_add_up_to_the_formula(text, factors):
    parts = split_by_parameters(parse(text), VALUES)
    assert sorted(part.factor for part in parts) == factors
    assert all(not set(format_tree(part.coefficient)) & {"a", "b", "c"} - set("abs") for part in parts)
    total = sum(value(parse(part.factor or "1"), VALUES) * value(part.coefficient, {}) for part in parts)
    assert total.overlaps(value(parse(text), VALUES))
    assert total.rad() < 1e-9


@pytest.mark.parametrize("text", ["g1", "exp(a*g2)", "sin(a)*g1^b", "g1/(a + b)"])
def test_a_formula_without_parameters_to_name_has_no_parts(text):
    assert split_by_parameters(parse(text), VALUES) is None


def test_products_that_are_zero_are_left_out():
    parts = split_by_parameters(parse("a*g1 + b*log(-1)*g2"), {"a": Fraction(1), "b": Fraction(0)})
    assert [part.factor for part in parts] == ["a"]


def test_too_many_parts_are_not_named():
    text = " + ".join(f"k{n}*g1^{n}" for n in range(MAX_PARTS + 1))
    assert split_by_parameters(parse(text), {f"k{n}": Fraction(1) for n in range(MAX_PARTS + 1)}) is None
