"""The rational family against its formula sheet: explicit polynomials, H, and the signs."""

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
import pytest
import sympy
from flint import arb, ctx

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.symbolic import real_symbols, sympy_expression
from service.dynamics.formula.parser import parse
from service.dynamics.formula.tape import compile_tape
from service.dynamics.formula.tree import VARIABLES
from service.dynamics.potentials.families.coefficients import (
    RationalBodyError,
    U_term,
    W_term,
    rational_potential,
    require_rational_body,
)
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms import MAX_TERMS, TooManyTermsError, monomial_sum
from tests.support.effort import each_once

BODY = RigidBody(Fraction(2), None, Fraction(1))
NUMBERS = range(1, MAX_TERMS + 1)


def _unit(n: int, value: Fraction | int = 1) -> list[Fraction]:
    return [Fraction(0)] * (n - 1) + [Fraction(value)]


def _same(potential: Potential, text: str) -> bool:
    difference = sympy_expression(potential.tape) - sympy_expression(compile_tape(parse(text)))
    return bool(sympy.expand(difference) == 0)


@pytest.mark.parametrize(
    ("a", "b", "c", "text"),
    [
        (_unit(1), [], [], "g1"),
        (_unit(2), [], [], "8*g1^3 + 8*g1*g3^2 + g3^4/g1"),
        # The paper prints + g3^8/g1^3, which does not satisfy the equation.
        (_unit(3), [], [], "16*g1*(8*g1^4 + 16*g1^2*g3^2 + 9*g3^4) + 16*g3^6/g1 - g3^8/g1^3"),
        (
            _unit(4),
            [],
            [],
            "(1024*g1^12 + 3072*g1^10*g3^2 + 3200*g1^8*g3^4 + 1280*g1^6*g3^6 + 120*g1^4*g3^8"
            " - 8*g1^2*g3^10 + g3^12)/g1^5",
        ),
        ([], _unit(1), [], "1/g3^2"),
        ([], _unit(2), [], "2*(g1^2 - g3^2)/(2*g3^6)"),
        ([], _unit(3), [], "5*(2*g1^4 - 2*g1^2*g3^2 + g3^4)/(5*g3^10)"),
        ([], _unit(4), [], "14*(5*g1^6 - 5*g1^4*g3^2 + 3*g1^2*g3^4 - g3^6)/(14*g3^14)"),
        (
            [],
            _unit(5),
            [],
            "42*(14*g1^8 - 14*g1^6*g3^2 + 9*g1^4*g3^4 - 4*g1^2*g3^6 + g3^8)/(42*g3^18)",
        ),
        ([], [], _unit(1), "g1^2 - g2^2"),
        ([], [], _unit(2), "g2^2*(2*g1^2 + g3^2)"),
        ([], [], _unit(4), "g2^6*(2*g1^2 + g3^2)"),
    ],
)
def test_terms_are_those_of_the_formula_sheet(
    a: Sequence[Fraction], b: Sequence[Fraction], c: Sequence[Fraction], text: str
) -> None:
    assert _same(rational_potential(a, b, c), text)


@pytest.mark.parametrize("n", range(1, 8))
def test_series_are_the_hypergeometric_ones(n: int) -> None:
    # Summed from the definition with Pochhammer symbols, not from the recurrence.
    g1, _, g3 = real_symbols(VARIABLES)
    v = 1 + (g3 / g1) ** 2

    def series(a: sympy.Expr, b: sympy.Expr, c: sympy.Expr) -> sympy.Expr:
        return sum(
            sympy.rf(a, j) * sympy.rf(b, j) / sympy.rf(c, j) / sympy.factorial(j) * v**j
            for j in range(1 - int(b))
        )

    half = sympy.Rational(1, 2)
    U = g1 ** (2 * n - 1) * series(half - n, sympy.Integer(2 - 2 * n), half * 5 - n)
    W = g1 ** (2 * n - 2) / g3 ** (4 * n - 2) * series(sympy.Integer(2), sympy.Integer(1 - n), 2 + n)
    for term, expected in ((U_term(n), U), (W_term(n), W)):
        built = sympy_expression(compile_tape(monomial_sum(term)))
        assert sympy.expand(built - expected) == 0


