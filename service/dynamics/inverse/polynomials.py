"""Polynomial potentials: exact coefficients, and all that are admissible up to a degree.

Potentials that agree on the sphere |g|² = 1 are the same.
"""

from collections.abc import Mapping
from fractions import Fraction

from service.dynamics.inverse.monomial_sums import expand
from service.dynamics.potentials.homogeneous import B_term
from service.dynamics.potentials.monomials import Exponents
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.potentials.powers import PowerSum, exchanged

MAX_DEGREE = 12

PolynomialSum = Mapping[Exponents, Fraction]
"""Coefficients by the exponents of g1, g2, g3, none of them 0."""


def as_polynomial(potential: Potential) -> dict[Exponents, Fraction] | None:
    """Return V as a polynomial without g3², equal to it on the sphere and of the least degree.

    None if its formula is not a polynomial with rational coefficients as it
    stands, or has a degree beyond MAX_DEGREE.
    """
    try:
        expansion = expand(potential.tape)
    except NoClosedFormError:
        return None
    if expansion is None:
        return None
    polynomial: dict[Exponents, Fraction] = {}
    for (a, b, c, *others), coefficient in expansion.terms.items():
        is_natural = all(power.denominator == 1 and power >= 0 for power in (a, b, c))
        if any(others) or not is_natural or a + b + c > MAX_DEGREE:
            return None
        polynomial[a.numerator, b.numerator, c.numerator] = coefficient
    return on_sphere(polynomial)


def on_sphere(polynomial: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return the polynomial with g3² replaced by 1 - g1² - g2² throughout: the normal form on the sphere."""
    pending, reduced = dict(polynomial), dict[Exponents, Fraction]()
    while pending:
        (i, j, k), coefficient = pending.popitem()
        if k < 2:
            _add(reduced, (i, j, k), coefficient)
        else:
            _add(pending, (i, j, k - 2), coefficient)
            _add(pending, (i + 2, j, k - 2), -coefficient)
            _add(pending, (i, j + 2, k - 2), -coefficient)
    return {exponents: coefficient for exponents, coefficient in reduced.items() if coefficient}


def degree(polynomial: PolynomialSum) -> int:
    """Return the total degree, 0 for the polynomial 0."""
    return max((sum(exponents) for exponents in polynomial), default=0)


def product(left: PolynomialSum, right: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return left · right."""
    total: dict[Exponents, Fraction] = {}
    for (a, b, c), first in left.items():
        for (d, e, f), second in right.items():
            _add(total, (a + d, b + e, c + f), first * second)
    return {exponents: coefficient for exponents, coefficient in total.items() if coefficient}


def quadratic(alpha: Fraction) -> dict[Exponents, Fraction]:
    """Return Q/C = α g1² + g3²."""
    return {(2, 0, 0): alpha, (0, 0, 2): Fraction(1)}


def admissible_basis(alpha: Fraction, degree: int) -> tuple[dict[Exponents, Fraction], ...]:
    """Return a basis of the admissible polynomials up to ``degree`` on the sphere, for A/C = α ≠ 1.

    It is 1, the products of α g1² + g3² with 1, g2, …, g2^(degree-2) and, where α or
    1/α is an even integer not greater than degree + 1, one homogeneous polynomial
    more: |B_n| with n = α/2 - 1, or its mirror. Other terms of the energy are not
    smooth at the poles.
    """
    basis: list[dict[Exponents, Fraction]] = [{(0, 0, 0): Fraction(1)}]
    larger = max(alpha, 1 / alpha)
    if larger % 2 == 0 and larger <= degree + 1:
        term = B_term(larger, larger.numerator // 2 - 1)
        basis.append(_from_power_sum(term if alpha > 1 else exchanged(term)))
    basis += [product(quadratic(alpha), {(0, k, 0): Fraction(1)}) for k in range(degree - 1)]
    return tuple(basis)


def _from_power_sum(terms: PowerSum) -> dict[Exponents, Fraction]:
    # All coefficients of the one polynomial have the same sign.
    return {(first.numerator, 0, third.numerator): abs(factor) for (first, third), factor in terms.items()}


def _add(total: dict[Exponents, Fraction], exponents: Exponents, value: Fraction) -> None:
    total[exponents] = total.get(exponents, Fraction(0)) + value
