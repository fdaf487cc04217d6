"""Exponentials, logarithms, sines and cosines in the ring of a proof.

Logarithms of products become sums, and exponentials of sums products. Arguments of exponentials, sines and
cosines are written in a basis over Q, so that they share generators; multiples of π give numbers.
"""

from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Protocol

from flint import fmpq_mpoly, fmpz_poly

from service.dynamics.formula.algebras.monomials import as_fraction, weighted_sum
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    Element,
    Exponential,
    LayoutTooSmallError,
    Logarithm,
    NoProofError,
    Root,
    Sine,
)
from service.dynamics.verdict.exact_ring.products import Splitting, prime_powers
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.algebraic_numbers import MAX_COSINE_ORDER, AlgebraicNumbers
from service.dynamics.verdict.ring_functions.radicals import Radicals

MAX_BASIS_ARGUMENTS = 12
"""Arguments in one basis; with more of them formulas get too many generators anyway."""
MAX_INTEGER_FACTOR = 12
"""An integer in front of an argument up to this one is taken off: sin(3 x) and sin(2 x) share x."""
MAX_ARGUMENT_TERMS = 300
"""Most terms of an argument that is compared with others; a longer one is a basis element by itself."""

Exponents = tuple[int, ...]
Vector = dict[Exponents, Fraction]


@dataclass(frozen=True, slots=True)
class _Row:
    """An argument reduced to zero at the earlier pivots; ``of`` are its coefficients in the basis."""

    pivot: Exponents
    vector: Vector
    of: dict[int, Fraction]


class ArgumentBasis:
    """Elements that are linearly independent over Q, taken from the arguments as they come.

    sin(x + y), sin(x), sin(y) get the basis (x + y, x), and y = (x + y) - x.
    """

    def __init__(self) -> None:
        self.elements: list[Element] = []
        self._rows: list[_Row] = []

    def coordinates(self, argument: Element) -> dict[int, Fraction] | None:
        """Return the argument, canonical and not zero, as Σ coefficient · basis element; it may become one.

        None if the basis is full, or the argument is too long.
        """
        if len(argument.numerator) > MAX_ARGUMENT_TERMS:
            return None
        vector, of = as_vector(argument), dict[int, Fraction]()
        for row in self._rows:
            factor = vector.get(row.pivot)
            if factor:
                vector = weighted_sum(((Fraction(1), vector), (-factor, row.vector)))
                of = weighted_sum(((Fraction(1), of), (factor, row.of)))
        if not vector:
            return of
        if len(self.elements) == MAX_BASIS_ARGUMENTS:
            return None
        number, leading = len(self.elements), as_fraction(argument.numerator.leading_coefficient())
        if leading.denominator != 1 or abs(leading) > MAX_INTEGER_FACTOR:
            leading = Fraction(1)
        self.elements.append(Element(argument.numerator / int(leading), argument.shift))
        pivot = next(iter(vector))
        scale = 1 / vector[pivot]
        # vector = argument - Σ of · basis, and the argument is leading · (the new element).
        new = {number: leading * scale} | {index: -scale * value for index, value in of.items()}
        self._rows.append(_Row(pivot, {key: scale * value for key, value in vector.items()}, new))
        return {number: leading}


def as_vector(element: Element) -> Vector:
    """Return the coefficients of an element by the exponents of its monomials."""
    vector: Vector = {}
    for term, coefficient in element.numerator.terms():
        exponents = tuple(int(e) + s for e, s in zip(term, element.shift, strict=True))
        vector[exponents] = as_fraction(coefficient)
    return vector


MAX_MULTIPLE_ANGLE = 40
"""sin(k x) is written in sin(x) and cos(x) up to this k; beyond it, sin(k x) is a generator."""
MAX_BASES = 4
"""Arguments too high multiples of one another are put into different bases, unrelated."""

Pair = tuple[Element, Element]
"""Cosine and sine."""


