"""Splits ring elements into number, monomial, powers of rho and of g2²; and products by their signs."""

from dataclasses import dataclass, field
from fractions import Fraction
from math import isqrt

from flint import fmpq_mpoly, fmpz

from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.verdict.exact_ring.generators import (
    Coordinate,
    Cosine,
    Divisor,
    Element,
    LayoutTooSmallError,
    NoProofError,
    UndefinedInOctantError,
    exponents_of,
)
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.exact_ring.signs import Signs, conjugates, is_positive

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


MAX_FACTORED_TERMS = 60
"""Terms of a polynomial that is split into irreducible factors."""
MAX_NUMBER_BITS = 2**16
"""Bits of the number in front."""
MAX_FACTORED_DEGREE = 40
"""Sum of the degrees in the generators of such a polynomial."""


@dataclass(slots=True)
class SignedFactors:
    """coefficient · Π generators · Π positive · Π squares · together, the coefficient positive.

    ``squares`` have f and the even power of it; ``together`` is None if it is 1.
    """

    coefficient: Fraction
    generators: dict[int, int]
    positive: list[tuple[fmpq_mpoly, int]] = field(default_factory=list)
    squares: list[tuple[fmpq_mpoly, int]] = field(default_factory=list)
    together: Element | None = None


@dataclass(slots=True)
class _Product:
    """number · Π generators · Π pieces, the pieces by their text."""

    number: Fraction = Fraction(1)
    generators: dict[int, int] = field(default_factory=dict)
    pieces: dict[str, tuple[fmpq_mpoly, int]] = field(default_factory=dict)

    def count(self, piece: fmpq_mpoly, power: int) -> None:
        """Multiply by piece^power."""
        key = str(piece)
        self.pieces[key] = (piece, self.pieces.get(key, (piece, 0))[1] + power)


