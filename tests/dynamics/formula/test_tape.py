import math
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.errors import (
    FormulaLimitError,
    UndefinedConstantError,
    UnknownNameError,
)
from service.dynamics.formula.algebras.real import ScalarAlgebra
from service.dynamics.formula.parameters import bind
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import Instruction, Tape, compile_tape
from service.dynamics.formula.tree import MAX_NODES, Binary, Call, Negation, Number, Symbol, Tree, fold_tree
from tests.support.formulas import POTENTIALS
from tests.support.trees import TREES

POINT = {"g1": 0.37, "g2": -0.69, "g3": 0.61}


def _directly(tree: Tree) -> float:
    """The value of the tree at POINT, node by node, by the meaning of the nodes alone."""
    algebra = ScalarAlgebra()

    def build(index: int, node: Tree, operands: list[float]) -> float:
        if isinstance(node, Number):
            return float(node.value)
        if isinstance(node, Symbol):
            return math.pi if node.name == "pi" else POINT[node.name]
        if isinstance(node, Negation):
            return -operands[0]
        if isinstance(node, Call):
            return (
                math.sqrt(operands[0]) if node.function == "sqrt" else algebra.call(node.function, *operands)
            )
        left, right = operands
        if node.operator == "^":
            return math.pow(left, right)
        return {"+": left + right, "-": left - right, "*": left * right, "/": left / right}[node.operator]

    return fold_tree(tree, build)


@pytest.mark.parametrize("text", POTENTIALS)
def test_the_tape_computes_what_the_tree_says(text: str) -> None:
    tree = parse(text)
    value = compile_tape(tree).evaluate(ScalarAlgebra(), tuple(POINT.values()))
    # A few roundings in another order, amplified by no more than the size of the terms (< 100).
    assert value == pytest.approx(_directly(tree), rel=1e-13, abs=1e-13)


@settings(deadline=None)
@given(TREES)
def test_any_tree_compiles_or_is_refused_as_a_formula(tree: Tree) -> None:
    constants = {name: Fraction(3, 7) for name in ["A", "B", "C", "a", "e", "e1", "_x"]}
    try:
        tape = compile_tape(bind(tree, constants))
    except (FormulaLimitError, UndefinedConstantError):
        return
    assert isinstance(tape.evaluate(ScalarAlgebra(), (0.3, 0.5, 0.7)), float)


def test_what_binds_compiles() -> None:
    # Binding folds by the same rules, so that faults in constants are found with their place.
    for text in ["0*g1^5/3", "g1^(2-2)", "g1*0 + 1/g3", "1^g2", "(g1*0)^2", "4^(1/2)*g1", "2^(1/2)"]:
        compile_tape(bind(parse(text), {}))


@given(st.integers(0, 20), st.fractions(max_denominator=50))
def test_constants_are_folded_exactly(n: int, x: Fraction) -> None:
    tree = Binary("+", Binary("^", bind(parse("x"), {"x": x}), Number(Fraction(n))), Number(Fraction(1, 10)))
    assert compile_tape(tree).instructions == (Instruction("constant", number=x**n + Fraction(1, 10)),)


def test_shared_parts_are_computed_once() -> None:
    once = compile_tape(parse("sin(g1*g3)"))
    twice = compile_tape(parse("sin(g1*g3) + cos(g2)*sin(g1*g3)"))
    assert len(twice.instructions) == len(once.instructions) + 3


def test_roots_and_quotients_of_constants_are_powers() -> None:
    exponents = [
        instruction.number
        for text in ("sqrt(g1)", "g1^(2/3)", "g1^-(A/C)", "g1^3", "g1^sqrt(9/4)", "g1^(0.5)")
        for instruction in compile_tape(bind(parse(text), {"A": Fraction(3), "C": Fraction(5)})).instructions
    ]
    halves = Fraction(1, 2)
    assert exponents == [halves, Fraction(2, 3), Fraction(-3, 5), 3, 3 * halves, halves]


@pytest.mark.parametrize(
    ("text", "short"),
    [
        ("g1 + 0*g3^-2", "g1"),
        ("g1 + 0/g3^2", "g1"),
        ("0 - g1", "-g1"),
        ("g1 - 0", "g1"),
        ("1*g1/1", "g1"),
        ("-1*g1", "-g1"),
        ("g1*-1", "-g1"),
        ("g1^1", "g1"),
        ("g1^0 + g2", "1 + g2"),
        ("1^g1", "1"),
        ("sqrt(9/4)", "3/2"),
        ("abs(-2)*g1", "2*g1"),
        ("--2", "2"),
        ("0*log(g1)", "0"),
    ],
)
def test_neutral_constants_leave_no_instruction(text: str, short: str) -> None:
    assert compile_tape(parse(text)) == compile_tape(parse(short))


def test_unused_instructions_are_dropped() -> None:
    assert compile_tape(parse("0*sin(g1) + g2")) == Tape(("g1", "g2", "g3"), (), 1)


def test_other_variables_may_be_chosen() -> None:
    tape = compile_tape(parse("w^2 - y"), ("w", "y"))
    assert tape.evaluate(ScalarAlgebra(), (3.0, 2.0)) == 7.0


def test_names_that_were_not_bound_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="'a' is not known here; known are g1, g2, g3, pi"):
        compile_tape(parse("a*g1"))


@pytest.mark.parametrize("text", ["1/0", "g1/(1 - 1)", "0^-2", "(-2)^(1/3)", "log(0)", "g1^1001", "2^999^2"])
def test_constants_without_a_value_are_refused(text: str) -> None:
    with pytest.raises((UndefinedConstantError, FormulaLimitError)):
        compile_tape(parse(text))


def test_long_sums_pass_every_stage_without_recursion() -> None:
    terms = [f"g{1 + n % 3}" for n in range(1250)]
    tree = bind(parse("+".join(terms)), {})
    value = compile_tape(tree).evaluate(ScalarAlgebra(), (1.0, 2.0, 4.0))
    assert value == 417 * 1.0 + 417 * 2.0 + 416 * 4.0


def test_a_tree_that_shares_itself_is_refused_before_it_grows() -> None:
    tree: Tree = Symbol("g1")
    for _ in range(60):
        tree = Binary("+", tree, tree)
    with pytest.raises(FormulaLimitError, match=str(MAX_NODES)):
        compile_tape(tree)
