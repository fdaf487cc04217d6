"""Algebraic numbers in the ring of a proof: inverses, roots and cosines inside the current field.

The generators that are algebraic numbers form a tower; its monomials span the
field K over Q. Whether a number is in K is guessed from its digits by lattice
reduction (LLL) and then proved exactly: b is the positive p-th root of β if
b^p = β in normal form and a ball of b is positive; b is a root of the minimal
polynomial m of 2 cos(2π/N) if a factor x^d - tail of m, found over K, has b and
the ball of the cofactor excludes zero. So a number gets a new generator only if
it is not in K (or if nothing was found, which hides a relation and proves
nothing wrong).
"""

from collections.abc import Callable
from fractions import Fraction
from itertools import product
from math import gcd

from flint import arb, ctx, fmpq, fmpq_mat, fmpz_mat, fmpz_poly

from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.verdict.exact_ring.generators import CosineOfTurn, Element, Root
from service.dynamics.verdict.exact_ring.products import prime_powers
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.exact_ring.signs import GeneratorValues


def rational_relation(numbers: Callable[[], list[arb]], count: int, bits: int) -> list[fmpq] | None:
    """Return c with numbers[count] = Σ c_k numbers[k] to ``bits``, the c of small height, or None.

    A guess, which the caller has to prove. ``numbers`` is called at a precision a little above ``bits``.
    """
    matrix = fmpz_mat(count + 1, count + 2)
    with ctx.workprec(bits + 64):
        for row, value in enumerate(numbers()):
            digits = (value * arb(2) ** bits).mid().floor().unique_fmpz()
            if digits is None:
                return None
            matrix[row, row] = 1
            matrix[row, count + 1] = digits
    shortest = matrix.lll().table()[0]
    factor = int(shortest[count])
    limit = 2 ** (bits // (count + 1) // 2 + 8)
    if factor == 0 or any(abs(int(value)) > limit * (count + 2) for value in shortest):
        return None
    return [fmpq(-int(value), factor) for value in shortest[:count]]


MAX_FIELD_DEGREE = 24
"""Degree of K over Q up to which numbers are looked for in it."""
MAX_LATTICE_NUMBERS = 32
"""Numbers in one lattice reduction."""
BITS_PER_NUMBER = 28
"""Bits of the values per number of a lattice: room for coefficients of about that size."""
PRODUCTS_OF_REDUCTION = 8
MAX_COSINE_ORDER = 120
"""Largest N of 2 cos(2π/N): beyond it, cosines of multiples of π are generators of their own."""

Monomial = tuple[tuple[int, int], ...]
"""Generators with their exponents."""


class AlgebraicNumbers:
    """The numbers of one ring."""

    def __init__(self, ring: Ring) -> None:
        self._ring = ring

    def contains(self, element: Element) -> bool:
        """Tell whether the element is an algebraic number by its generators."""
        degrees = zip(element.numerator.degrees(), element.shift, strict=True)
        return all(self._is_number(i) for i, (degree, shift) in enumerate(degrees) if degree > 0 or shift)

    def has_nested_roots(self) -> bool:
        """Tell whether K has more than roots of integers."""
        return any(not self._is_root_of_integer(index) for index in self._generators())

    def value(self, element: Element, bits: int) -> arb:
        """Return a ball of a number."""
        with ctx.workprec(bits):
            return GeneratorValues(self._ring).element(element)

    def reciprocal(self, element: Element) -> Element | None:
        """Return 1/element for a number without negative exponents, by linear algebra; None if K is large."""
        found = self._multiplication(element)
        if found is None:
            return None
        matrix, basis = found
        size = len(basis)
        unit = fmpq_mat(size, 1)
        unit[0, 0] = fmpq(1)
        try:
            solution = matrix.solve(unit)
        except ZeroDivisionError:
            return None
        return self._combination([solution[row, 0] for row in range(size)], basis)

    def rational_part(self, base: Element, degree: int) -> Fraction | None:
        """Return the only rational q, but for such powers, that may make base/q a power in K.

        From base = q b^degree follows N(base) = q^n N(b)^degree for the norm N
        of K, of degree n over Q: known if n and the degree have no common factor.
        """
        found = self._multiplication(base)
        if found is None or gcd(len(found[1]), degree) != 1:
            return None
        norm, inverse = as_fraction(found[0].det()), pow(len(found[1]), -1, degree)
        if not norm:
            return None
        q = Fraction(1)
        for prime, power in prime_powers(abs(norm)):
            q *= Fraction(prime) ** (power * inverse % degree)
        return q

    def _multiplication(self, element: Element) -> tuple[fmpq_mat, list[dict[int, int]]] | None:
        """Return the matrix of the multiplication by a number, and the basis; None if K is large."""
        basis = self._basis()
        if basis is None:
            return None
        ring, size = self._ring, len(basis)
        ring.work.spend(size**3)
        rows = {tuple(sorted(exponents.items())): row for row, exponents in enumerate(basis)}
        matrix = fmpq_mat(size, size)
        for column, exponents in enumerate(basis):
            multiple = ring.normal(ring.multiply(element, ring.plain(ring.monomial(exponents))))
            whole = self._in_basis(multiple, rows)
            if whole is None:
                return None
            for row, value in whole.items():
                matrix[row, column] = value
        return matrix, basis

    def root(self, base: Element, degree: int) -> Element | None:
        """Return the positive root of a positive number if it is found in K; ``degree`` ≥ 2."""
        found = self._member(lambda bits: self.value(base, bits).root(degree))
        if found is None:
            return None
        ring = self._ring
        power = ring.normal(ring.integer_power(found, degree))
        if not ring.normal(ring.add(power, ring.negate(base))).is_zero:
            return None
        return found if self.value(found, 256) > 0 else None

    def cosine_of_turn(self, order: int) -> Element:
        """Return 2 cos(2π/order) for an order ≥ 3, a new generator if it is not in K."""
        ring, key = self._ring, f"turn:{order}"
        index = ring.find(key)
        if index is not None:
            return ring.polynomial(ring.context.gen(index))
        if key not in ring.aliases:
            ring.aliases[key] = self._adjoin(key, order)
        return ring.aliases[key]

    def _adjoin(self, key: str, order: int) -> Element:
        ring = self._ring
        minimal = fmpz_poly.cos_minpoly(order)
        degree = int(minimal.degree())
        basis = self._basis() or [{}]
        for part in (d for d in range(1, degree) if degree % d == 0 and len(basis) > 1):
            tail = self._relation(basis, order, part)
            if tail is not None and self._divides(tail, part, minimal, order):
                if part == 1:
                    return tail[0]
                return self._generator(key, order, tail)
        return self._generator(key, order, [ring.constant(Fraction(-int(minimal[k]))) for k in range(degree)])

    def _generator(self, key: str, order: int, tail: list[Element]) -> Element:
        """Make the generator u with u^d = Σ tail[k] u^k."""
        ring = self._ring
        index = ring.next_atom()
        total = ring.constant(Fraction(0))
        for power, coefficient in enumerate(tail):
            # In too small a ring the index is invalid, and making the atom raises.
            term = ring.monomial({index: power}) if power and index >= 0 else ring.constant(Fraction(1))
            total = ring.add(total, ring.multiply(coefficient, ring.plain(term)))
        made = ring.atom(key, CosineOfTurn(order, total, len(tail)))
        return ring.polynomial(ring.context.gen(made))

    def _relation(self, basis: list[dict[int, int]], order: int, degree: int) -> list[Element] | None:
        """Return t_k in K with u^degree = Σ t_k u^k for u = 2 cos(2π/order), by the digits; to be proved."""
        count = len(basis) * degree
        bits = BITS_PER_NUMBER * (count + 1)

        def numbers() -> list[arb]:
            u = 2 * (2 * arb.pi() / order).cos()
            values = self._basis_values(basis)
            return [value * u**k for k in range(degree) for value in values] + [u**degree]

        found = self._integer_relation(numbers, count, bits)
        if found is None:
            return None
        size = len(basis)
        return [self._combination(found[k * size : (k + 1) * size], basis) for k in range(degree)]

    def _divides(self, tail: list[Element], degree: int, minimal: fmpz_poly, order: int) -> bool:
        """Tell whether x^degree - tail is proved a factor of the polynomial, the cosine its zero."""
        ring = self._ring
        # Division with remainder, the coefficients in K; minimal is monic.
        zero = ring.constant(Fraction(0))
        rest = [ring.constant(Fraction(int(minimal[k]))) for k in range(int(minimal.degree()) + 1)]
        quotient = [zero] * (len(rest) - degree)
        for top in range(len(rest) - 1, degree - 1, -1):
            leading = rest[top]
            quotient[top - degree] = leading
            for k in range(degree):
                change = ring.multiply(leading, tail[k])
                rest[top - degree + k] = ring.normal(ring.add(rest[top - degree + k], change))
            rest[top] = zero
        if any(not coefficient.is_zero for coefficient in rest):
            return False
        with ctx.workprec(512):
            u, values = 2 * (2 * arb.pi() / order).cos(), GeneratorValues(ring)
            total = arb(0)
            for coefficient in reversed(quotient):
                total = total * u + values.element(coefficient)
            return not total.contains(0)

    def _member(self, number_at: Callable[[int], arb]) -> Element | None:
        """Return the element of K that has the digits of the number, to be proved equal; None if none has."""
        basis = self._basis()
        if basis is None:
            return None
        bits = BITS_PER_NUMBER * (len(basis) + 1)

        def numbers() -> list[arb]:
            return [*self._basis_values(basis), number_at(bits + 64)]

        found = self._integer_relation(numbers, len(basis), bits)
        return None if found is None else self._combination(found, basis)

    def _integer_relation(self, numbers: Callable[[], list[arb]], count: int, bits: int) -> list[fmpq] | None:
        if count + 1 > MAX_LATTICE_NUMBERS:
            return None
        self._ring.work.spend(PRODUCTS_OF_REDUCTION * (count + 1) ** 3)
        return rational_relation(numbers, count, bits)

    def _combination(self, coefficients: list[fmpq], basis: list[dict[int, int]]) -> Element:
        ring = self._ring
        total = ring.constant(Fraction(0))
        for coefficient, exponents in zip(coefficients, basis, strict=True):
            if coefficient:
                number = ring.constant(Fraction(int(coefficient.p), int(coefficient.q)))
                total = ring.add(total, ring.multiply(number, ring.plain(ring.monomial(exponents))))
        return total

    def _basis_values(self, basis: list[dict[int, int]]) -> list[arb]:
        values = GeneratorValues(self._ring)
        return [values.element(self._ring.monomial(exponents)) for exponents in basis]

    def _in_basis(self, element: Element, rows: dict[Monomial, int]) -> dict[int, fmpq] | None:
        found: dict[int, fmpq] = {}
        for exponents, coefficient in element.numerator.terms():
            key = tuple(int(e) + s for e, s in zip(exponents, element.shift, strict=True))
            row = rows.get(tuple(pair for pair in enumerate(key) if pair[1]))
            if row is None:
                return None
            found[row] = coefficient
        return found

    def _basis(self) -> list[dict[int, int]] | None:
        """Return the monomials that span K by their exponents, 1 first; None if they are too many."""
        generators = self._generators()
        size = 1
        for index in generators:
            size *= self._ring.relation_power(index)
            if size > MAX_FIELD_DEGREE:
                return None
        powers = product(*(range(self._ring.relation_power(index)) for index in generators))
        return [{i: e for i, e in zip(generators, exponents, strict=True) if e} for exponents in powers]

    def _generators(self) -> list[int]:
        return [index for index in self._ring.natures if self._is_number(index)]

    def _is_number(self, index: int) -> bool:
        match self._ring.natures[index]:
            case CosineOfTurn():
                return True
            case Root(base):
                return index != self._ring.rho_index and self.contains(base)
        return False

    def _is_root_of_integer(self, index: int) -> bool:
        nature = self._ring.natures[index]
        return isinstance(nature, Root) and nature.base.is_number
