from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.errors import FormulaError
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tree import (
    MAX_CHARACTERS,
    Binary,
    Number,
    Symbol,
    Tree,
    exact_tree,
    fold_binary,
    fold_tree,
    format_tree,
)
from tests.support.trees import TREES


@given(TREES)
def test_what_is_printed_parses_back_to_the_same_tree(tree: Tree) -> None:
    assert parse(format_tree(tree)) == tree


@given(TREES)
def test_printing_settles_after_once(tree: Tree) -> None:
    text = format_tree(tree)
    assert format_tree(parse(text)) == text


@given(TREES)
def test_no_pair_of_parentheses_can_be_spared(tree: Tree) -> None:
    text = format_tree(tree)
    opened: list[int] = []
    for place, character in enumerate(text):
        if character == "(":
            opened.append(place)
        elif character == ")":
            start = opened.pop()
            if start and text[start - 1].isalpha():
                continue  # the parentheses of a call
            without = text[:start] + " " + text[start + 1 : place] + " " + text[place + 1 :]
            try:
                assert parse(without) != tree
            except FormulaError:
                continue


@given(st.fractions())
def test_an_exact_number_prints_to_its_value(value: Fraction) -> None:
    for tree in (exact_tree(value), Number(value)):
        assert _value(parse(format_tree(tree))) == value
    assert parse(format_tree(exact_tree(value))) == exact_tree(value)


def _value(tree: Tree) -> Fraction:
    def build(index: int, node: Tree, operands: list[Fraction]) -> Fraction:
        if isinstance(node, Number):
            return node.value
        if isinstance(node, Binary):
            value = fold_binary(node.operator, *operands)
            assert value is not None
            return value
        return -operands[0]

    return fold_tree(tree, build)


@pytest.mark.parametrize(
    ("text", "printed"),
    [
        ("((g1))", "g1"),
        ("a*g1+b/g3**2", "a*g1 + b/g3^2"),
        ("(a+b)+c", "a + b + c"),
        ("a+(b+c)", "a + (b + c)"),
        ("a*(b/c)", "a*(b/c)"),
        ("(-a)^2", "(-a)^2"),
        ("-(a^2)", "-a^2"),
        ("-(a*b)", "-(a*b)"),
        ("(a^b)^c", "(a^b)^c"),
        ("a^(-b)", "a^-b"),
        ("0.50", "0.5"),
        ("1e-3", "0.001"),
        ("1e-300", "1e-300"),
        ("12.5e30", "125e29"),
        ("000", "0"),
        ("1e3", "1000"),
    ],
)
def test_formulas_are_printed_as_one_would_write_them(text: str, printed: str) -> None:
    assert format_tree(parse(text)) == printed


@pytest.mark.parametrize("term", [".5", "a", "9e9", "1e-9", "a-b", "2/3", ".1e7", "100"])
def test_what_prints_an_accepted_formula_is_accepted(term: str) -> None:
    # Spaces and leading zeros are left out where they would exceed the limit.
    count = min(MAX_CHARACTERS // (len(term) + 1), 1250 // (2 if len(term) == 3 and term[1] in "-/" else 1))
    text = "+".join([term] * count)
    tree = parse(text)
    printed = format_tree(tree)
    assert len(printed) <= MAX_CHARACTERS
    # Trees this deep cannot be compared by ==; what they print can.
    assert format_tree(parse(printed)) == printed


def test_a_number_that_is_no_decimal_prints_as_a_ratio() -> None:
    third = Number(Fraction(1, 3))
    assert format_tree(Binary("^", Symbol("g1"), third)) == "g1^(1/3)"
    assert format_tree(Binary("*", Number(Fraction(-1, 3)), Symbol("g1"))) == "-1/3*g1"
    assert format_tree(Binary("*", Symbol("g1"), Number(Fraction(-2)))) == "g1*-2"
