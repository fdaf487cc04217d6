"""Fractional powers in the ring: split over factors of known sign, nested roots simplified.

(c m Π f_j^(k_j))^e, with c > 0 a rational number, m a monomial and the f_j
irreducible polynomials, is the product of

* c^e in roots of primes, and the positive generators of m to the power e;
* (σ f_j)^(k_j e) where σ is the sign of f_j, known wherever the formula has a value;
* of the others, |f_j|^e for the even part of k_j, and (± Π f_j)^e for the odd
  ones together: where the formula has a value that product is positive. If it
  is one factor alone, its sign is known by that.

Roots of roots become ring elements or sums of simpler roots where a proof succeeds. A candidate b for the
p-th root of f > 0 comes from one of

* the digits, if f is a number: see :mod:`.algebraic_numbers`;
* u^d = a x + r, which makes x a polynomial in u: f may then be recognised as a power;
* f = X + Y u with u² = w, and c² = X² - w Y²:
  (√((X + c)/2) ± √((X - c)/2))² = X ± √(w Y²), for p = 2. Where f > 0 and c ≠ 0
  the conjugate X - Y u = c²/f is positive too, hence X and both (X ± c)/2, whose
  product is w Y²/4.

and is accepted if b^p = f in normal form and b > 0 by its signs.
"""

from fractions import Fraction
from math import gcd, isqrt, lcm
from typing import Protocol

from flint import fmpq_mpoly, fmpz

