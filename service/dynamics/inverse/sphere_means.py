"""Computes exact means of polynomials over the unit sphere.

The mean of g1^i g2^j g3^k is (i-1)!! (j-1)!! (k-1)!! / (i+j+k+1)!! if i, j, k are
even and 0 otherwise.
"""

from fractions import Fraction
from functools import cache
from math import prod

from service.dynamics.inverse.polynomials import PolynomialSum, product
from service.dynamics.potentials.terms.monomials import Exponents


def mean_product(left: PolynomialSum, right: PolynomialSum) -> Fraction:
    """Return the mean of left · right over the unit sphere."""
    total = Fraction(0)
    for exponents, coefficient in product(left, right).items():
        total += coefficient * mean_of_monomial(exponents)
    return total


def mean_of_monomial(exponents: Exponents) -> Fraction:
    """Return the mean of g1^i g2^j g3^k over the unit sphere."""
    if any(exponent % 2 for exponent in exponents):
        return Fraction(0)
    i, j, k = exponents
    return Fraction(
        odd_factorial(i - 1) * odd_factorial(j - 1) * odd_factorial(k - 1), odd_factorial(i + j + k + 1)
    )


@cache
def odd_factorial(n: int) -> int:
    """Return n!! for an odd n ≥ -1."""
    return prod(range(1, n + 1, 2))
