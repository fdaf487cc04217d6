"""The nearest admissible polynomial: an orthogonal projection in exact numbers."""

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.errors import EqualMomentsError
from service.dynamics.inverse.polynomials import as_polynomial, degree, on_sphere, product
from service.dynamics.inverse.projection import (
    EXCESS_DEGREES,
    mean_of_monomial,
    mean_product,
    nearest_admissible,
)
from service.dynamics.verdict.verdict import decide
from tests.dynamics.inverse.exact_polynomials import Polynomial, residual
from tests.dynamics.inverse.families import known_admissible
from tests.dynamics.verdict.formulas import body, potential
from tests.support.effort import examples
from tests.support.witnesses.admissible_basis import basis_of

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


def nearest(alpha, text, highest=None):
    found = nearest_admissible(body(3 * Fraction(alpha), 3), potential(text), highest=highest)
    assert found is not None
    return found


def polynomial_of(text):
    polynomial = as_polynomial(potential(text))
    assert polynomial is not None
    return polynomial


def test_golden_projections():
    found = nearest("2", "g1 + 3/10*g3^2 + 1/10*g1*g2", 2)
    assert (found.expression, found.relative_squared_distance) == ("0.1 + g1", Fraction(13, 528))
    found = nearest("3", "g1 + 3/10*g3^2 + 1/10*g1^2*g2", 3)
    assert found.relative_squared_distance == Fraction(32231, 33228)
    assert found.expression == "9/70 + (3*g1^2 + g3^2)*(-3/140 + 1/36*g2)"


def test_a_polynomial_of_a_higher_degree_may_be_nearer():
    # None of degree 1 or 2 has a part along g1; one of degree 3 has nearly all of it.
    found = nearest("4", "g1")
    assert found.expression == "140/113*g1^3 + 105/113*g1*g3^2"
    assert found.distances == (1, 1, 1, *[Fraction(8, 113)] * 5)
    assert (found.space.degree, found.space.dimension) == (7, 8)


def test_that_distance_is_an_integral_over_the_sphere():
    # In spherical angles, by Gauss's rule in g2 and the trapezoidal one round the axis: exact for degree 6.
    nodes, weights = np.polynomial.legendre.leggauss(8)
    angles = 2 * np.pi * np.arange(16) / 16
    g2, phi = np.meshgrid(nodes, angles, indexing="ij")
    g1, g3 = np.sqrt(1 - g2**2) * np.cos(phi), np.sqrt(1 - g2**2) * np.sin(phi)
    left = g1 - 35 / 113 * g1 * (4 * g1**2 + 3 * g3**2)
    ratio = (weights @ (left**2).sum(axis=1)) / (weights @ (g1**2).sum(axis=1))
    assert ratio == pytest.approx(8 / 113, rel=1e-13)


@settings(max_examples=examples(6, 40))
@given(st.sampled_from(ALPHAS), polynomials, st.integers(0, 11))
def test_what_is_left_is_orthogonal_to_all_that_is_admissible(alpha, coefficients, highest):
    found = nearest(alpha, text_of(coefficients), highest)
    W = polynomial_of(text_of(coefficients))
    rest = polynomial_of(f"{text_of(coefficients)} - ({found.expression})")
    for element in (*known_admissible(Fraction(alpha), highest), *basis_of(found.space)):
        assert mean_product(rest, element) == 0
    assert mean_product(rest, rest) == found.relative_squared_distance * mean_product(W, W)


@settings(max_examples=examples(6, 40))
@given(st.sampled_from(ALPHAS), polynomials)
def test_the_distance_never_grows_with_the_degree(alpha, coefficients):
    found = nearest(alpha, text_of(coefficients))
    highest = degree(polynomial_of(text_of(coefficients))) + EXCESS_DEGREES
    assert len(found.distances) == found.space.degree + 1 == highest + 1
    assert all(1 >= lower >= higher >= 0 for lower, higher in pairwise(found.distances))
    half = highest // 2
    assert nearest(alpha, text_of(coefficients), half).distances == found.distances[: half + 1]


@settings(max_examples=examples(5, 30))
@given(st.sampled_from(ALPHAS), polynomials)
def test_the_nearest_is_admissible_and_its_own_nearest(alpha, coefficients):
    found = nearest(alpha, text_of(coefficients), 8)
    expected = polynomial_of(found.expression)
    assert on_sphere(residual(Fraction(alpha), expected)) == {}
    assert degree(expected) <= 8
    again = nearest(alpha, found.expression)
    assert again.relative_squared_distance == 0
    assert polynomial_of(again.expression) == expected


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_verdict_on_the_nearest_is_admissible(alpha):
    on = body(3 * Fraction(alpha), 3)
    found = nearest(alpha, "g1 - g3/3 + 2*g2*g3^2 - g1*g2^2 + g1^4/5")
    verdict = decide(on, potential(found.expression))
    assert (verdict.verdict, verdict.proof) == ("admissible", "symbolic")


@settings(max_examples=examples(7, 20))
@given(st.sampled_from(ALPHAS), st.lists(small, min_size=9, max_size=9))
def test_the_nearest_of_an_admissible_polynomial_is_itself(alpha, weights):
    parts = known_admissible(Fraction(alpha), 7)
    text = " + ".join(f"({w})*({text_of(part)})" for w, part in zip(weights, parts, strict=False))
    found = nearest(alpha, text)
    assert found.relative_squared_distance == 0
    assert polynomial_of(found.expression) == polynomial_of(text)


@pytest.mark.parametrize("text", ["0", "5", "g1^2 + g2^2 + g3^2"])
def test_a_constant_is_its_own_nearest(text):
    found = nearest("3", text)
    assert polynomial_of(found.expression) == polynomial_of(text)
    assert set(found.distances) == {0}


def test_only_polynomials_have_a_nearest():
    assert nearest_admissible(body(3), potential("exp(g1)")) is None


@pytest.mark.parametrize(("digits", "is_told"), [(15, True), (120, None), (290, None), (700, False)])
def test_moments_with_many_digits_have_an_answer_or_none(digits, is_told):
    on = body(Fraction(10**digits + 7, 10**digits // 3))
    found = nearest_admissible(on, potential("g2 + g1*g3/7 + g3^2/3"))
    assert is_told is None or (found is not None) == is_told
    if found is not None:
        assert len(str(found.relative_squared_distance)) < 5000
        assert as_polynomial(potential(found.expression)) is not None


def test_equal_moments_are_refused():
    with pytest.raises(EqualMomentsError):
        nearest_admissible(body(1, 1), potential("g1"))