from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.verdict.exact_ring.generators import (
    Element,
    LayoutTooSmallError,
    Root,
    UndefinedInOctantError,
)
from service.dynamics.verdict.exact_ring.products import (
    SignedFactors,
    Splitting,
    factorise,
    irreducible_factors,
    prime_powers,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.exact_ring.signs import Signs, conjugates
from service.dynamics.verdict.ring_functions.algebraic_numbers import AlgebraicNumbers

MAX_NESTED_ROOTS = 4
"""Roots within roots."""
MAX_TERMS = 40
"""Terms of a polynomial whose root is looked for."""


class RootArithmetic(Protocol):
    """The part of the ring's algebra that roots use."""

    def power(self, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent."""
        ...


class Denesting:
    """Looks for roots of irreducible polynomials in one ring."""

    def __init__(self, ring: Ring, algebra: RootArithmetic, numbers: AlgebraicNumbers, signs: Signs) -> None:
        self._ring = ring
        self._algebra = algebra
        self._numbers = numbers
        self._signs = signs
        self._depth = 0

    def root(self, piece: fmpq_mpoly, prime: int) -> Element | None:
        """Return the positive root of a polynomial, positive wherever the formula has a value, or None."""
        if len(piece) > MAX_TERMS or self._depth >= MAX_NESTED_ROOTS:
            return None
        self._depth += 1
        try:
            ring, base = self._ring, self._ring.polynomial(piece)
            if self._numbers.contains(base):
                found = self._by_norm(piece) if prime == 2 else None
                return found if found is not None else self._of_number(base, prime)
            if all(degree <= 0 or index >= ring.rho_index for index, degree in enumerate(piece.degrees())):
                return self._by_norm(piece) if prime == 2 else None
            found = self._by_substitution(piece, prime)
            if found is None and prime == 2:
                found = self._by_norm(piece)
            return found
        finally:
            self._depth -= 1

    def _of_number(self, base: Element, prime: int) -> Element | None:
        """Return the root of a number that is b or b q^(1/prime), b in the field and q rational."""
        found = self._numbers.root(base, prime)
        if found is not None:
            return found
        q = self._numbers.rational_part(base, prime)
        if q is None or q == 1:
            return None
        found = self._numbers.root(self._ring.multiply(self._ring.constant(1 / q), base), prime)
        if found is None:
            return None
        return self._ring.multiply(found, self._algebra.power(self._ring.constant(q), Fraction(1, prime)))

    # --- f a power in another variable ------------------------------------------

    def _by_substitution(self, piece: fmpq_mpoly, prime: int) -> Element | None:
        ring, seen = self._ring, piece
        for index, nature in ring.natures.items():
            if isinstance(nature, Root) and index != ring.rho_index and int(seen.degrees()[index]) > 0:
                seen = self._substituted(seen, index, nature)
        if seen == piece or len(seen) > MAX_TERMS:
            return None
        number, pieces = irreducible_factors(ring, seen)
        if number <= 0 or any(power % prime for _, power in pieces):
            return None
        root, sign = ring.constant(Fraction(1)), 1
        for factor, power in pieces:
            root = ring.multiply(root, ring.integer_power(ring.polynomial(factor), power // prime))
            if prime == 2 and power // prime % 2:
                sign *= self._signs.of(factor)
        if sign == 0:
            return None
        root = ring.multiply(ring.constant(Fraction(sign)), root)
        root = ring.multiply(root, self._algebra.power(ring.constant(number), Fraction(1, prime)))
        return root if self._is_root(root, piece, prime) else None

    def _substituted(self, piece: fmpq_mpoly, index: int, nature: Root) -> fmpq_mpoly:
        """Return the polynomial with a coordinate eliminated by u^d = a x + r, unchanged if there is none."""
        ring = self._ring
        if any(nature.base.shift):
            return piece
        base = nature.base.numerator
        for coordinate in ring.coordinate_index:
            # base = a x^k + r with a number a: x^k is a polynomial in u and the rest.
            powers = {int(term[coordinate]) for term in base.monoms()}
            k = max(powers)
            exponents = {int(term[coordinate]) for term in piece.monoms()}
            x = ring.context.gen(coordinate)
            leading = [(t, c) for t, c in base.terms() if int(t[coordinate]) == k]
            if k == 0 or not powers <= {0, k} or len(leading) > 1 or any(e % k for e in exponents):
                continue
            slope = ring.context.term(exp_vec=leading[0][0], coeff=leading[0][1]) / x**k
            if not slope.is_constant():
                continue
            value = x**k - (base - ring.context.gen(index) ** nature.degree) / slope.leading_coefficient()
            ring.work.spend(len(piece) * len(value) ** (1 + max(exponents) // k))
            return self._replaced(piece, coordinate, k, value)
        return piece

    def _replaced(self, piece: fmpq_mpoly, coordinate: int, k: int, value: fmpq_mpoly) -> fmpq_mpoly:
        """Return the polynomial with x^k replaced by the value."""
        total = self._ring.context.constant(0)
        for exponents, coefficient in piece.terms():
            rest = [int(e) for e in exponents]
            times, rest[coordinate] = rest[coordinate] // k, 0
            total += self._ring.context.term(exp_vec=tuple(rest), coeff=coefficient) * value**times
        return total

    # --- f = X + Y u with u² = w ------------------------------------------------

    def _by_norm(self, piece: fmpq_mpoly) -> Element | None:
        for mirrored in conjugates(self._ring, piece):
            found = self._sum_of_roots(piece, mirrored)
            if found is not None:
                return found
        return None

    def _sum_of_roots(self, piece: fmpq_mpoly, mirrored: fmpq_mpoly) -> Element | None:
        ring, algebra = self._ring, self._algebra
        found = self._formal_square_root(ring.polynomial(piece * mirrored))
        if found is None:
            return None
        X = ring.polynomial((piece + mirrored) / 2)
        half = ring.constant(Fraction(1, 2))
        sums = [ring.normal(ring.multiply(half, ring.add(X, part))) for part in (found, ring.negate(found))]
        if any(part.is_zero for part in sums):
            return None
        # g2 is a polynomial in no other generator: as a root it is welcome only if the roots come out.
        x2 = ring.coordinate_index[1]
        if int((piece - mirrored).degrees()[x2]) > 0 and any(
            self._formal_square_root(part) is None for part in sums
        ):
            return None
        try:
            first, second = (algebra.power(part, Fraction(1, 2)) for part in sums)
        except UndefinedInOctantError:
            return None
        total = ring.add(first, second)
        if self._is_root(total, piece, 2):
            return total
        difference = ring.add(first, ring.negate(second))
        if self._is_root(difference, piece, 2):
            # Its sign is that of (X + c)/2 - (X - c)/2.
            sign = self._sign_of(found)
            return ring.multiply(ring.constant(Fraction(sign)), difference) if sign else None
        return None

    def _formal_square_root(self, element: Element) -> Element | None:
        """Return c with c² = element, of any sign, if the factors of the element show one."""
        ring = self._ring
        try:
            factors = factorise(ring, element)
        except UndefinedInOctantError:
            return None
        number, pieces = irreducible_factors(ring, factors.rest)
        root = _square_root(number * factors.coefficient)
        if root is None or any(e % 2 for e in factors.exponents) or any(power % 2 for _, power in pieces):
            return None
        monomial = ring.monomial({index: e // 2 for index, e in enumerate(factors.exponents) if e})
        result = ring.multiply(ring.constant(root), monomial)
        for piece, power in pieces:
            result = ring.multiply(result, ring.integer_power(ring.polynomial(piece), power // 2))
        return result

    # --- proofs ---------------------------------------------------------------------

    def _is_root(self, root: Element, piece: fmpq_mpoly, prime: int) -> bool:
        ring = self._ring
        power = ring.normal(ring.integer_power(root, prime))
        return ring.normal(ring.add(power, ring.negate(ring.polynomial(piece)))).is_zero

    def _sign_of(self, element: Element) -> int:
        ring = self._ring
        factors = factorise(ring, element)
        number, pieces = irreducible_factors(ring, factors.rest)
        sign = 1 if number * factors.coefficient > 0 else -1
        pieces += [(ring.context.gen(index), e) for index, e in enumerate(factors.exponents)]
        for piece, power in pieces:
            sign *= self._signs.of(piece) if power % 2 else 1
        return sign


def _square_root(number: Fraction) -> Fraction | None:
    if number < 0:
        return None
    root = Fraction(isqrt(number.numerator), isqrt(number.denominator))
    return root if root * root == number else None


MAX_DENESTED_DEGREE = 1000
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
        if exponent.denominator < MAX_DENESTED_DEGREE:
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
                fmpz(exponent.denominator).factor() if exponent.denominator < MAX_DENESTED_DEGREE else ()
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
