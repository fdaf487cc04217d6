"""The energy formula is the H of theory, for both signs of g1."""

from fractions import Fraction

import pytest

from service.dynamics.formula.algebras.real import RealAlgebra
from service.dynamics.formula.algebras.symbolic import sympy_expression
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from tests.dynamics.verdict.formulas import (
    EIGHT_PARAMETERS,
    EIGHT_TERMS,
    B_term,
    C_term,
    U,
    W,
    body,
    verdict_on,
)


def same_function(text: str | None, expected: str, name: str) -> bool:
    assert text is not None
    difference = compile_tape(parse(f"{text} - ({expected})"), (name,))
    return sympy_expression(difference).expand() == 0


def test_the_energy_of_the_eight_term_potential_is_that_of_theory():
    # Theory 3.3; an identity of rational functions of nu, so it holds for nu > 0 and nu < 0 alike.
    expected = "-a1*nu/2 + a2*nu^3/2 - 3*a3*nu^5/2 - 2*b1/nu^2 - 6*b2/nu^4 - 20*b3/nu^6 - c1"
    for name, value in EIGHT_PARAMETERS.items():
        expected = expected.replace(name, f"({value})")
    verdict = verdict_on(EIGHT_TERMS, parameters=EIGHT_PARAMETERS)
    assert same_function(verdict.energy_formula, expected, "nu")


@pytest.mark.parametrize("n", range(1, 9))
def test_the_energies_of_the_rational_blocks_are_those_of_theory(n):
    assert same_function(verdict_on(U(n)).energy_formula, f"({Fraction(2 * n - 3, 2)})*nu^{2 * n - 1}", "nu")
    assert same_function(verdict_on(W(n)).energy_formula, f"-{n + 1}*nu^(-{2 * n})", "nu")


@pytest.mark.parametrize("alpha", [Fraction(17, 10), Fraction(3), Fraction(3, 5)])
@pytest.mark.parametrize("n", range(2))
def test_the_energies_of_the_homogeneous_blocks_are_those_of_theory(alpha, n):
    on = body(5 * alpha, 5)
    B_energy = f"({(-1) ** n * (n * alpha - n - 1) / alpha})*lambda^{2 * (n + 1)}"
    assert same_function(verdict_on(B_term(n, alpha), on).energy_formula, B_energy, "lambda")
    C_energy = f"({n - (n + 1) * alpha})*lambda^({-2 * alpha * (n + 1)})"
    values = [_value(text, 1.3) for text in (verdict_on(C_term(n, alpha), on).energy_formula, C_energy)]
    # Two orders of the same few operations: a few roundings apart.
    assert values[0] == pytest.approx(values[1], rel=1e-14)


def _value(text: str | None, at: float) -> float:
    assert text is not None
    return float(compile_tape(parse(text), ("lambda",)).evaluate(RealAlgebra(), [at]))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5 + (2*g1^2 + g3^2)/(1 + g2)", "5"),
        ("0", "0"),
        ("abs(g1)", "-1/2*abs(nu)"),
        ("3*abs(g1) + g1", "-3/2*abs(nu) - 1/2*nu"),
        ("sqrt(g1)^2", "-1/2*nu"),
        ("sqrt(-g1)^2", "1/2*nu"),
        ("sqrt(2)*g1", "-1/2*2^(1/2)*nu"),
        ("(2*g1^2 + g3^2)*log(abs(g1)) + 2*(g1^2 + g3^2)", "-1/2*nu^2"),
    ],
)
def test_energies_in_nu_keep_the_sign_of_g1(text, expected):
    assert verdict_on(text).energy_formula == expected


@pytest.mark.parametrize("text", ["g1*g3/abs(g3)", "abs(g3)*g1/g3"])
def test_an_energy_that_depends_on_the_sign_of_g3_has_no_formula(text):
    verdict = verdict_on(text)
    assert verdict.verdict == "admissible"
    assert verdict.energy_formula is None


def test_an_energy_that_depends_on_the_sign_of_g1_has_no_formula_in_lambda():
    # α = 4: H is a multiple of a function odd in g1, and λ does not know the sign of g1.
    verdict = verdict_on("g1*(4*g1^2 + 3*g3^2)", body(4))
    assert verdict.verdict == "admissible"
    assert verdict.energy_formula is None
