"""Formulas evaluated in the ring of a proof: every function becomes a generator with its rules."""

from fractions import Fraction

from service.dynamics.verdict.factors import as_fraction, conjugate, factorise, positive_part, prime_powers
from service.dynamics.verdict.layout import LayoutTooSmallError, NoProofError
from service.dynamics.verdict.natures import (
    CircleConstant,
    Coordinate,
    Cosine,
    Divisor,
    Element,
    Exponential,
    Logarithm,
    Root,
    Sine,
    exponents_of,
)
from service.dynamics.verdict.ring import Ring

MAX_SPLIT_TERMS = 4
"""exp of a sum of up to this many terms is split into a product, so that exp(a + b) = exp(a) exp(b)."""


class RingAlgebra:
    """An Algebra over :class:`Element`.

    Raises (all methods)
    --------------------
    UndefinedInOctantError
        A division by zero, or a root or logarithm of what is never positive.
    LayoutTooSmallError, NoProofError
        See :class:`Ring`.
    """

    def __init__(self, ring: Ring) -> None:
        self._ring = ring

    def constant(self, value: Fraction) -> Element:
        """Return an exact number."""
        return self._ring.constant(value)

    def pi(self) -> Element:
        """Return π."""
        return self._ring.pi()

    def add(self, left: Element, right: Element) -> Element:
        """Return left + right."""
        return self._ring.add(left, right)

    def subtract(self, left: Element, right: Element) -> Element:
        """Return left - right."""
        return self._ring.add(left, self._ring.negate(right))

    def negate(self, operand: Element) -> Element:
        """Return -operand."""
        return self._ring.negate(operand)

    def multiply(self, left: Element, right: Element) -> Element:
        """Return left · right."""
        return self._ring.multiply(left, right)

    def divide(self, left: Element, right: Element) -> Element:
        """Return left / right."""
        return self._ring.multiply(left, self.reciprocal(right))

    def reciprocal(self, operand: Element) -> Element:
        """Return 1 / operand: the monomial inverted, what else there is made a divisor."""
        ring = self._ring
        factors = factorise(ring, operand)
        inverse = ring.multiply(
            ring.constant(1 / factors.coefficient),
            ring.monomial({i: -e for i, e in enumerate(factors.exponents) if e}),
        )
        if factors.is_monomial:
            return inverse
        mirrored = conjugate(ring, factors.rest)
        if mirrored is not None:
            norm = ring.multiply(ring.polynomial(factors.rest), mirrored)
            return ring.multiply(ring.multiply(inverse, mirrored), self.reciprocal(norm))
        # Divisors made before were split off by factorise: this one is new.
        index = ring.atom(f"divisor:{factors.rest}", Divisor(ring.polynomial(factors.rest)))
        return ring.multiply(inverse, ring.monomial({index: -1}))

    def power(self, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent."""
        ring = self._ring
        if exponent.denominator == 1:
            if exponent < 0:
                base, exponent = self.reciprocal(base), -exponent
            return ring.integer_power(base, exponent.numerator)
        factors = factorise(ring, base)
        positive, remainder = positive_part(ring, factors)
        powers = {index: self._scaled(index, e * exponent) for index, e in positive.items()}
        result = ring.multiply(
            ring.monomial(powers), self._power_of_number(abs(factors.coefficient), exponent)
        )
        if remainder is None:
            return result
        return ring.multiply(result, self._root(f"root:{remainder.text}", remainder, exponent))

    def general_power(self, base: Element, exponent: Element) -> Element:
        """Return exp(exponent · log(base))."""
        return self.call("exp", self._ring.multiply(exponent, self.call("log", base)))

    def call(self, name: str, argument: Element) -> Element:
        """Return the function of ``argument``."""
        match name:
            case "exp":
                return self._exponential(argument)
            case "log":
                return self._logarithm(argument)
            case "sin":
                return self._sine_and_cosine(argument)[0]
            case "cos":
                return self._sine_and_cosine(argument)[1]
            case "tan":
                sine, cosine = self._sine_and_cosine(argument)
                return self.divide(sine, cosine)
            case "abs":
                if self._ring.normal(argument).is_zero:
                    return argument
                return self.power(self._ring.multiply(argument, argument), Fraction(1, 2))
        raise NoProofError(f"no exact rules for {name}")

    # --- roots ---------------------------------------------------------------

    def _scaled(self, index: int, exponent: Fraction) -> int:
        """Return ``exponent`` as an integer, or ask for a ring where it is one."""
        if exponent.denominator == 1:
            return exponent.numerator
        raise self._finer(self._ring.key(index), exponent.denominator)

    def _finer(self, key: str, denominator: int) -> LayoutTooSmallError:
        layout = self._ring.layout
        return LayoutTooSmallError(layout.with_degree(key, layout.degree(key) * denominator))

    def _root(self, key: str, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent through the generator base^(1/degree)."""
        degree = self._ring.layout.degree(key)
        scaled = exponent * degree
        if scaled.denominator != 1:
            raise self._finer(key, scaled.denominator)
        index = self._ring.find(key)
        if index is None:
            index = self._ring.atom(key, Root(base, degree))
        return self._ring.monomial({index: scaled.numerator})

    def _power_of_number(self, number: Fraction, exponent: Fraction) -> Element:
        """Return number^exponent, number > 0, in roots of primes."""
        result = self._ring.constant(Fraction(1))
        for prime, multiplicity in prime_powers(number):
            base = self._ring.constant(Fraction(prime))
            whole, rest = divmod(multiplicity * exponent, 1)
            result = self._ring.multiply(result, self.power(base, Fraction(whole)))
            if rest:
                result = self._ring.multiply(result, self._root(f"prime:{prime}", base, rest))
        return result

    # --- transcendental functions ------------------------------------------------

    def _logarithm(self, argument: Element) -> Element:
        ring = self._ring
        factors = factorise(ring, argument)
        positive, remainder = positive_part(ring, factors)
        parts = [
            (Fraction(multiplicity), self._log_atom(f"log:{prime}", ring.constant(Fraction(prime))))
            for prime, multiplicity in prime_powers(abs(factors.coefficient))
        ]
        parts += [(Fraction(e), self._log_of_generator(index)) for index, e in positive.items()]
        if remainder is not None:
            parts.append((Fraction(1), self._log_atom(f"log:{remainder.text}", remainder)))
        total = ring.constant(Fraction(0))
        for multiplicity, logarithm in parts:
            total = ring.add(total, ring.multiply(ring.constant(multiplicity), logarithm))
        return total

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
                logarithm, root = self._log_atom("log:pi", self.pi()), degree
            case nature:
                raise NoProofError(f"the sign of {nature} is not known")
        return ring.multiply(ring.constant(Fraction(1, root)), logarithm)

    def _log_atom(self, key: str, argument: Element) -> Element:
        index = self._ring.find(key)
        if index is None:
            index = self._ring.atom(key, Logarithm(argument))
        return self._ring.polynomial(self._ring.context.gen(index))

    def _exponential(self, argument: Element) -> Element:
        ring = self._ring
        argument = ring.canonical(argument)
        numerator = argument.numerator
        result = ring.constant(Fraction(1))
        if argument.is_zero:
            return result
        if len(numerator) > MAX_SPLIT_TERMS:
            leading = numerator.leading_coefficient()
            return self._exp_atom(as_fraction(leading), Element(numerator / leading, argument.shift))
        for exponents, coefficient in numerator.terms():
            term = Element(ring.context.term(exp_vec=exponents), argument.shift)
            result = ring.multiply(result, self._exp_of_term(as_fraction(coefficient), term))
        return result

    def _exp_of_term(self, coefficient: Fraction, term: Element) -> Element:
        """Return exp(coefficient · term); exp(c log x) is x^c."""
        exponents = [a + b for a, b in zip(exponents_of(term.numerator), term.shift, strict=True)]
        occurring = [index for index, exponent in enumerate(exponents) if exponent]
        if len(occurring) == 1 and exponents[occurring[0]] == 1:
            nature = self._ring.natures[occurring[0]]
            if isinstance(nature, Logarithm):
                return self.power(nature.argument, coefficient)
        return self._exp_atom(coefficient, self._ring.monomial(dict(enumerate(exponents))))

    def _exp_atom(self, coefficient: Fraction, exponent: Element) -> Element:
        """Return exp(coefficient · exponent) as a power of the generator exp(exponent / degree)."""
        key = f"exp:{exponent.text}"
        degree = self._ring.layout.degree(key)
        scaled = coefficient * degree
        if scaled.denominator != 1:
            raise self._finer(key, scaled.denominator)
        index = self._ring.find(key)
        if index is None:
            index = self._ring.atom(key, Exponential(exponent, degree))
        return self._ring.monomial({index: scaled.numerator})

    def _sine_and_cosine(self, argument: Element) -> tuple[Element, Element]:
        ring = self._ring
        argument = ring.canonical(argument)
        if argument.is_zero:
            return argument, ring.constant(Fraction(1))
        sign = 1
        if argument.numerator.leading_coefficient() < 0:
            sign, argument = -1, ring.negate(argument)
        key = argument.text
        sine, cosine = ring.find(f"sin:{key}"), ring.find(f"cos:{key}")
        if sine is None or cosine is None:
            # The relation cos² = 1 - sin² needs the cosine to be the greater generator: made second.
            sine = ring.atom(f"sin:{key}", Sine(argument, ring.next_atom() - 1))
            cosine = ring.atom(f"cos:{key}", Cosine(argument, sine))
        return ring.polynomial(sign * ring.context.gen(sine)), ring.polynomial(ring.context.gen(cosine))
