"""What is printed means what the formula means, in every format."""

import math
import re
from fractions import Fraction

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from service.dynamics.errors import FormulaError
from service.dynamics.formula.algebras.real import ScalarAlgebra
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import FUNCTIONS, Binary, Call, Negation, Number, Symbol, Tree
from service.typesetting.equations import NAMES, latex, mathml, names_of, typeset
from service.typesetting.layout import lay_out, symbols_of
from tests.support.formulas import PRECEDENCE
from tests.support.mathml import checked, value_of

VALUES = {"g1": 0.6, "g2": -0.35, "nu": 1.3, "a": 0.7, "b1": 2.1, "x_2": 1.7}
SHOWN = {"γ1": 0.6, "γ2": -0.35, "ν": 1.3, "a": 0.7, "b1": 2.1, "x2": 1.7}
LEAVES = st.one_of(
    st.builds(Symbol, st.sampled_from(sorted(VALUES))),
    st.sampled_from([Number(Fraction(n)) for n in ("0", "1", "2", "3", "0.5", "1.25", "1e25", "3e-21")]),
)
TREES: st.SearchStrategy[Tree] = st.recursive(
    LEAVES,
    lambda smaller: st.one_of(
        st.builds(Negation, smaller),
        st.builds(Binary, st.sampled_from(["+", "-", "*", "/", "^"]), smaller, smaller),
        st.builds(Call, st.sampled_from(FUNCTIONS), smaller),
    ),
    max_leaves=12,
)
COMMANDS = {
    *(
        r"\frac",
        r"\sqrt",
        r"\left",
        r"\right",
        r"\cdot",
        r"\ln",
        r"\sin",
        r"\cos",
        r"\tan",
        r"\pi",
        r"\mathrm",
    ),
    *(r"\gamma", r"\nu", r"\lambda", r"\pm", r"\int", r"\mid", r"\operatorname", r"\Omega", r"\kappa", r"\_"),
}


def shown(tree: Tree) -> tuple[str, str]:
    box = lay_out(tree, names_of(symbols_of(tree)))
    return latex(box), mathml(box)


@given(TREES)
def test_what_mathml_shows_has_the_value_of_the_formula(tree: Tree) -> None:
    names = tuple(VALUES)
    try:
        expected = compile_tape(tree, names, formally=False).evaluate(ScalarAlgebra(), tuple(VALUES.values()))
    except FormulaError:
        assume(False)
    assume(math.isfinite(expected) and 1e-200 < abs(expected) < 1e200)
    try:
        found = value_of(shown(tree)[1], SHOWN)
    except (OverflowError, ZeroDivisionError, ValueError):
        # A part of it has no value in doubles that the exact arithmetic of constants went around.
        assume(False)
    # Other orders of evaluation: the same roundings, of sums that may cancel nearly all of their digits.
    assume(math.isfinite(found) and _is_stable(tree, names, expected))
    assert found == pytest.approx(expected, rel=1e-6)


def _is_stable(tree: Tree, names: tuple[str, ...], expected: float) -> bool:
    """Whether roundings of the variables move the value by less than the tolerance of the test."""
    tape = compile_tape(tree, names, formally=False)
    moved = tape.evaluate(ScalarAlgebra(), tuple(value * (1 + 1e-13) for value in VALUES.values()))
    return math.isfinite(moved) and abs(moved - expected) < 1e-8 * abs(expected)


