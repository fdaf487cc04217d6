"""Writes an element of the ring as a formula in g1, g2, g3, the same for all octants.

What differs between octants by its sign is written with absolute values: over the signs of g1, g2 and g3 that
matter to the ring, the coefficient of a monomial is a sum of products of some of them, as on any such group.
"""

from collections.abc import Mapping
from fractions import Fraction
from itertools import product
from math import factorial, prod

from flint import fmpq, fmpq_mpoly

from service.dynamics.formula.tree import VARIABLES
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    Logarithm,
    Nature,
    Root,
    Sine,
)
from service.dynamics.verdict.exact_ring.products import irreducible_factors
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.proofs.energy_terms import power_text, sum_text, term_text
from service.dynamics.verdict.proofs.proof import Signs
from service.dynamics.verdict.ring_functions.transcendental import as_vector

MAX_TERMS = 400
"""Largest number of terms of a polynomial in g1, g2, g3; a longer formula helps nobody."""

MAX_TERMS_AS_TYPED = 2
"""Terms that are left as they are; of more, factors are looked for."""

Place = tuple[int, int, int]
"""Exponents of the generators of g1, g2, g3."""
_Polynomial = dict[Place, Fraction]
_Terms = list[tuple[Fraction, list[str]]]
"""Coefficients, and the powers of coordinates beside them."""


class NoTextError(Exception):
    """The element has no formula for all octants, or only a long one."""


