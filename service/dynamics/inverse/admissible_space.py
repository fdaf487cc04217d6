"""All admissible polynomials up to a degree, found as the kernel of the compatibility equation.

On the sphere |g|² = 1 a polynomial of degree ≤ N equals the sum of a homogeneous
one of degree N and one of degree N - 1: every monomial is multiplied by |g|² as
often as needed. L takes homogeneous polynomials of degree n to those of degree
n + 1, so L(V) vanishes on the sphere if and only if it vanishes identically for
both parts (it does not matter which multiple by |g|² is taken, since
L(|g|² W) = |g|² L(W)). That is linear algebra over the integers; no formula for
the solutions is assumed.

L takes monomials with given parities of the three exponents to monomials with
the opposite ones. Hence the kernel is the sum of small blocks, and blocks with
different parities are orthogonal in the mean over the sphere.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import product as pairs_of
from math import gcd

from flint import fmpq, fmpq_mat, fmpz_mat, fmpz_mpoly_ctx

from service.dynamics.equations.compatibility import pde_residual
from service.dynamics.inverse.polynomials import PolynomialSum
from service.dynamics.inverse.sphere_means import odd_factorial
from service.dynamics.potentials.terms.monomials import Exponents
from service.dynamics.verdict.exact_ring.factors import as_fraction

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