class Splitting:
    """Splits products into factors of known and of unknown sign, in one ring."""

    def __init__(self, ring: Ring, *, keeps_kinks: bool = False) -> None:
        self._ring = ring
        self._keeps_kinks = keeps_kinks
        self.signs = Signs(ring)
        self._seen: list[fmpq_mpoly] = []

    def of(self, element: Element, times: int = 1) -> SignedFactors:
        """Return what the ``times``-th power of the element is made of.

        Call it only for elements that are positive wherever the formula has a value.
        Marks the coordinates whose positivity is used as sign dependent.

        Raises
        ------
        UndefinedInOctantError
            The product is negative in the whole octant.
        """
        ring = self._ring
        product = self._factored(element)
        number = _power(product.number, times)
        found = SignedFactors(abs(number), {i: e * times for i, e in product.generators.items()})
        sign = 1 if number > 0 else -1
        odd: list[tuple[fmpq_mpoly, int]] = []
        for piece, multiplicity in product.pieces.values():
            power = multiplicity * times
            if not power:
                continue
            is_kept = self._keeps_kinks and power % 2 == 0 and not self.signs.is_everywhere(piece)
            known = 0 if is_kept else self.signs.of(piece)
            if known:
                found.positive.append((known * piece, power))
                sign *= known if power % 2 else 1
            elif power % 2:
                self._halve_angle(piece)
                odd.append((piece, power))
            else:
                self.signs.leave_undecided(piece)
                found.squares.append((piece, power))
        if not odd and sign < 0:
            raise UndefinedInOctantError("negative in the whole octant")
        if len(odd) == 1:
            self.signs.learn(odd[0][0], sign)
            found.positive.append((sign * odd[0][0], odd[0][1]))
        elif odd:
            self.signs.are_assumed = True
            together = ring.context.constant(sign)
            for piece, power in odd:
                self.signs.leave_undecided(piece)
                together *= piece
                if power != 1:
                    found.squares.append((piece, power - 1))
            found.together = ring.polynomial(together)
        return found

    def assume(self, element: Element, sign: int) -> None:
        """Learn the sign of an element, if all its factors but one have signs that are known.

        Raises
        ------
        UndefinedInOctantError
            It has the other sign in the whole octant.
        """
        product = self._factored(element)
        sign *= 1 if product.number > 0 else -1
        open_ones: list[fmpq_mpoly] = []
        for piece, power in product.pieces.values():
            known = self.signs.of(piece)
            if not known and power % 2:
                open_ones.append(piece)
            elif power % 2:
                sign *= known
        if len(open_ones) == 1:
            self.signs.learn(open_ones[0], sign)
        elif not open_ones and sign < 0:
            raise UndefinedInOctantError("an assumption that holds nowhere in the octant")

    def _factored(self, element: Element) -> "_Product":
        """Return a number, powers of positive generators and powers of irreducible polynomials."""
        ring, product = self._ring, _Product()
        pending = self._parts(element)
        while pending:
            part, power = pending.pop()
            factors = factorise(ring, part, divisors=False)
            product.number *= _power(factors.coefficient, power)
            for index, exponent in enumerate(factors.exponents):
                if exponent:
                    nature = ring.natures[index]
                    if isinstance(nature, Divisor):
                        pending.append((nature.base, exponent * power))
                    else:
                        self._count_generator(product, index, exponent * power)
            number, irreducible = irreducible_factors(ring, factors.rest)
            product.number *= _power(number, power)
            for piece, multiplicity in irreducible:
                other = self._known_conjugate(piece)
                if other is None:
                    self._seen.append(piece)
                    product.count(piece, multiplicity * power)
                else:
                    # f = N / f̄: only one of two conjugates gets generators.
                    product.count(other, -multiplicity * power)
                    pending.append((ring.polynomial(piece * other), multiplicity * power))
        return product

    def _halve_angle(self, piece: fmpq_mpoly) -> None:
        """Request a ring with half the angle for 1 + cos x and 1 - cos x, which are squares in it."""
        ring = self._ring
        for index in (k for k, degree in enumerate(piece.degrees()) if degree == 1):
            is_cosine = isinstance(ring.natures[index], Cosine)
            if is_cosine and ((piece - ring.context.gen(index)) ** 2).is_one():
                key = ring.key(index).removeprefix("cos:")
                raise LayoutTooSmallError(ring.layout.with_degree(key, 2 * ring.layout.degree(key)))

    def _count_generator(self, product: "_Product", index: int, power: int) -> None:
        ring = self._ring
        nature = ring.natures[index]
        if isinstance(nature, Coordinate):
            ring.sign_dependent.add(nature.position)
        if is_positive(ring, index):
            product.generators[index] = product.generators.get(index, 0) + power
        else:
            product.count(ring.context.gen(index), power)

    def _parts(self, element: Element) -> list[tuple[Element, int]]:
        """Return factors before the relations are applied: in normal form (1 + g1 + g2)² is not a square."""
        ring = self._ring
        x2 = ring.coordinate_index[1]
        if int(element.numerator.degrees()[x2]) < 2:
            return [(element, 1)]
        number, pieces = irreducible_factors(ring, element.numerator)
        rest = Element(ring.context.constant(1), element.shift)
        parts = [(ring.multiply(ring.constant(number), rest), 1)]
        return parts + [(ring.polynomial(piece), power) for piece, power in pieces]

    def _known_conjugate(self, piece: fmpq_mpoly) -> fmpq_mpoly | None:
        """Return a factor met before that is a conjugate, their product not being zero."""
        if piece in self._seen:
            return None
        ring = self._ring
        for mirrored in conjugates(ring, piece):
            monic = mirrored / mirrored.leading_coefficient()
            if monic in self._seen and not ring.normal(ring.polynomial(piece * monic)).is_zero:
                return monic
        return None


def _power(number: Fraction, power: int) -> Fraction:
    bits = max(number.numerator.bit_length(), number.denominator.bit_length())
    if bits * abs(power) > MAX_NUMBER_BITS and abs(number) != 1:
        raise NoProofError("coefficients too large for a proof")
    return number**power


def irreducible_factors(ring: Ring, rest: fmpq_mpoly) -> tuple[Fraction, list[tuple[fmpq_mpoly, int]]]:
    """Return rest as number · Π f^k; rest itself where factoring may be slow."""
    if rest.is_one():
        return Fraction(1), []
    degrees = [max(int(degree), 0) for degree in rest.degrees()]
    if len(rest) > MAX_FACTORED_TERMS or sum(degrees) > MAX_FACTORED_DEGREE:
        return Fraction(1), [(rest, 1)]
    ring.work.spend(20 * len(rest) * (1 + sum(degrees)))
    number, pieces = rest.factor()
    value = as_fraction(number)
    found: list[tuple[fmpq_mpoly, int]] = []
    for piece, power in pieces:
        leading = piece.leading_coefficient()
        value *= as_fraction(leading) ** int(power)
        found.append((piece / leading, int(power)))
    return value, found