class ElementText:
    """Formulas of elements that are equal functions in rings of one layout, one ring for each octant.

    Parameters
    ----------
    rings
        By the signs of an octant; octants differ in the signs of g1, g2, g3 at the positions ``dependent``
        only, and there are all of these.
    divisors
        Whether sums are brought to common denominators first.
    without
        The coordinate whose square is replaced on the sphere, by its position; None for that of which a
        polynomial is shortest. Without g1² or g3², the powers of 1 − g2² in the coefficients are written as
        those of g1² + g3², which are known to all digits next to a pole.
    """

    def __init__(
        self, rings: Mapping[Signs, Ring], dependent: frozenset[int], *, divisors: bool, without: int | None
    ) -> None:
        self._rings = rings
        self._divisors = divisors
        self._without = without
        self._dependent = sorted(dependent)
        ring = next(iter(rings.values()))
        self._places = ring.coordinate_index
        self._degrees = tuple(ring.layout.degree(name) for name in VARIABLES)
        self._atoms: dict[tuple[int, int], str] = {}

    def of(self, elements: Mapping[Signs, Element]) -> str:
        """Return the formula of an element, given in each octant; raises NoTextError."""
        groups: dict[tuple[tuple[int, int], ...], dict[Signs, _Polynomial]] = {}
        for signs, element in elements.items():
            reduced = self._rings[signs].normal(element, divisors=self._divisors)
            for exponents, value in as_vector(reduced).items():
                others = tuple((k, e) for k, e in enumerate(exponents) if e and k not in self._places)
                first, second, third = (exponents[k] for k in self._places)
                octants = groups.setdefault(others, {each: {} for each in elements})
                octants[signs][first, second, third] = value
        parts = list[str]()
        for others, octants in groups.items():
            number, factors = Fraction(1), list[str]()
            for index, exponent in others:
                value, text = self._atom(index, exponent)
                number, factors = number * value, [*factors, text]
            parts += self._product(number, octants, factors)
        return sum_text(parts)

    def _product(
        self, number: Fraction, octants: Mapping[Signs, _Polynomial], factors: list[str]
    ) -> list[str]:
        """Return the terms of number · polynomial · factors, as one product where that is shorter."""
        terms = self._shortest(octants)
        split = self._split(octants) if self._without is None and len(terms) > MAX_TERMS_AS_TYPED else None
        if split is not None:
            coefficient, pieces = split
            written = [(self._shortest(piece), power) for piece, power in pieces]
            if sum(len(each) for each, _ in written) < len(terms):
                texts = [power_text(_bracketed(_sum(each)), Fraction(power)) for each, power in written]
                return [term_text(number * coefficient, *texts, *factors)]
        if len(terms) == 1 or not factors:
            return [term_text(number * value, *coordinates, *factors) for value, coordinates in terms]
        return [term_text(number, _bracketed(_sum(terms)), *factors)]

    def _split(
        self, octants: Mapping[Signs, _Polynomial]
    ) -> tuple[Fraction, list[tuple[dict[Signs, _Polynomial], int]]] | None:
        """Return the factors of a polynomial, None if it has none, or negative powers."""
        whole = dict[Signs, fmpq_mpoly]()
        for signs, part in octants.items():
            if not part or any(e < 0 for each in part for e in each):
                return None
            ring = self._rings[signs]
            whole[signs] = ring.context.constant(0)
            for exponents, value in part.items():
                places = [0] * ring.width
                for index, exponent in zip(self._places, exponents, strict=True):
                    places[index] = exponent
                coefficient = fmpq(value.numerator, value.denominator)
                whole[signs] += ring.context.term(exp_vec=tuple(places), coeff=coefficient)
        number, pieces = self._factors(whole)
        if sum(power for _, power in pieces) < 2:
            return None
        return number, [
            ({signs: self._polynomial(signs, f) for signs, f in piece.items()}, power)
            for piece, power in pieces
        ]

    def _factors(
        self, polynomials: Mapping[Signs, fmpq_mpoly]
    ) -> tuple[Fraction, list[tuple[dict[Signs, fmpq_mpoly], int]]]:
        """Return number · Π f^k; no factors where the octants differ in the number or in a k."""
        found = {signs: irreducible_factors(self._rings[signs], each) for signs, each in polynomials.items()}
        number, pieces = next(iter(found.values()))
        powers = [k for _, k in pieces]
        if any(n != number or [k for _, k in each] != powers for n, each in found.values()):
            return Fraction(1), []
        return number, [
            ({signs: each[index][0] for signs, (_, each) in found.items()}, k)
            for index, k in enumerate(powers)
        ]

    def _polynomial(self, signs: Signs, piece: fmpq_mpoly) -> _Polynomial:
        vector = as_vector(self._rings[signs].polynomial(piece))
        first, second, third = self._places
        return {(each[first], each[second], each[third]): value for each, value in vector.items()}

    def _shortest(self, octants: Mapping[Signs, _Polynomial]) -> _Terms:
        """Return the terms of a polynomial, without the square of that coordinate of which it is best."""
        least = tuple(min(each[i] for part in octants.values() for each in part) for i in range(3))
        if self._without is not None:
            reduced = {s: self._without_square(part, self._without, least) for s, part in octants.items()}
            return self._texts(self._merged(reduced), joins=self._without != 1)
        found = list[_Terms]()
        for position in (1, 2, 0):
            reduced = {signs: self._without_square(part, position, least) for signs, part in octants.items()}
            found.append(self._texts(self._merged(reduced), joins=False))
        return min(found, key=lambda terms: (len(terms), sum(abs(value) for value, _ in terms)))

    def _without_square(self, polynomial: _Polynomial, position: int, least: tuple[int, ...]) -> _Polynomial:
        """Return it with one coordinate's square replaced on the sphere, but for the factor ``least``."""
        square = [2 * degree for degree in self._degrees]
        one, other = (k for k in range(3) if k != position)
        total: _Polynomial = {}
        for exponents, value in polynomial.items():
            times = (exponents[position] - least[position]) // square[position]
            for i, j in product(range(times + 1), repeat=2):
                if i + j > times:
                    continue
                ways = factorial(times) // prod(map(factorial, (i, j, times - i - j)))
                made = list(exponents)
                made[position] -= times * square[position]
                made[one] += i * square[one]
                made[other] += j * square[other]
                key = made[0], made[1], made[2]
                total[key] = total.get(key, Fraction(0)) + (-1) ** (i + j) * ways * value
            if len(total) > MAX_TERMS:
                raise NoTextError
        return {key: value for key, value in total.items() if value}

    def _merged(self, octants: Mapping[Signs, _Polynomial]) -> dict[tuple[Place, frozenset[int]], Fraction]:
        """Return the coefficients in all octants, by exponents and by the coordinates that give the sign."""
        terms = dict[tuple[Place, frozenset[int]], Fraction]()
        for exponents in dict.fromkeys(each for part in octants.values() for each in part):
            for odd in product((False, True), repeat=len(self._dependent)):
                turned = frozenset(k for k, is_odd in zip(self._dependent, odd, strict=True) if is_odd)
                value = sum(
                    (part.get(exponents, Fraction(0)) * prod(signs[k] for k in turned))
                    for signs, part in octants.items()
                ) / Fraction(len(octants))
                if value:
                    terms[exponents, turned] = value
        if len(terms) > MAX_TERMS:
            raise NoTextError
        return terms

    def _texts(self, merged: Mapping[tuple[Place, frozenset[int]], Fraction], *, joins: bool) -> _Terms:
        """Return the terms; ``joins`` those that differ in the power of g2 only to polynomials in g2."""
        groups = dict[tuple[str, str], dict[int, Fraction]]()
        terms: _Terms = []
        for (exponents, turned), value in merged.items():
            first, second, third = (self._power(k, e, k in turned) for k, e in enumerate(exponents))
            k = exponents[1]
            is_plain = self._degrees[1] == 1 and k >= 0 and second == power_text("g2", Fraction(k))
            if joins and is_plain:
                groups.setdefault((first, third), {})[k] = value
            else:
                terms.append((value, [first, second, third]))
        for (first, third), polynomial in groups.items():
            times, rest = _powers_of_rho(polynomial)
            sum_in_g2 = [(value, [power_text("g2", Fraction(k))]) for k, value in sorted(rest.items())]
            rho = power_text("(g1^2 + g3^2)", Fraction(times))
            if len(sum_in_g2) == 1:
                value, (power,) = sum_in_g2[0]
                terms.append((value, [first, third, rho, power]))
            else:
                terms.append((Fraction(1), [first, third, rho, _bracketed(_sum(sum_in_g2))]))
        return terms

    def _power(self, position: int, exponent: int, is_odd: bool) -> str:
        """Return |g|^(exponent/degree) of a coordinate, times its sign if that ``is_odd``."""
        name, power = VARIABLES[position], Fraction(exponent, self._degrees[position])
        is_whole = power.denominator == 1
        if position not in self._dependent or (is_whole and power.numerator % 2 == int(is_odd)):
            return power_text(name, power)
        if is_odd:
            return "*".join(filter(None, (name, power_text(f"abs({name})", power - 1))))
        return power_text(f"abs({name})", power)

    def _atom(self, index: int, exponent: int) -> tuple[Fraction, str]:
        """Return a power of a generator that is no coordinate, as a number times a formula."""
        natures = [ring.natures.get(index) for ring in self._rings.values()]
        nature, one = natures[0], Fraction(1)
        if any(type(each) is not type(nature) for each in natures):
            raise NoTextError
        match nature:
            case CircleConstant(degree):
                return one, power_text("pi", Fraction(exponent, degree))
            case CosineOfTurn(order):
                return one, power_text(f"(2*cos({Fraction(2, order)}*pi))", Fraction(exponent))
            case Root(_, degree):
                return one, self._root(index, Fraction(exponent, degree))
            case Exponential(_, degree):
                return one, f"exp({term_text(Fraction(exponent, degree), f'({self._inner(index)})')})"
            case Divisor():
                # Monic in the generator that sorts first, which may be the negative of what was typed.
                text, sign = self._inner(index), one
                if text.startswith("-"):
                    text, sign = self._inner(index, sign=-1), -one
                return sign**exponent, power_text(f"({text})", Fraction(exponent))
            case Logarithm():
                factor, text = self._logarithm(index)
                return factor**exponent, power_text(text, Fraction(exponent))
            case Sine():
                return one, power_text(f"sin({self._inner(index)})", Fraction(exponent))
            case Cosine():
                return one, power_text(f"cos({self._inner(index)})", Fraction(exponent))
        raise NoTextError

    def _root(self, index: int, power: Fraction) -> str:
        """Return a power of what a generator is a root of: of |f| where that is an even power of f."""
        if index == next(iter(self._rings.values())).rho_index:
            return power_text("(g1^2 + g3^2)", power)
        number, pieces = self._even_powers(index)
        if not pieces:
            return power_text(f"({self._inner(index)})", power)
        factors = [power_text(f"({number})", power)] if number != 1 else []
        return "*".join([*factors, *(power_text(f"abs({self.of(f)})", k * power) for f, k in pieces)])

    def _logarithm(self, index: int) -> tuple[Fraction, str]:
        number, pieces = self._even_powers(index)
        if number == 1 and len(pieces) == 1:
            return Fraction(pieces[0][1]), f"log(abs({self.of(pieces[0][0])}))"
        return Fraction(1), f"log({self._inner(index)})"

    def _even_powers(self, index: int) -> tuple[Fraction, list[tuple[dict[Signs, Element], int]]]:
        """Return number · Π f^k, all k even, that a generator is a function of; no pieces if it is none."""
        inner = {signs: _argument(ring.natures[index]) for signs, ring in self._rings.items()}
        if any(any(each.shift) for each in inner.values()):
            return Fraction(1), []
        number, pieces = self._factors({signs: each.numerator for signs, each in inner.items()})
        if number < 0 or any(k % 2 for _, k in pieces):
            return Fraction(1), []
        return number, [
            ({signs: self._rings[signs].polynomial(self._turned(signs, f)) for signs, f in piece.items()}, k)
            for piece, k in pieces
        ]

    def _turned(self, signs: Signs, piece: fmpq_mpoly) -> fmpq_mpoly:
        """Return ±f, of which the first term has the same sign in g1, g2, g3 in all octants."""
        exponents = piece.monomial(0)
        places = zip(self._places, self._degrees, signs, strict=True)
        odd = prod(sign for index, degree, sign in places if int(exponents[index]) // degree % 2)
        return piece if odd > 0 else -piece

    def _inner(self, index: int, sign: int = 1) -> str:
        """Return the formula of what the function of a generator is taken of, times a sign."""
        if (index, sign) not in self._atoms:
            arguments = {signs: _argument(ring.natures[index]) for signs, ring in self._rings.items()}
            self._atoms[index, sign] = self.of(
                {signs: Element(sign * inner.numerator, inner.shift) for signs, inner in arguments.items()}
            )
        return self._atoms[index, sign]


def _argument(nature: Nature) -> Element:
    match nature:
        case Root(inner) | Divisor(inner) | Exponential(inner) | Logarithm(inner):
            return inner
        case Sine(inner) | Cosine(inner):
            return inner
    raise NoTextError


def _powers_of_rho(polynomial: Mapping[int, Fraction]) -> tuple[int, dict[int, Fraction]]:
    """Return (k, rest) for a polynomial in g2 that is (1 − g2²)^k times a rest, by exponents."""
    times, rest = 0, dict(polynomial)
    while True:
        quotient, highest = dict[int, Fraction](), max(rest)
        for k in range(highest + 1):
            quotient[k] = rest.get(k, Fraction(0)) + quotient.get(k - 2, Fraction(0))
        if any(quotient.get(k) for k in (highest - 1, highest)):
            return times, rest
        times, rest = times + 1, {k: value for k, value in quotient.items() if value}


def _sum(terms: _Terms) -> str:
    return sum_text(term_text(value, *coordinates) for value, coordinates in terms)


def _bracketed(text: str) -> str:
    return f"({text})"
