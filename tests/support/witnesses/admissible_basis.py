"""A basis of the admissible polynomials, written out."""

from collections.abc import Iterator
from fractions import Fraction

from service.dynamics.inverse.projection import AdmissibleSpace
from service.dynamics.potentials.terms import Exponents


def basis_of(space: AdmissibleSpace) -> Iterator[dict[Exponents, Fraction]]:
    """Yield the polynomials of a basis, each homogeneous of one of the two largest degrees."""
    # The blocks of the two largest degrees have all polynomials on the sphere: g1² + g2² + g3² = 1.
    for blocks in space.blocks[max(space.degree - 1, 0) :]:
        for block in blocks:
            for row in block.rows.tolist():
                pairs = zip(block.monomials, row, strict=True)
                yield {exponents: Fraction(int(value)) for exponents, value in pairs if value}