@each_once(bits=[128, 200], g1=["0.3", "-0.6"], n=list(NUMBERS))
def test_H_is_a_power_of_nu(n: int, g1: str, bits: int) -> None:
    with ctx.workprec(bits):
        x, y, z = arb(g1), arb("0.5"), arb("0.7")
        nu = z * z / x
        for term, expected in (
            (U_term(n), (arb(n) - arb("1.5")) * nu ** (2 * n - 1)),
            (W_term(n), -(n + 1) / nu ** (2 * n)),
        ):
            H = Potential.from_tree(monomial_sum(term), "rational").H_ball(BODY, x, y, z)
            assert H.overlaps(expected)
            # The terms of the sum exceed it by at most 2^(4n) at these points.
            assert H.rel_accuracy_bits() >= bits - 20 - 4 * n


def test_H_of_a_whole_potential_is_the_energy_of_the_formula_sheet() -> None:
    a1, a2, a3, b1, b2, b3, c1, c2 = (Fraction(k, 7) for k in (-3, 2, 1, 5, -1, 4, 6, -2))
    potential = rational_potential([a1, a2, a3], [b1, b2, b3], [c1, c2])
    nu = Fraction(49, 30)
    h = (
        -a1 * nu / 2
        + a2 * nu**3 / 2
        - 3 * a3 * nu**5 / 2
        - 2 * b1 / nu**2
        - 6 * b2 / nu**4
        - 20 * b3 / nu**6
        - c1
    )
    # c1 (g1² - g2²) = c1 (2 g1² + g3²) - c1 |γ|²: the constant belongs to the sphere.
    with ctx.workprec(200):
        x, z = arb("0.3"), arb("0.7")
        y = (1 - x * x - z * z).sqrt()
        H = potential.H_ball(BODY, x, y, z)
        assert H.overlaps(arb(h.numerator) / h.denominator)
        assert H.rel_accuracy_bits() > 180


@pytest.mark.parametrize("n", [3, 4])
def test_the_third_sign_is_the_papers_and_no_other(n: int) -> None:
    sign = -1 if n == 3 else 1
    potential = rational_potential(_unit(n), [], [])
    expected = monomial_sum({exponents: sign * factor for exponents, factor in U_term(n).items()})
    assert potential.tree == expected


def test_zero_coefficients_leave_no_terms() -> None:
    assert rational_potential([], [], []).formula() == "0"
    assert rational_potential([Fraction(0)] * 3, [Fraction(0)], []).formula() == "0"
    gamma = np.array([[0.3, 0.5, 0.0]])
    # No 0/g3² is left, which would be undefined here.
    assert rational_potential([Fraction(-1)], [Fraction(0)], []).value(gamma).tolist() == [-0.3]
    # Equal monomials of different terms are added: b2 contributes g3^-4, b1 none of it.
    assert rational_potential([], [], [Fraction(1), Fraction(0)]).formula() == "g1^2 - g2^2"


@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_a_list_that_is_too_long_is_named(name: str) -> None:
    lists = {"a": [], "b": [], "c": []} | {name: [Fraction(1)] * (MAX_TERMS + 1)}
    with pytest.raises(TooManyTermsError) as caught:
        rational_potential(**lists)
    assert caught.value.pointer == f"/potential/{name}"


def test_the_family_belongs_to_one_ratio_of_moments() -> None:
    require_rational_body(BODY)
    require_rational_body(RigidBody(Fraction(3), None, Fraction(3, 2)))
    with pytest.raises(RationalBodyError, match="A = 3 and C = 2") as caught:
        require_rational_body(RigidBody(Fraction(3), None, Fraction(2)))
    assert caught.value.pointer == "/body"
