"""Fractional powers in the ring: split over factors of known sign, nested roots simplified.

(c m Π f_j^(k_j))^e, with c > 0 a rational number, m a monomial and the f_j
irreducible polynomials, is the product of

* c^e in roots of primes, and the positive generators of m to the power e;
* (σ f_j)^(k_j e) where σ is the sign of f_j, known wherever the formula has a value;
* of the others, |f_j|^e for the even part of k_j, and (± Π f_j)^e for the odd
  ones together: where the formula has a value that product is positive. If it
  is one factor alone, its sign is known by that.
"""

from fractions import Fraction
from math import gcd, lcm

from flint import fmpq_mpoly, fmpz

from service.dynamics.verdict.exact_ring.factors import as_fraction, prime_powers
from service.dynamics.verdict.exact_ring.generators import Element, Root
from service.dynamics.verdict.exact_ring.layout import LayoutTooSmallError
from service.dynamics.verdict.exact_ring.products import SignedFactors, Splitting
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.algebraic_numbers import AlgebraicNumbers
from service.dynamics.verdict.ring_functions.denesting import Denesting, RootArithmetic

MAX_DENESTED = 1000
"""Roots of a higher degree are not looked for among the elements of the ring."""


class Radicals:
    """Fractional powers in one ring."""

    def __init__(
        self, ring: Ring, algebra: RootArithmetic, numbers: AlgebraicNumbers, splitting: Splitting
    ) -> None:
        self._ring = ring
        self._algebra = algebra
        self._numbers = numbers
        self._splitting = splitting
        self._denesting = Denesting(ring, algebra, numbers, splitting.signs)

    def power(self, base: Element, exponent: Fraction, times: int = 1) -> Element:
        """Return (base^times)^exponent for an exponent that is no integer."""
        ring = self._ring
        parts = self._splitting.of(base, times)
        powers = {index: self._scaled(index, e * exponent) for index, e in parts.generators.items()}
        result = ring.multiply(ring.monomial(powers), self._power_of_numbers(parts, exponent))
        for piece, power in parts.positive:
            result = ring.multiply(result, self._power_of_positive(piece, power * exponent))
        for piece, power in parts.squares:
            # |f|^(power · exponent), through f².
            result = ring.multiply(
                result, self._power_of_positive(piece**2, power // 2 * exponent, of_square=True)
            )
        if parts.together is not None:
            result = ring.multiply(
                result, self._power_of_generator(f"root:{parts.together.text}", parts.together, exponent)
            )
        return result

    def _power_of_numbers(self, parts: SignedFactors, exponent: Fraction) -> Element:
        """Return the power of all that is a number in ``parts``, and take it out of them."""
        ring, number = self._ring, self.take_number(parts)
        result = self.power_of_number(parts.coefficient, exponent)
        if number is None:
            return result
        if exponent.denominator < MAX_DENESTED:
            for prime, _ in fmpz(exponent.denominator).factor():
                found = self.root_of_number(number, int(prime))
                if found is not None:
                    return ring.multiply(result, self._algebra.power(found, exponent * int(prime)))
        return ring.multiply(result, self._power_of_generator(f"root:{number.text}", number, exponent))

    def take_number(self, parts: SignedFactors) -> Element | None:
        """Take the irrational algebraic numbers out of the factors, as one with coprime integers.

        26 + 15√3 is a cube, √3 + 26/15 is none. None if there are none.
        """
        ring = self._ring
        chosen = [(f, k) for f, k in parts.positive if k > 0 and self._numbers.contains(ring.polynomial(f))]
        if not chosen:
            return None
        number = ring.constant(Fraction(1))
        for piece, power in chosen:
            number = ring.multiply(number, ring.integer_power(ring.polynomial(piece), power))
        number = ring.normal(number)
        coefficients = [as_fraction(value) for value in number.numerator.coeffs()]
        content = Fraction(
            gcd(*(value.numerator for value in coefficients)),
            lcm(*(value.denominator for value in coefficients)),
        )
        parts.coefficient *= content
        parts.positive = [pair for pair in parts.positive if pair not in chosen]
        number = ring.multiply(number, ring.constant(1 / content))
        return None if number.is_number else number

    def root_of_number(self, number: Element, prime: int) -> Element | None:
        """Return the root of a positive algebraic number, if the ring has it or simpler roots for it."""
        return self._denesting.root(number.numerator, prime)

    def power_of_number(self, number: Fraction, exponent: Fraction) -> Element:
        """Return number^exponent, number > 0, in roots of primes."""
        ring = self._ring
        result = ring.constant(Fraction(1))
        for prime, multiplicity in prime_powers(number):
            base = ring.constant(Fraction(prime))
            whole, rest = divmod(multiplicity * exponent, 1)
            result = ring.multiply(result, self._algebra.power(base, Fraction(whole)))
            if rest:
                result = ring.multiply(result, self._root_of_prime(prime, base, rest))
        return result

    def _root_of_prime(self, prime: int, base: Element, exponent: Fraction) -> Element:
        ring, key = self._ring, f"prime:{prime}"
        if ring.find(key) is None and self._numbers.has_nested_roots():
            alias = f"{key}^(1/{exponent.denominator})"
            if alias not in ring.aliases:
                found = self._numbers.root(base, exponent.denominator)
                if found is not None:
                    ring.aliases[alias] = found
            if alias in ring.aliases:
                return ring.normal(ring.integer_power(ring.aliases[alias], exponent.numerator))
        return self._power_of_generator(key, base, exponent)

    def _power_of_positive(
        self, piece: fmpq_mpoly, exponent: Fraction, *, of_square: bool = False
    ) -> Element:
        """Return piece^exponent for a factor that is positive wherever the formula has a value."""
        base = self._ring.polynomial(piece)
        if exponent.denominator == 1:
            return self._algebra.power(base, exponent)
        key = f"root:{base.text}"
        if not of_square and self._ring.find(key) is None:
            for prime, _ in (
                fmpz(exponent.denominator).factor() if exponent.denominator < MAX_DENESTED else ()
            ):
                found = self._denesting.root(piece, int(prime))
                if found is not None:
                    return self._algebra.power(found, exponent * int(prime))
        return self._power_of_generator(key, base, exponent)

    def _scaled(self, index: int, exponent: Fraction) -> int:
        """Return ``exponent`` as an integer, or request a ring in which it is one."""
        if exponent.denominator == 1:
            return exponent.numerator
        raise self._finer(self._ring.key(index), exponent.denominator)

    def _finer(self, key: str, denominator: int) -> LayoutTooSmallError:
        layout = self._ring.layout
        return LayoutTooSmallError(layout.with_degree(key, layout.degree(key) * denominator))

    def _power_of_generator(self, key: str, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent through the generator base^(1/degree)."""
        degree = self._ring.layout.degree(key)
        scaled = exponent * degree
        if scaled.denominator != 1:
            raise self._finer(key, scaled.denominator)
        index = self._ring.find(key)
        if index is None:
            index = self._ring.atom(key, Root(base, degree))
        return self._ring.monomial({index: scaled.numerator})
