"""Splits factors off a ring element: its number, its monomial, its powers of rho and of g2²."""

from dataclasses import dataclass
from fractions import Fraction
from math import isqrt

from flint import fmpq_mpoly, fmpz

from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.verdict.exact_ring.generators import Cosine, Divisor, Element, exponents_of
from service.dynamics.verdict.exact_ring.layout import NoProofError, UndefinedInOctantError
from service.dynamics.verdict.exact_ring.ring import Ring

MAX_FACTORED_BITS = 64
"""Integers up to this size are split into primes under roots and logarithms."""
MAX_NAMED_BITS = 4096
"""Larger integers do not become generators of their own."""


@dataclass(frozen=True, slots=True)
class Factors:
    """coefficient · monomial · rest, with rest = 1 or a polynomial with leading coefficient 1."""

    coefficient: Fraction
    exponents: tuple[int, ...]
    rest: fmpq_mpoly

    @property
    def is_monomial(self) -> bool:
        """Whether nothing is left beside the number and the monomial."""
        return self.rest.is_one()


def factorise(ring: Ring, element: Element, *, divisors: bool = True) -> Factors:
    """Split ``element``, by default also into the divisors of the ring.

    Raises
    ------
    UndefinedInOctantError
        The element is zero, where every caller needs it not to be.
    """
    element = ring.normal(element)
    if element.is_zero:
        raise UndefinedInOctantError("zero where a number different from zero is needed")
    numerator = element.numerator
    content = numerator.term_content()
    exponents = [a + b for a, b in zip(exponents_of(content), element.shift, strict=True)]
    rest = numerator / content
    leading = rest.leading_coefficient()
    coefficient = content.coefficient(0) * leading
    rest = rest / leading
    if len(rest) > 1:
        rest = _extract(ring, rest, exponents, ring.rho, {ring.rho_index: ring.layout.degree("rho")})
        x2 = ring.coordinate_index[1]
        monic = -ring.g2_squared
        flips, rest = _divide_out(ring, rest, monic)
        exponents[x2] += flips * 2 * ring.layout.degree("g2")
        coefficient = -coefficient if flips % 2 else coefficient
        for index, nature in ring.natures.items():
            if isinstance(nature, Divisor) and divisors:
                rest = _extract(ring, rest, exponents, nature.base.numerator, {index: 1})
            elif isinstance(nature, Cosine):
                # 1 - sin² is cos².
                flips, rest = _divide_out(ring, rest, ring.context.gen(nature.sine) ** 2 - 1)
                exponents[index] += 2 * flips
                coefficient = -coefficient if flips % 2 else coefficient
    return Factors(as_fraction(coefficient), tuple(exponents), rest)


def conjugate(ring: Ring, rest: fmpq_mpoly) -> Element | None:
    """Return rest with g2 -> -g2 if rest is a polynomial in g1, g2, g3 that has g2; else None.

    Multiplied by it, a divisor loses g2; so 1/(1 + g2) = (1 - g2)/rho, and
    H, which has no g2 either, can be cancelled down. The conjugate of a
    non-zero polynomial on the sphere is not zero.
    """
    x1, x2, x3 = ring.coordinate_index
    degrees = rest.degrees()
    others = [d for index, d in enumerate(degrees) if index not in (x1, x2, x3, ring.pi_index)]
    if ring.layout.degree("g2") != 1 or degrees[x2] == 0 or any(others):
        return None
    # In normal form g2 has no higher power than the first.
    return ring.polynomial(rest - 2 * ring.context.gen(x2) * rest.derivative(x2))


def prime_powers(number: Fraction) -> list[tuple[int, int]]:
    """Return number > 0 as powers of primes (of large integers where factoring may be slow)."""
    found: list[tuple[int, int]] = []
    for part, sign in ((number.numerator, 1), (number.denominator, -1)):
        if part.bit_length() <= MAX_FACTORED_BITS:
            found += [(int(prime), sign * int(times)) for prime, times in fmpz(part).factor()]
        elif part.bit_length() > MAX_NAMED_BITS:
            raise NoProofError(f"a root or logarithm of an integer beyond {MAX_NAMED_BITS} bits")
        else:
            root = isqrt(part)
            found.append((root, 2 * sign) if root * root == part else (part, sign))
    return found


def _extract(
    ring: Ring, rest: fmpq_mpoly, exponents: list[int], divisor: fmpq_mpoly, gain: dict[int, int]
) -> fmpq_mpoly:
    times, rest = _divide_out(ring, rest, divisor)
    for index, exponent in gain.items():
        exponents[index] += times * exponent
    return rest


def _divide_out(ring: Ring, rest: fmpq_mpoly, divisor: fmpq_mpoly) -> tuple[int, fmpq_mpoly]:
    times = 0
    while len(rest) > 1:
        quotient = ring.exact_quotient(rest, divisor)
        if quotient is None:
            break
        times, rest = times + 1, quotient
    return times, rest
