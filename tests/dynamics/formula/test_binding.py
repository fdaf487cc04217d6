from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.dynamics.errors import (
    FormulaError,
    FormulaLimitError,
    UndefinedConstantError,
    UnknownNameError,
)
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse, parse_located
from service.dynamics.formula.tree import MAX_BITS, Symbol, Tree, format_tree, post_order
from tests.support.trees import TREES

CONSTANTS = {name: Fraction(n, 7) for n, name in enumerate(["A", "B", "C", "a", "e", "e1", "_x"], start=2)}


def _bind(text: str, **constants: str) -> Tree:
    located = parse_located(text)
    exact = {name: Fraction(value) for name, value in constants.items()}
    return bind(located.tree, exact, positions=located.positions)


@given(TREES)
def test_only_variables_and_pi_remain(tree: Tree) -> None:
    try:
        bound = bind(tree, CONSTANTS)
    except (FormulaLimitError, UndefinedConstantError):
        return
    assert {node.name for node in post_order(bound) if isinstance(node, Symbol)} <= {"g1", "g2", "g3", "pi"}


@given(st.fractions(), st.fractions())
def test_a_sign_or_a_ratio_stays_together(a: Fraction, b: Fraction) -> None:
    # -2^2 is -4, but a^2 with a = -2 is 4: the bound tree must say so when printed.
    bound = bind(parse("g1*a^2 - b*g1^a/b"), {"a": a % 50, "b": b or Fraction(1)})
    assert parse(format_tree(bound)) == bound


def test_numbers_replace_names() -> None:
    assert format_tree(_bind("a*g1 + b/g3^C", a="-1", b="1/20", C="2/3")) == "-1*g1 + 0.05/g3^(2/3)"
    assert format_tree(_bind("a^2", a="-3")) == "(-3)^2"


def test_other_variables_may_be_chosen() -> None:
    assert bind(parse("2*nu"), {}, variables=("nu",)) == parse("2*nu")
    with pytest.raises(UnknownNameError, match="known are nu, pi"):
        bind(parse("g1"), {}, variables=("nu",))


@pytest.mark.parametrize(
    ("text", "position", "error"),
    [
        ("g1 + h*g2", 5, UnknownNameError),
        ("G1", 0, UnknownNameError),
        ("g1/0", 2, UndefinedConstantError),
        ("g1/(a-a)", 2, UndefinedConstantError),
        ("1 + 0^-1", 5, UndefinedConstantError),
        ("1/(0*g1)", 1, UndefinedConstantError),
        ("g1*(-8)^(1/3)", 7, UndefinedConstantError),
        ("sqrt(-a)*g1", 0, UndefinedConstantError),
        ("g1 + log(2-a)", 5, UndefinedConstantError),
        ("g1^1001", 2, FormulaLimitError),
        ("g1^-1000.5", 2, FormulaLimitError),
        ("g1^(10^3+1)", 2, FormulaLimitError),
        ("2^1000^2", 1, FormulaLimitError),
        ("g1 + 7^1000*7^900", 11, FormulaLimitError),
        ("(1e300)^5", 7, FormulaLimitError),
        ("9^9^9^9^9", 5, FormulaLimitError),
    ],
)
def test_what_cannot_be_computed_is_found_with_its_place(
    text: str, position: int, error: type[FormulaError]
) -> None:
    with pytest.raises(error) as caught:
        _bind(text, a="2")
    assert caught.value.position == position


def test_products_grow_up_to_the_limit_and_no_further() -> None:
    bits = MAX_BITS // 4
    _bind("*".join([f"2^{bits // 2}"] * 7))
    with pytest.raises(FormulaLimitError):
        _bind("*".join([f"2^{bits // 2}"] * 9))


def test_an_unknown_name_is_told_what_is_known() -> None:
    with pytest.raises(
        UnknownNameError,
        match=r"'x' is not known here; known are g1, g2, g3, pi, a, k; add x = … to the parameters",
    ):
        _bind("x", k="1", a="1")


def test_a_power_is_refused_before_it_is_computed() -> None:
    # Computing this one would not take long; the message tells that it was not done.
    with pytest.raises(FormulaLimitError, match=r"the power 1024\^1000 has more than"):
        _bind("g1 + 1024^1000")
