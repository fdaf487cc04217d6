"""Finds the nearest admissible potential of a polynomial, by projection in the mean square on the sphere.

All means of polynomials over the sphere are rational, and so is everything here.

The mean of g1^i g2^j g3^k is (i-1)!! (j-1)!! (k-1)!! / (i+j+k+1)!! if i, j, k are
even and 0 otherwise.

The admissible polynomials up to a degree are the kernel of the compatibility equation. On the sphere |g|² =
1 a polynomial of degree ≤ N equals the sum of a homogeneous one of degree N and one of degree N - 1: every
monomial is multiplied by |g|² as often as needed. L takes homogeneous polynomials of degree n to those of
degree n + 1, so L(V) vanishes on the sphere if and only if it vanishes identically for both parts (it does
not matter which multiple by |g|² is taken, since L(|g|² W) = |g|² L(W)). That is linear algebra over the
integers; no formula for the solutions is assumed.

L takes monomials with given parities of the three exponents to monomials with
the opposite ones. Hence the kernel is the sum of small blocks, and blocks with
different parities are orthogonal in the mean over the sphere.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import product as pairs_of
from math import gcd, prod

from flint import fmpq, fmpq_mat, fmpz_mat, fmpz_mpoly_ctx

from service.dynamics.body import RigidBody
from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.formula.tree import Binary, Tree, format_tree
from service.dynamics.inverse.polynomials import (
    MAX_COEFFICIENT_BITS,
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
from service.dynamics.potentials.potential import Potential
from service.dynamics.potentials.terms import Exponents, monomial_sum


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


Parities = tuple[int, int, int]
"""Parities of the exponents of g1, g2, g3."""


@dataclass(frozen=True, slots=True)
class PolynomialBlock:
    """The admissible homogeneous polynomials of one degree with given parities of the exponents.

    ``rows`` has one of a basis in every row: the coefficients of ``monomials``.
    """

    parities: Parities
    monomials: tuple[Exponents, ...]
    rows: fmpz_mat

    @property
    def dimension(self) -> int:
        """The number of polynomials in a basis."""
        return int(self.rows.nrows())

    def project(self, polynomial: PolynomialSum) -> tuple[dict[Exponents, Fraction], Fraction]:
        """Return the nearest polynomial of the block, and the mean of its square."""
        same = {e: c for e, c in polynomial.items() if tuple(power % 2 for power in e) == self.parities}
        if not (same and self.dimension):
            return {}, Fraction(0)
        rows, one = fmpq_mat(self.rows), [fmpq(c.numerator, c.denominator) for c in same.values()]
        moments = rows * _means(self.monomials, tuple(same)) * fmpq_mat(len(one), 1, one)
        gram = rows * _means(self.monomials, self.monomials) * rows.transpose()
        weights = gram.solve(moments).transpose()
        coefficients = zip(self.monomials, map(as_fraction, (weights * rows).entries()), strict=True)
        return {e: value for e, value in coefficients if value}, as_fraction((weights * moments)[0, 0])


@dataclass(frozen=True, slots=True)
class AdmissibleSpace:
    """The admissible polynomials of degree ≤ ``degree`` on the sphere, for A/C = ``alpha``.

    ``blocks[n]`` has the homogeneous ones of degree n, for n = 0, ..., ``degree``.
    """

    alpha: Fraction
    degree: int
    blocks: tuple[tuple[PolynomialBlock, ...], ...]

    @property
    def dimension(self) -> int:
        """The number of polynomials in a basis."""
        return sum(block.dimension for block in self._up_to(self.degree))

    def nearest_to(self, polynomial: PolynomialSum) -> dict[Exponents, Fraction]:
        """Return the nearest to ``polynomial``, whose degree may be larger than that of the space."""
        total: dict[Exponents, Fraction] = {}
        for block in self._up_to(self.degree):
            total |= block.project(polynomial)[0]
        return total

    def squares(self, polynomial: PolynomialSum) -> list[Fraction]:
        """Return the mean of the square of the nearest to ``polynomial`` of degree ≤ n, n = 0, 1, ..."""
        homogeneous = [
            sum((block.project(polynomial)[1] for block in blocks), start=Fraction(0))
            for blocks in self.blocks
        ]
        # Those of even and of odd degrees are orthogonal.
        return [square + (homogeneous[n - 1] if n else 0) for n, square in enumerate(homogeneous)]

    def _up_to(self, n: int) -> Iterator[PolynomialBlock]:
        """Yield the blocks that together have all polynomials of degree ≤ n."""
        for blocks in self.blocks[max(n - 1, 0) : n + 1]:
            yield from blocks


def admissible_space(alpha: Fraction, degree: int) -> AdmissibleSpace:
    """Return all admissible polynomials of degree ≤ ``degree`` on the sphere, for A/C = ``alpha`` ≠ 1."""
    return AdmissibleSpace(alpha, degree, tuple(_blocks(alpha, n) for n in range(degree + 1)))


def _blocks(alpha: Fraction, n: int) -> tuple[PolynomialBlock, ...]:
    return tuple(
        _block(alpha, n, (a, b, c)) for a, b, c in pairs_of((0, 1), repeat=3) if (n - a - b - c) % 2 == 0
    )


def _block(alpha: Fraction, n: int, parities: Parities) -> PolynomialBlock:
    a, b, c = parities
    monomials = tuple(
        (i, j, n - i - j) for i in range(a, n + 1, 2) for j in range(b, n + 1 - i, 2) if n - i - j >= c
    )
    images = [_residual(alpha, monomial) for monomial in monomials]
    places = sorted({exponents for image in images for exponents in image})
    # One extra row of zeros: the kernel of a matrix without rows is not defined.
    entries = [image.get(place, 0) for place in places for image in images]
    matrix = fmpz_mat(len(places) + 1, len(monomials), [*entries, *([0] * len(monomials))])
    kernel, dimension = matrix.nullspace()
    columns = kernel.transpose().tolist()[:dimension]
    primitive = [value for column in columns for value in _primitive([int(value) for value in column])]
    return PolynomialBlock(parities, monomials, fmpz_mat(dimension, len(monomials), primitive))


def _residual(alpha: Fraction, exponents: Exponents) -> dict[Exponents, int]:
    """Return L of a monomial, times the denominator of α."""
    ring = fmpz_mpoly_ctx.get(("g1", "g2", "g3"), "degrevlex")
    first = [ring.from_dict({exponents: 1}).derivative(position) for position in range(3)]
    second = [[part.derivative(position) for position in range(3)] for part in first]
    A, C = ring.constant(alpha.numerator), ring.constant(alpha.denominator)
    residual = pde_residual(A, C, ring.gens(), first, second)
    return {(int(i), int(j), int(k)): int(value) for (i, j, k), value in residual.to_dict().items()}


def _primitive(values: Sequence[int]) -> list[int]:
    content = gcd(*values)
    return [value // content for value in values]


def _means(left: Sequence[Exponents], right: Sequence[Exponents]) -> fmpq_mat:
    """Return the means of the products of monomials, all exponents of a product being even."""
    entries: list[fmpq] = []
    for one, other in pairs_of(left, right):
        i, j, k = (a + b for a, b in zip(one, other, strict=True))
        above = odd_factorial(i - 1) * odd_factorial(j - 1) * odd_factorial(k - 1)
        entries.append(fmpq(above, odd_factorial(i + j + k + 1)))
    return fmpq_mat(len(left), len(right), entries)


EXCESS_DEGREES = 6
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
    out, the degree of ``potential`` on the sphere plus ``EXCESS_DEGREES``.

    Raises
    ------
    EqualMomentsError
        A = C.
    """
    body.require_planar()
    polynomial = as_polynomial(potential)
    if polynomial is None or not _are_short([body.alpha], bits=MAX_RATIO_BITS):
        return None
    highest = degree(polynomial) + EXCESS_DEGREES if highest is None else highest
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