@pytest.mark.parametrize("text", [text for text, _ in PRECEDENCE])
def test_parentheses_stand_where_the_grammar_has_them(text: str) -> None:
    tree = parse(text)
    values = {"a": 1.4, "b": 2.0, "c": -2.0, "d": 0.9}
    names = tuple(values)
    expected = compile_tape(tree, names).evaluate(ScalarAlgebra(), tuple(values.values()))
    # A handful of operations.
    assert value_of(shown(tree)[1], values) == pytest.approx(expected, rel=1e-14, nan_ok=True)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a*g1 + b/g3^2", r"a \gamma_{1} + \frac{b}{\gamma_{3}^{2}}"),
        ("-1/2*a*nu", r"-\frac{1}{2} a \nu"),
        ("140/113*g1^3", r"\frac{140}{113} \gamma_{1}^{3}"),
        ("sqrt(w) + w^(1/3) + w^(3/2)", r"\sqrt{w} + \sqrt[3]{w} + w^{3 / 2}"),
        ("abs(nu)^3*exp(-g2)", r"\left|\nu\right|^{3} \mathrm{e}^{-\gamma_{2}}"),
        ("2*3^g1*log(w)^2", r"2 \cdot 3^{\gamma_{1}} \ln^{2} \left(w\right)"),
        ("a1*lambda^2 - omega_0", r"a_{1} \lambda^{2} - \omega_{0}"),
        ("2e-30*pi", r"2 \cdot 10^{-30} \pi"),
    ],
)
def test_latex_is_as_a_person_writes_it(text: str, expected: str) -> None:
    assert shown(parse(text))[0] == expected


@given(TREES)
def test_latex_is_balanced_and_has_harmless_commands_only(tree: Tree) -> None:
    text = shown(tree)[0]
    assert set(re.findall(r"\\(?:[A-Za-z]+|.)", text)) <= COMMANDS
    depth = 0
    for character in text.replace(r"\_", ""):
        depth += {"{": 1, "}": -1}.get(character, 0)
        assert depth >= 0
    assert depth == 0
    assert len(re.findall(r"\\left", text)) == len(re.findall(r"\\right", text))


HOSTILE = [
    *(
        "_",
        "__",
        "a_",
        "_a",
        "a__1",
        "a_b_c",
        "h",
        "V",
        "t",
        "d",
        "e",
        "input",
        "def",
        "csname",
        "alpha",
        "a1",
    ),
    *("a_1", "gamma1", "gamma_1", "lambda1", "omega", "Omega", "mathrm", "frac", "script", "O0", "g12", "ln"),
    *("x" * 60, "beta_", "_1", "A1", "pi2", "Nu", "nu1", "left", "right", "end"),
]


GREEK = {r"\alpha", r"\beta", r"\lambda", r"\nu", r"\omega", r"\Omega", r"\pi"}


def test_different_names_never_look_alike_and_none_is_a_command() -> None:
    reserved = ["V", "h", "t", "d"]
    names = names_of([*HOSTILE, "g1", "g2", "g3", "lambda", "nu", "w", "pi"], reserved)
    for look in (latex, mathml):
        assert len({look(name) for name in names.values()}) == len(names)
        usual = {look(name) for name in names_of(()).values()} | {look(names_of([r])[r]) for r in reserved}
        assert not {look(name) for symbol, name in names.items() if symbol in HOSTILE} & usual
    for symbol in HOSTILE:
        text = latex(names[symbol])
        assert set(re.findall(r"\\(?:[A-Za-z]+|.)", text)) <= {r"\mathrm", r"\_", *GREEK}
        checked(mathml(names[symbol]))


def test_names_of_variables_are_theirs() -> None:
    assert latex(names_of(["gamma1"])["gamma1"]) == r"\mathrm{gamma1}"
    assert latex(names_of(["g1"])["g1"]) == r"\gamma_{1}"


@pytest.mark.parametrize("name", NAMES)
def test_every_equation_is_well_formed_in_every_format(name: str) -> None:
    found = typeset(name, parse("(a - h*g1)/(1 + V)"), ["text", "latex", "mathml"])
    checked(found["mathml"] or "")
    assert "=" in (found["latex"] or "")
    assert " = " in (found["text"] or "")
    assert r"\mathrm{h}" in (found["latex"] or "")


def test_only_what_is_asked_for_is_written() -> None:
    found = typeset("V", parse("g1"), ["latex"])
    assert found == {"text": "V = g1", "latex": r"V = \gamma_{1}", "mathml": None}
