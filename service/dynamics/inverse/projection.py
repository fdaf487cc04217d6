"""The nearest admissible potential of a polynomial: its projection in the mean square over the sphere.

The mean of g1^i g2^j g3^k is (i-1)!! (j-1)!! (k-1)!! / (i+j+k+1)!! if i, j, k are
even and 0 otherwise, so that all numbers are rational.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import prod

from flint import fmpq, fmpq_mat

from service.dynamics.body import RigidBody
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tree import Binary
from service.dynamics.inverse.polynomials import (
    PolynomialSum,
    admissible_basis,
    as_polynomial,
    degree,
    product,
    quadratic,
)
from service.dynamics.inverse.section import formula_text
from service.dynamics.potentials.monomials import Exponents, monomial_sum
from service.dynamics.potentials.potential import Potential
from service.dynamics.verdict.factors import as_fraction


@dataclass(frozen=True, slots=True)
class Nearest:
    """The admissible polynomial nearest to a polynomial V, among those of at most its degree on the sphere.

    ``basis`` and ``coefficients`` are parallel, the basis as formulas.
    ``relative_squared_distance`` is <(V - P)²>/<V²>, means over the sphere of
    the potentials as they are: a constant counts in <V²>, though the constant of
    P always fits that of V. It is 0 if and only if V is admissible.
    """

    basis: tuple[str, ...]
    coefficients: tuple[Fraction, ...]
    expression: str
    relative_squared_distance: Fraction


def nearest_admissible(
    body: RigidBody, potential: Potential, *, highest: int | None = None
) -> Nearest | None:
    """Return the nearest admissible potential, None if ``potential`` is not a polynomial of moderate degree.

    It has at most the degree ``highest``, that of ``potential`` if left out.

    Raises
    ------
    EqualMomentsError
        A = C.
    """
    body.require_planar()
    polynomial = as_polynomial(potential)
    if polynomial is None:
        return None
    highest = degree(polynomial) if highest is None else highest
    basis = admissible_basis(body.alpha, highest)
    moments = [mean_product(element, polynomial) for element in basis]
    coefficients = _solve_gram(basis, moments)
    expression = _expression(body.alpha, highest, basis, coefficients)
    if expression is None:
        return None
    square = mean_product(polynomial, polynomial)
    # What is left is orthogonal to the projection P: <(V - P)²> = <V²> - <V P>.
    captured = sum((c * moment for c, moment in zip(coefficients, moments, strict=True)), Fraction(0))
    distance = (square - captured) / square if square else Fraction(0)
    texts = tuple(format_tree(monomial_sum(element)) for element in basis)
    return Nearest(texts, tuple(coefficients), expression, distance)


def _solve_gram(basis: Sequence[PolynomialSum], moments: Sequence[Fraction]) -> list[Fraction]:
    """Return c with Σ_j <basis_i basis_j> c_j = moments_i."""
    gram = fmpq_mat([[_rational(mean_product(one, other)) for other in basis] for one in basis])
    solution = gram.solve(fmpq_mat([[_rational(moment)] for moment in moments]))
    return [as_fraction(row[0]) for row in solution.tolist()]


def _expression(
    alpha: Fraction, highest: int, basis: Sequence[PolynomialSum], coefficients: Sequence[Fraction]
) -> str | None:
    """Return Σ coefficient · element as a formula with Q G(g2) in one piece, None beyond the limits."""
    others = len(basis) - max(highest - 1, 0)
    total: dict[Exponents, Fraction] = {}
    for element, coefficient in zip(basis[:others], coefficients[:others], strict=True):
        total |= {exponents: coefficient * factor for exponents, factor in element.items()}
    G = {(0, k, 0): coefficient for k, coefficient in enumerate(coefficients[others:])}
    tree = monomial_sum(total)
    if any(G.values()):
        part = Binary("*", monomial_sum(quadratic(alpha)), monomial_sum(G))
        tree = Binary("+", tree, part) if any(total.values()) else part
    return formula_text(format_tree(tree))


def _rational(value: Fraction) -> fmpq:
    return fmpq(value.numerator, value.denominator)


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
    return Fraction(prod(_odd_factorial(i - 1) for i in exponents), _odd_factorial(sum(exponents) + 1))


def _odd_factorial(n: int) -> int:
    """Return n!! for an odd n ≥ -1."""
    return prod(range(1, n + 1, 2))