class TrigonometricArithmetic(Protocol):
    """The part of the ring's algebra that trigonometry uses."""

    def power(self, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent."""
        ...


class Trigonometry:
    """Sines and cosines in one ring."""

    def __init__(self, ring: Ring, algebra: TrigonometricArithmetic, numbers: AlgebraicNumbers) -> None:
        self._ring = ring
        self._algebra = algebra
        self._numbers = numbers
        self._bases: list[ArgumentBasis] = [ArgumentBasis()]

    def cosine_and_sine(self, argument: Element) -> Pair:
        """Return both for any argument."""
        ring = self._ring
        half_turns, argument = self._without_half_turns(ring.canonical(argument))
        result = self._of_half_turns(half_turns)
        if argument.is_zero:
            return result
        argument = ring.canonical(argument)
        for number in range(MAX_BASES):
            if number == len(self._bases):
                self._bases.append(ArgumentBasis())
            found = self._in_basis(self._bases[number], argument)
            if found is not None:
                return self._sum(result, found)
        return self._sum(result, self._whole(argument))

    def _in_basis(self, basis: ArgumentBasis, argument: Element) -> Pair | None:
        """Return both by the addition theorems, None if the basis does not hold the argument."""
        ring, layout = self._ring, self._ring.layout
        coordinates = basis.coordinates(argument)
        if coordinates is None:
            return None
        keys = {k: f"angle:{basis.elements[k].text}" for k in coordinates}
        for k, coefficient in coordinates.items():
            degree = lcm(layout.degree(keys[k]), coefficient.denominator)
            if abs(coefficient) * degree > MAX_MULTIPLE_ANGLE:
                return None
            if degree != layout.degree(keys[k]):
                raise LayoutTooSmallError(layout.with_degree(keys[k], coefficient.denominator))
        result = ring.constant(Fraction(1)), ring.constant(Fraction(0))
        for k, coefficient in coordinates.items():
            pair = self._generators(keys[k], basis.elements[k])
            times = coefficient * layout.degree(keys[k])
            result = self._sum(result, self._multiple(pair, times.numerator))
        return result

    def _generators(self, key: str, basis_element: Element) -> Pair:
        """Return cosine and sine of the element divided by its degree."""
        ring = self._ring
        sine, cosine = ring.find(f"sin:{key}"), ring.find(f"cos:{key}")
        if sine is None or cosine is None:
            part = ring.constant(Fraction(1, ring.layout.degree(key)))
            argument = ring.multiply(part, basis_element)
            # The relation cos² = 1 - sin² needs the cosine to be the greater generator: made second.
            sine = ring.atom(f"sin:{key}", Sine(argument, ring.next_atom() - 1))
            cosine = ring.atom(f"cos:{key}", Cosine(argument, sine))
        return ring.polynomial(ring.context.gen(cosine)), ring.polynomial(ring.context.gen(sine))

    def _whole(self, argument: Element) -> Pair:
        """Return cosine and sine as generators of their own, the argument's sign apart."""
        negative = argument.numerator.leading_coefficient() < 0
        argument = self._ring.negate(argument) if negative else argument
        cosine, sine = self._generators(f"whole:{argument.text}", argument)
        return cosine, self._ring.negate(sine) if negative else sine

    # --- multiples of π -------------------------------------------------------------

    def _without_half_turns(self, argument: Element) -> tuple[Fraction, Element]:
        """Return r and the rest of an argument r π + rest."""
        ring = self._ring
        pi = ring.pi()
        for term, coefficient in argument.numerator.terms():
            exponents = tuple(int(e) + s for e, s in zip(term, argument.shift, strict=True))
            if exponents == tuple(int(e) for e in pi.numerator.monomial(0)):
                r = as_fraction(coefficient)
                if lcm(4, 2 * r.denominator) > MAX_COSINE_ORDER:
                    break
                return r, ring.normal(ring.add(argument, ring.multiply(ring.constant(-r), pi)))
        return Fraction(0), argument

    def _of_half_turns(self, r: Fraction) -> Pair:
        """Return cos(π r) and sin(π r)."""
        ring, key = self._ring, "half turn"
        degree = lcm(ring.layout.degree(key), r.denominator)
        if degree != ring.layout.degree(key) and lcm(4, 2 * degree) <= MAX_COSINE_ORDER:
            raise LayoutTooSmallError(ring.layout.with_degree(key, r.denominator))
        order = lcm(4, 2 * r.denominator)
        if lcm(4, 2 * degree) <= MAX_COSINE_ORDER and r.denominator > 2:
            order = lcm(4, 2 * degree)
        turns = int(r / 2 * order)
        return self._cosine_of_turns(turns, order), self._cosine_of_turns(order // 4 - turns, order)

    def _cosine_of_turns(self, turns: int, order: int) -> Element:
        """Return cos(2π turns/order)."""
        ring = self._ring
        turns = min(turns % order, -turns % order)
        sign = 1
        if 4 * turns > order:
            sign, turns = -1, order // 2 - turns
        if turns == 0 or 4 * turns == order:
            return ring.constant(Fraction(sign if turns == 0 else 0))
        before, current = ring.constant(Fraction(2)), self._unit(order)
        double = current
        for _ in range(turns - 1):
            before, current = (
                current,
                ring.normal(ring.add(ring.multiply(double, current), ring.negate(before))),
            )
        return ring.multiply(ring.constant(Fraction(sign, 2)), current)

    def _unit(self, order: int) -> Element:
        """Return 2 cos(2π/order), in square roots if its degree is at most 4."""
        ring = self._ring
        minimal = fmpz_poly.cos_minpoly(order)
        a = [ring.constant(Fraction(int(minimal[k]))) for k in range(3)]
        half = Fraction(1, 2)
        match int(minimal.degree()):
            case 2:  # order 8 or 12: x² + a0
                return self._algebra.power(ring.negate(a[0]), half)
            case 4:  # order 16, 20 or 24: x⁴ + a2 x² + a0, the largest root
                inside = ring.add(ring.multiply(a[2], a[2]), ring.multiply(ring.constant(Fraction(-4)), a[0]))
                square = ring.add(self._algebra.power(inside, half), ring.negate(a[2]))
                return self._algebra.power(ring.multiply(ring.constant(half), square), half)
        return self._numbers.cosine_of_turn(order)

    # --- addition theorems ------------------------------------------------------------

    def _sum(self, one: Pair, other: Pair) -> Pair:
        """Return cosine and sine of the sum of two angles."""
        ring, (c, s), (d, t) = self._ring, one, other
        cosine = ring.add(ring.multiply(c, d), ring.negate(ring.multiply(s, t)))
        return ring.normal(cosine), ring.normal(ring.add(ring.multiply(s, d), ring.multiply(c, t)))

    def _multiple(self, pair: Pair, times: int) -> Pair:
        """Return cosine and sine of ``times`` the angle."""
        ring = self._ring
        if times < 0:
            pair, times = (pair[0], ring.negate(pair[1])), -times
        result = None
        while times:
            if times & 1:
                result = pair if result is None else self._sum(result, pair)
            times >>= 1
            if times:
                pair = self._sum(pair, pair)
        return result if result is not None else (ring.constant(Fraction(1)), ring.constant(Fraction(0)))


LOGARITHM_ROOTS = (2, 3)
"""A number that is such a power in the field of numbers gives up its logarithm to the root."""


class ExponentialArithmetic(Protocol):
    """The part of the ring's algebra that exponentials and logarithms use."""

    def power(self, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent."""
        ...

    def pi(self) -> Element:
        """Return π."""
        ...


class Transcendental:
    """Exponentials and logarithms in one ring."""

    def __init__(
        self, ring: Ring, algebra: ExponentialArithmetic, splitting: Splitting, radicals: Radicals
    ) -> None:
        self._ring = ring
        self._algebra = algebra
        self._splitting = splitting
        self._radicals = radicals
        self._basis = ArgumentBasis()

    # --- logarithms ------------------------------------------------------------------

    def logarithm(self, argument: Element, times: int = 1) -> Element:
        """Return log(argument^times)."""
        ring = self._ring
        parts = self._splitting.of(argument, times)
        terms: list[tuple[Fraction, Element]] = []
        number = self._radicals.take_number(parts)
        if number is not None:
            # 3 + 2√2 = (1 + √2)²
            for prime in LOGARITHM_ROOTS:
                root = self._radicals.root_of_number(number, prime)
                if root is not None:
                    terms.append((Fraction(prime), self.logarithm(root)))
                    break
            else:
                terms.append((Fraction(1), self._log_atom(f"log:{number.text}", number)))
        terms += [
            (Fraction(multiplicity), self._log_atom(f"log:{prime}", ring.constant(Fraction(prime))))
            for prime, multiplicity in prime_powers(parts.coefficient)
        ]
        terms += [(Fraction(e), self._log_of_generator(index)) for index, e in parts.generators.items()]
        terms += [(Fraction(power), self._log_of_piece(piece)) for piece, power in parts.positive]
        terms += [(Fraction(power, 2), self._log_of_piece(piece**2)) for piece, power in parts.squares]
        if parts.together is not None:
            terms.append((Fraction(1), self._log_atom(f"log:{parts.together.text}", parts.together)))
        total = ring.constant(Fraction(0))
        for multiplicity, logarithm in terms:
            total = ring.add(total, ring.multiply(ring.constant(multiplicity), logarithm))
        return total

    def _log_of_piece(self, piece: fmpq_mpoly) -> Element:
        element = self._ring.polynomial(piece)
        return self._log_atom(f"log:{element.text}", element)

    def _log_of_generator(self, index: int) -> Element:
        """Return the logarithm of a positive generator, through that of what it is a root of."""
        ring = self._ring
        match ring.natures[index]:
            case Coordinate(position, degree):
                absolute = ring.monomial({index: degree})
                logarithm, root = self._log_atom(f"log:g{position + 1}", absolute), degree
            case Root(base, degree) if index == ring.rho_index:
                logarithm, root = self._log_atom("log:rho", base), degree
            case Root(base, degree):
                logarithm, root = self._log_atom(f"log:{base.text}", base), degree
            case Exponential(exponent, degree):
                logarithm, root = exponent, degree
            case CircleConstant(degree):
                logarithm, root = self._log_atom("log:pi", self._algebra.pi()), degree
            case nature:
                raise NoProofError(f"the sign of {nature} is not known")
        return ring.multiply(ring.constant(Fraction(1, root)), logarithm)

    def _log_atom(self, key: str, argument: Element) -> Element:
        index = self._ring.find(key)
        if index is None:
            index = self._ring.atom(key, Logarithm(argument))
        return self._ring.polynomial(self._ring.context.gen(index))

    # --- exponentials -----------------------------------------------------------------

    def exponential(self, argument: Element) -> Element:
        """Return exp(argument); exp(c log x) is x^c."""
        ring = self._ring
        rest = ring.canonical(argument)
        result = ring.constant(Fraction(1))
        for exponents, coefficient in as_vector(rest).items():
            logarithm = self._logarithm_alone(exponents)
            if logarithm is not None:
                power = self._algebra.power(logarithm.argument, coefficient)
                result = ring.multiply(result, power)
                index = next(i for i, e in enumerate(exponents) if e)
                part = ring.multiply(ring.constant(-coefficient), ring.monomial({index: 1}))
                rest = ring.add(rest, part)
        rest = ring.canonical(rest)
        if rest.is_zero:
            return result
        coordinates = self._basis.coordinates(rest)
        if coordinates is None:
            leading = rest.numerator.leading_coefficient()
            monic = Element(rest.numerator / leading, rest.shift)
            return ring.multiply(result, self._exp_atom(as_fraction(leading), monic))
        for k, coefficient in coordinates.items():
            result = ring.multiply(result, self._exp_atom(coefficient, self._basis.elements[k]))
        return result

    def _logarithm_alone(self, exponents: tuple[int, ...]) -> Logarithm | None:
        """Return the nature of a monomial that is one logarithm, else None."""
        occurring = [index for index, exponent in enumerate(exponents) if exponent]
        if len(occurring) != 1 or exponents[occurring[0]] != 1:
            return None
        nature = self._ring.natures[occurring[0]]
        return nature if isinstance(nature, Logarithm) else None

    def _exp_atom(self, coefficient: Fraction, exponent: Element) -> Element:
        """Return exp(coefficient · exponent) as a power of the generator exp(exponent / degree)."""
        key = f"exp:{exponent.text}"
        layout = self._ring.layout
        degree = layout.degree(key)
        scaled = coefficient * degree
        if scaled.denominator != 1:
            raise LayoutTooSmallError(layout.with_degree(key, degree * scaled.denominator))
        index = self._ring.find(key)
        if index is None:
            index = self._ring.atom(key, Exponential(exponent, degree))
        return self._ring.monomial({index: scaled.numerator})
