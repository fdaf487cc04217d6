"""Polynomial potentials with exact coefficients.

Potentials that agree on the sphere |g|² = 1 are the same.
"""

from collections.abc import Mapping
from fractions import Fraction

from service.dynamics.formula.algebras.monomials import (
    SPHERE,
    MonomialSum,
    added_up,
    as_fmpq,
    as_fraction,
    reduced,
    weighted_sum,
    without_zeros,
)
from service.dynamics.inverse.monomial_sums import expand
from service.dynamics.potentials.potential import NoClosedFormError, Potential
from service.dynamics.potentials.terms.powers import Exponents

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
    terms: MonomialSum = {(*exponents, 0, ()): as_fmpq(value) for exponents, value in polynomial.items()}
    return {(i, j, k): as_fraction(value) for (i, j, k, *_), value in reduced(terms, SPHERE[2]).items()}


def homogeneous_on_sphere(polynomial: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return the polynomial with all terms of the same parities brought to one degree, the least possible.

    Terms are multiplied by g1² + g2² + g3², which is 1 on the sphere.
    """
    total = on_sphere(polynomial)
    highest: dict[tuple[int, ...], int] = {}
    for exponents in total:
        parities = tuple(exponent % 2 for exponent in exponents)
        highest[parities] = max(highest.get(parities, 0), sum(exponents))
    for low in range(degree(total)):
        for i, j, k in [e for e in total if sum(e) == low < highest[e[0] % 2, e[1] % 2, e[2] % 2]]:
            coefficient = total.pop((i, j, k))
            raised = dict.fromkeys(((i + 2, j, k), (i, j + 2, k), (i, j, k + 2)), coefficient)
            total = weighted_sum(((Fraction(1), total), (Fraction(1), raised)))
    return total


def degree(polynomial: PolynomialSum) -> int:
    """Return the total degree, 0 for the polynomial 0."""
    return max((sum(exponents) for exponents in polynomial), default=0)


def product(left: PolynomialSum, right: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return left · right."""
    return without_zeros(
        added_up(
            ((a + d, b + e, c + f), first * second)
            for (a, b, c), first in left.items()
            for (d, e, f), second in right.items()
        )
    )


def difference(left: PolynomialSum, right: PolynomialSum) -> dict[Exponents, Fraction]:
    """Return left - right."""
    return weighted_sum(((Fraction(1), left), (Fraction(-1), right)))


def quadratic(alpha: Fraction) -> dict[Exponents, Fraction]:
    """Return Q/C = α g1² + g3²."""
    return {(2, 0, 0): alpha, (0, 0, 2): Fraction(1)}
