"""What SymPy makes of a formula is used if it is the same function, and never else."""

from fractions import Fraction

import pytest
import sympy
from flint import arb, ctx
from hypothesis import assume, given
from hypothesis import strategies as st

from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.symbolic import sympy_expression
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import Binary, Call, Negation, Number, Symbol, Tree, format_tree
from service.typesetting import simplification
from service.typesetting.simplification import NotInGrammarError, from_sympy, simplified

SIGNS = {"g1": 1, "nu": 0}
LEAVES = st.one_of(
    st.builds(Symbol, st.sampled_from(["g1", "nu", "a"])),
    st.builds(lambda n: Number(Fraction(n)), st.integers(0, 4)),
)
TREES: st.SearchStrategy[Tree] = st.recursive(
    LEAVES,
    lambda smaller: st.one_of(
        st.builds(Negation, smaller),
        st.builds(Binary, st.sampled_from(["+", "-", "*", "/"]), smaller, smaller),
        st.builds(lambda base, n: Binary("^", base, Number(Fraction(n))), smaller, st.integers(1, 3)),
        st.builds(Call, st.sampled_from(["sqrt", "exp", "abs"]), smaller),
    ),
    max_leaves=6,
)
POINTS = [
    (Fraction(3, 7), Fraction(5, 3), Fraction(-2, 5)),
    (Fraction(9, 4), Fraction(-1, 6), Fraction(7, 3)),
]


def balls(tree: Tree) -> list[arb]:
    algebra = BallAlgebra()
    tape = compile_tape(tree, ("g1", "nu", "a"))
    with ctx.workprec(200):
        return [tape.evaluate(algebra, [algebra.constant(x) for x in point]) for point in POINTS]


def assert_same(tree: Tree, other: Tree) -> None:
    for value, found in zip(balls(tree), balls(other), strict=True):
        # 200 bits, lost to a few cancellations at most: what overlaps agrees to 1e-30.
        if value.is_finite():
            assert found.is_finite()
            assert found.overlaps(value)


@given(TREES)
def test_the_tree_of_an_expression_has_its_values(tree: Tree) -> None:
    symbols = [sympy.Symbol(name, real=True) for name in ("g1", "nu", "a")]
    try:
        expression = sympy_expression(compile_tape(tree, ("g1", "nu", "a")), symbols)
        found = from_sympy(expression)
    except (FormulaError, NotInGrammarError):
        assume(False)
    assert parse(format_tree(found)) == found
    assert_same(tree, found)


@given(TREES)
def test_a_simplified_formula_has_the_values_of_the_formula(tree: Tree) -> None:
    found = simplified(tree, SIGNS)
    assume(found is not None and found != tree)
    assert_same(tree, found)


@pytest.mark.parametrize(
    ("text", "signs", "expected"),
    [
        (
            "140/113*g1^3 + 105/113*g1*g3^2",
            dict.fromkeys(("g1", "g2", "g3"), 0),
            "35*g1*(4*g1^2 + 3*g3^2)/113",
        ),
        ("-1/2*a*nu", {"nu": 0}, "-a*nu/2"),
        ("1/2*w^(1/2) - 2*b*w^-1", {"w": 1}, "sqrt(w)/2 - 2*b/w"),
        ("sqrt(w^2) + exp(-w)*exp(2*w)", {"w": 1}, "w + exp(w)"),
        ("2/(13/10 + sqrt(169/100 + 4))", {}, "20/(13 + sqrt(569))"),
        (
            "4*g1^2*(1 - g1^2 - nu*g1)*(-a*nu/2 - 2*b/nu^2 - a*g1 - b/(nu*g1))/(2*g1^2 + nu*g1)",
            {"g1": 1, "nu": 1},
            "2*(a*g1*nu^2 + 2*b)*(g1^2 + g1*nu - 1)/nu^2",
        ),
    ],
)
def test_formulas_of_the_theory_become_short(text: str, signs: dict[str, int], expected: str) -> None:
    found = simplified(parse(text), signs)
    assert found is not None
    assert format_tree(found) == expected


@pytest.mark.parametrize(
    "wrong",
    [
        lambda expression: sympy.Symbol("nu", real=True),
        lambda expression: expression + sympy.Rational(1, 10**80),
        lambda expression: sympy.I * expression,
        lambda expression: 1 // 0,
        lambda expression: sympy.Poly(sympy.sqrt(expression) ** sympy.pi, sympy.Symbol("nu")).nroots(),
        lambda expression: sympy.oo,
        lambda expression: sympy.zoo,
        lambda expression: sympy.nan,
        lambda expression: sympy.besselj(0, expression),
        lambda expression: sympy.Piecewise((expression, expression > 0), (0, True)),
    ],
)
def test_a_sympy_that_errs_does_no_harm(wrong, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simplification, "_FORMS", (wrong,))
    tree = parse("1*nu*(1 + 1*nu) - nu^2 + 0*nu + 3*abs(nu)")
    monkeypatch.setattr(simplification, "_FURTHER_FORMS", ())
    assert simplified(tree, {"nu": 0}) in (None, tree)


def test_a_parameter_is_not_taken_for_positive() -> None:
    found = simplified(parse("sqrt(a^2)*nu"), {"nu": 0})
    assert found is None or "abs(a)" in format_tree(found) or "sqrt(a^2)" in format_tree(found)
