"""Limits of one proof: how many terms, products and bits its polynomials may take."""

from dataclasses import dataclass
from math import comb

from flint import fmpq_mpoly

from service.dynamics.verdict.exact_ring.layout import NoProofError

MAX_TERMS = 20_000
"""Terms of one polynomial; beyond, the numeric route is the faster one."""
MAX_WORK = 4_000_000
"""Products of terms in one proof, about a second."""
MAX_BITS = 2**27
"""Bits of all coefficients of one polynomial (16 MB): flint aborts the process if it gets no memory."""


@dataclass(slots=True)
class Work:
    """Products of terms spent on one proof, in all its rings.

    Raises (all methods)
    --------------------
    NoProofError
        Too many terms, too much work.
    """

    spent: int = 0

    def spend(self, products: int) -> None:
        """Count operations; abandon the proof when it gets too long."""
        self.spent += products
        if products > MAX_WORK // 4 or self.spent > MAX_WORK:
            raise NoProofError("polynomials too large for a proof")

    def expand(self, terms: int, exponent: int, factor: int, bits: int) -> None:
        """Give up before ``factor`` terms times a power of ``terms`` terms would be too large.

        ``bits`` are those of the largest coefficient that can come of it.
        """
        # Both above 64 is too many terms, and would make the binomial itself long.
        smaller = min(max(terms - 1, 0), exponent)
        count = comb(exponent + terms - 1, smaller) if 0 < smaller <= 64 else 1
        if smaller > 64 or count > MAX_TERMS:
            raise NoProofError("a power with too many terms for a proof")
        self.spend(factor * count)
        require_room(factor * count, bits)


def require_room(terms: int, bits: int) -> None:
    """Give up before ``terms`` coefficients of so many bits would take too much memory."""
    if terms * bits > MAX_BITS:
        raise NoProofError("coefficients too large for a proof")


def height(polynomial: fmpq_mpoly) -> int:
    """Return the bits of the largest numerator or denominator among the coefficients."""
    return max((int(coefficient.height_bits()) for coefficient in polynomial.coeffs()), default=0)
