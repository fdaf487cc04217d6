"""Writes logarithms of products as sums, and exponentials of sums as products."""

from fractions import Fraction
from typing import Protocol

from flint import fmpq_mpoly

from service.dynamics.verdict.exact_ring.factors import as_fraction, prime_powers
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Element,
    Exponential,
    Logarithm,
    Root,
)
from service.dynamics.verdict.exact_ring.layout import LayoutTooSmallError, NoProofError
from service.dynamics.verdict.exact_ring.products import Splitting
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.arguments import ArgumentBasis, as_vector
from service.dynamics.verdict.ring_functions.radicals import Radicals

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
