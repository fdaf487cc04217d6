"""Admissible polynomials: the basis against the exact rank of L, and the polynomial of a formula."""

from fractions import Fraction

import pytest
from flint import fmpq, fmpq_mat
from hypothesis import given, settings
from hypothesis import strategies as st

from service.dynamics.inverse.polynomials import as_polynomial, degree, homogeneous_on_sphere, on_sphere
from service.dynamics.inverse.projection import admissible_space
from service.dynamics.potentials.families.written import general_potential
from service.dynamics.verdict.sphere.boxes import sphere_points
from tests.dynamics.inverse.exact_polynomials import Polynomial, evaluate, residual
from tests.dynamics.inverse.families import known_admissible
from tests.dynamics.verdict.formulas import body, potential
from tests.support.effort import examples
from tests.support.witnesses.admissible_basis import basis_of

POINTS = list(sphere_points())[:24]

# Dimension of the admissible polynomials modulo g1² + g2² + g3² = 1 for the degrees 0, 1, …, 8.
GENERIC = [1, 1, 2, 3, 4, 5, 6, 7, 8]
DIMENSIONS = [
    *((alpha, GENERIC) for alpha in ("17/10", "3", "5/3", "7", "2/7", "3/2", "5", "4/3", "2/3")),
    *((alpha, [1, 2, 3, 4, 5, 6, 7, 8, 9]) for alpha in ("2", "1/2")),
    *((alpha, [1, 1, 2, 4, 5, 6, 7, 8, 9]) for alpha in ("4", "1/4")),
    *((alpha, [1, 1, 2, 3, 4, 6, 7, 8, 9]) for alpha in ("6", "1/6")),
    *((alpha, [1, 1, 2, 3, 4, 5, 6, 8, 9]) for alpha in ("8", "1/8")),
]


def rank(polynomials: list[Polynomial]) -> int:
    """Return the rank of polynomials modulo the sphere."""
    forms = [on_sphere(polynomial) for polynomial in polynomials]
    columns = sorted({exponents for form in forms for exponents in form})
    if not columns:
        return 0
    rows = [
        [fmpq(form.get(e, Fraction(0)).numerator, form.get(e, Fraction(0)).denominator) for e in columns]
        for form in forms
    ]
    return int(fmpq_mat(rows).rank())


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("alpha", "dimensions"), DIMENSIONS)
def test_the_space_is_the_kernel_of_the_compatibility_equation(alpha, dimensions):
    alpha = Fraction(alpha)
    for highest, dimension in enumerate(dimensions):
        monomials: list[Polynomial] = [
            {(i, j, k): Fraction(1)}
            for i in range(highest + 1)
            for j in range(highest + 1 - i)
            for k in (0, 1)
            if i + j + k <= highest
        ]
        images = [residual(alpha, monomial) for monomial in monomials]
        assert len(monomials) - rank(images) == dimension
        space, families = admissible_space(alpha, highest), known_admissible(alpha, highest)
        basis = list(basis_of(space))
        assert len(basis) == space.dimension == rank(basis) == dimension
        assert rank(families) == rank(basis + families) == dimension
        assert all(not on_sphere(residual(alpha, element)) for element in basis)
        assert all(degree(element) <= highest for element in basis)


def test_the_extra_polynomials_are_those_of_the_even_ratios():
    assert known_admissible(Fraction(2), 1)[1] == {(1, 0, 0): 1}
    assert known_admissible(Fraction(4), 3)[1] == {(3, 0, 0): 4, (1, 0, 2): 3}
    assert known_admissible(Fraction(6), 5)[1] == {(5, 0, 0): 24, (3, 0, 2): 40, (1, 0, 4): 15}
    assert known_admissible(Fraction(1, 4), 3)[1] == {(0, 0, 3): 4, (2, 0, 1): 3}


small = st.fractions(-3, 3, max_denominator=9)
exponents = st.tuples(*[st.integers(0, 3)] * 3)


@settings(max_examples=examples(6, 40))
@given(st.dictionaries(exponents, small, max_size=6))
def test_a_polynomial_is_expanded_to_what_it_is_on_the_sphere(coefficients):
    text = " + ".join(f"({c})*g1^{i}*g2^{j}*g3^{k}" for (i, j, k), c in coefficients.items()) or "0"
    polynomial = as_polynomial(potential(f"({text})*(2 - g1)^2 - g3^3/(5/2)"))
    assert polynomial is not None
    assert all(k < 2 for _, _, k in polynomial)
    for point in POINTS[:4]:
        expected = evaluate(coefficients, point) * (2 - point[0]) ** 2 - point[2] ** 3 * Fraction(2, 5)
        assert evaluate(polynomial, point) == expected


@given(st.dictionaries(exponents, small, max_size=6))
def test_a_polynomial_is_homogeneous_for_each_parity(coefficients):
    polynomial = homogeneous_on_sphere(coefficients)
    assert on_sphere(polynomial) == on_sphere(coefficients)
    degrees: dict[tuple[int, ...], set[int]] = {}
    for powers in polynomial:
        degrees.setdefault(tuple(power % 2 for power in powers), set()).add(sum(powers))
    assert all(len(found) == 1 for found in degrees.values())
    assert degree(polynomial) == degree(on_sphere(coefficients))


def test_the_degree_is_the_least_on_the_sphere():
    polynomial = as_polynomial(potential("(g1^2 + g2^2 + g3^2)^4*g2 + g1"))
    assert polynomial == {(0, 1, 0): 1, (1, 0, 0): 1}


@pytest.mark.parametrize(
    "text", ["g1^2/g3", "abs(g1)", "sqrt(g2)", "pi*g1", "exp(g1)", "g1^13", "1/(2+g1)", "2^(1/2)*g1", "g2^g1"]
)
def test_what_is_not_a_polynomial_of_moderate_degree_has_no_coefficients(text):
    assert as_polynomial(potential(text)) is None


@pytest.mark.parametrize(
    ("text", "same"), [("g1^3/g1", "g1^2"), ("sqrt(4)*abs(g1^2)", "2*g1^2"), ("(g1*g3)^2/g3^2 - g1^2", "0")]
)
def test_what_cancels_to_a_polynomial_is_one(text, same):
    assert as_polynomial(potential(text)) == as_polynomial(potential(same))


def test_powers_that_are_too_large_are_refused_before_the_work():
    assert as_polynomial(potential("(1 + g1 + g2 + g3)^500")) is None
    assert as_polynomial(potential("((((((((1+g1)^9)^9)^9)^9)^9)^9)^9)^9")) is None


def test_an_integral_has_no_coefficients():
    on = body(3)
    assert as_polynomial(general_potential(on, "exp(-w)", "0", {})) is None
