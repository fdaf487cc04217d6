"""Finds the nearest admissible potential of a polynomial, by projection in the mean square on the sphere.

All means of polynomials over the sphere are rational, and so is everything here.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from service.dynamics.body import RigidBody
from service.dynamics.formula.printer import format_tree
from service.dynamics.formula.tree import Binary, Tree
from service.dynamics.inverse.admissible_space import AdmissibleSpace, admissible_space
from service.dynamics.inverse.monomial_sums import MAX_COEFFICIENT_BITS
from service.dynamics.inverse.polynomials import (
    PolynomialSum,
    as_polynomial,
    degree,
    difference,
    homogeneous_on_sphere,
    on_sphere,
    product,
    quadratic,
)
from service.dynamics.inverse.section import formula_text
from service.dynamics.inverse.sphere_means import mean_product
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms.monomials import monomial_sum

MORE_DEGREES = 6
"""Default excess of the search degree over the degree of V."""

MAX_RATIO_BITS = 1024
"""Largest size of numerator and denominator of A/C, 300 digits: beyond it answers are too long to be
written."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """The admissible polynomial nearest to a polynomial V, among all those in ``space``.

    ``distances[n]`` is <(V - P)²>/<V²> for the nearest P of degree ≤ n, means over
    the sphere of the potentials as they are: a constant counts in <V²>, though the
    constant of P always fits that of V. The last one is that of ``expression``; it
    is 0 if and only if V is in the space.
    """

    expression: str
    distances: tuple[Fraction, ...]
    space: AdmissibleSpace

    @property
    def relative_squared_distance(self) -> Fraction:
        """<(V - P)²>/<V²>."""
        return self.distances[-1]


def nearest_admissible(
    body: RigidBody, potential: Potential, *, highest: int | None = None
) -> Nearest | None:
    """Return the nearest admissible polynomial, None if ``potential`` is not a polynomial of moderate degree.

    None too where A/C has more than ``MAX_RATIO_BITS``, or the answer would be beyond the limits of formulas.
    It is searched among all of at most the degree ``highest``; if that is left
    out, the degree of ``potential`` on the sphere plus ``MORE_DEGREES``.

    Raises
    ------
    EqualMomentsError
        A = C.
    """
    body.require_planar()
    polynomial = as_polynomial(potential)
    if polynomial is None or not _are_short([body.alpha], bits=MAX_RATIO_BITS):
        return None
    highest = degree(polynomial) + MORE_DEGREES if highest is None else highest
    space = admissible_space(body.alpha, highest)
    expression = _text(space.alpha, space.nearest_to(polynomial))
    square = mean_product(polynomial, polynomial)
    # What is left is orthogonal to the projection P: <(V - P)²> = <V²> - <P²>.
    distances = [(square - each) / square if square else Fraction(0) for each in space.squares(polynomial)]
    if expression is None or not _are_short(distances):
        return None
    return Nearest(expression, tuple(distances), space)


def nearest_expression(space: AdmissibleSpace, potential: Potential) -> str | None:
    """Return the polynomial of ``space`` nearest to ``potential``; None as :func:`nearest_admissible`."""
    polynomial = as_polynomial(potential)
    return None if polynomial is None else _text(space.alpha, space.nearest_to(polynomial))


def _text(alpha: Fraction, polynomial: PolynomialSum) -> str | None:
    """Return a polynomial on the sphere as a formula, None if that is beyond the limits of formulas."""
    return formula_text(format_tree(_formula(alpha, polynomial))) if _are_short(polynomial.values()) else None


def _are_short(values: Iterable[Fraction], *, bits: int = MAX_COEFFICIENT_BITS) -> bool:
    """Return whether the numbers are of a size that is written out."""
    return all(max(value.numerator.bit_length(), value.denominator.bit_length()) <= bits for value in values)


def _formula(alpha: Fraction, polynomial: PolynomialSum) -> Tree:
    """Return a polynomial on the sphere as a formula, with what is Q G(g2) in one piece."""
    even = {e: value for e, value in polynomial.items() if not (e[0] % 2 or e[2] % 2)}
    # On the sphere Q/C = (α - 1) g1² + 1 - g2², so that G is the coefficient of g1².
    G = {(0, j, 0): value / (alpha - 1) for (i, j, _), value in on_sphere(even).items() if i == 2}
    product_with_G = product(quadratic(alpha), G)
    rest = homogeneous_on_sphere(difference(polynomial, product_with_G))
    tree = monomial_sum(_ordered(rest))
    if not G:
        return tree
    part = Binary("*", monomial_sum(quadratic(alpha)), monomial_sum(_ordered(G)))
    return Binary("+", tree, part) if rest else part


def _ordered(polynomial: PolynomialSum) -> PolynomialSum:
    """Return the same terms by rising degree, those of one degree by falling powers of g1, g2, g3."""
    return {e: polynomial[e] for e in sorted(polynomial, key=lambda e: (sum(e), [-power for power in e]))}
