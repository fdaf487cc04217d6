"""The nearest admissible polynomial: an orthogonal projection in exact numbers."""

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.errors import EqualMomentsError
from service.dynamics.inverse.polynomials import (
    admissible_basis,
    as_polynomial,
    degree,
    product,
)
from service.dynamics.inverse.projection import mean_of_monomial, mean_product, nearest_admissible
from service.dynamics.verdict.verdict import decide
from tests.dynamics.inverse.exact_polynomials import Polynomial
from tests.dynamics.verdict.formulas import body, potential

ALPHAS = ["2", "4", "1/2", "1/4", "3", "5/3", "2/7"]

small = st.fractions(-3, 3, max_denominator=9)
exponents = st.tuples(st.integers(0, 3), st.integers(0, 2), st.integers(0, 2))
polynomials = st.dictionaries(exponents, small.filter(bool), min_size=1, max_size=6)


def text_of(coefficients: Polynomial) -> str:
    return " + ".join(f"({c})*g1^{i}*g2^{j}*g3^{k}" for (i, j, k), c in coefficients.items()) or "0"


@pytest.mark.parametrize("n", range(5))
def test_the_moments_are_those_of_the_sphere(n):
    # The mean of (u g)^(2n) is 1/(2n + 1) for every unit vector u: here (2, 6, 3)/7.
    line: Polynomial = {(1, 0, 0): Fraction(2, 7), (0, 1, 0): Fraction(6, 7), (0, 0, 1): Fraction(3, 7)}
    power: Polynomial = {(0, 0, 0): Fraction(1)}
    for _ in range(n):
        power = product(power, line)
    assert mean_product(power, power) == Fraction(1, 2 * n + 1)
    assert mean_product(power, product(power, line)) == 0


@given(exponents)
def test_the_moments_know_that_gamma_is_a_unit_vector(powers):
    i, j, k = powers
    raised = (mean_of_monomial(e) for e in ((i + 2, j, k), (i, j + 2, k), (i, j, k + 2)))
    assert sum(raised) == mean_of_monomial(powers)


def test_golden_projections():
    found = nearest_admissible(body(2), potential("g1 + 3/10*g3^2 + 1/10*g1*g2"))
    assert found is not None
    assert found.basis == ("1", "g1", "2*g1^2 + g3^2")
    assert found.coefficients == (Fraction(1, 10), 1, 0)
    assert found.relative_squared_distance == Fraction(13, 528)
    found = nearest_admissible(body(3), potential("g1 + 3/10*g3^2 + 1/10*g1^2*g2"))
    assert found is not None
    assert found.basis[1:] == ("3*g1^2 + g3^2", "3*g1^2*g2 + g2*g3^2")
    assert found.coefficients == (Fraction(9, 70), Fraction(-3, 140), Fraction(1, 36))
    assert found.relative_squared_distance == Fraction(32231, 33228)
    assert found.expression == "9/70 + (3*g1^2 + g3^2)*(-3/140 + 1/36*g2)"


@settings(max_examples=40)
@given(st.sampled_from(ALPHAS), polynomials)
def test_what_is_left_is_orthogonal_to_all_that_is_admissible(alpha, coefficients):
    alpha = Fraction(alpha)
    V = potential(text_of(coefficients))
    on = body(3 * alpha, 3)
    found = nearest_admissible(on, V)
    assert found is not None
    rest = as_polynomial(potential(f"{text_of(coefficients)} - ({found.expression})"))
    assert rest is not None
    W = as_polynomial(V)
    assert W is not None
    for element in admissible_basis(alpha, degree(W)):
        assert mean_product(rest, element) == 0
    assert mean_product(rest, rest) == found.relative_squared_distance * mean_product(W, W)
    assert 0 <= found.relative_squared_distance <= 1


@settings(max_examples=30)
@given(st.sampled_from(ALPHAS), polynomials)
def test_the_nearest_is_admissible_and_its_own_nearest(alpha, coefficients):
    on = body(3 * Fraction(alpha), 3)
    found = nearest_admissible(on, potential(text_of(coefficients)))
    assert found is not None
    nearest = potential(found.expression)
    verdict = decide(on, nearest)
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")
    again = nearest_admissible(on, nearest)
    assert again is not None
    assert again.relative_squared_distance == 0
    assert as_polynomial(potential(again.expression)) == as_polynomial(nearest)


@pytest.mark.parametrize("text", ["0", "5", "g1^2 + g2^2 + g3^2"])
def test_a_constant_is_its_own_nearest(text):
    found = nearest_admissible(body(3), potential(text))
    assert found is not None
    assert (found.basis, found.relative_squared_distance) == (("1",), 0)


def test_only_polynomials_have_a_nearest():
    assert nearest_admissible(body(3), potential("exp(g1)")) is None


def test_equal_moments_are_refused():
    with pytest.raises(EqualMomentsError):
        nearest_admissible(body(1, 1), potential("g1"))
