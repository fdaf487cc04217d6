"""Rewrites a formula near a pole so that terms that cancel on the sphere are removed.

Next to g2 = σ = ±1 a formula may hold 1 − g2², (1 + g2)² or 1 − g2² − g3², which bounds of g2 know to be
small, and no more. With u = 1 − σ g2 the polynomials in g2 are polynomials in u, which is known to all
digits as (g1² + g3²) / (1 + |g2|): (1 + g2)² is u² for σ = −1. And on the sphere
u² = 2u − g1² − g3², so that every polynomial in g1, g2, g3 is one, and only one, without u²:
1 − g2² − g3² is g1².
"""

from collections.abc import Callable
from fractions import Fraction
from typing import Literal

from service.dynamics.formula.algebra import DerivedOperations
from service.dynamics.formula.algebras.monomials import (
    ONE,
    MonomialAlgebra,
    MonomialSum,
    NotAMonomialSumError,
    Rules,
    SquareRelation,
    as_fraction,
)
from service.dynamics.formula.tape import Instruction, Recorder, Tape

MOST_TERMS = 24
HIGHEST_DEGREE = 24

Element = MonomialSum | int
"""A polynomial in g1, u and g3, or the number of a register."""

VARIABLES = ("g1", "g2", "g3", "u")
_PLACES = (0, 3, 2)
"""Variables of the three exponents of a monomial."""
_SQUARE_OF_U = SquareRelation(1, ((0, 1, 0, 2), (2, 0, 0, -1), (0, 0, 2, -1)))


def pole_forms(tape: Tape, sigma: int) -> tuple[Tape, Tape]:
    """Return tapes over g1, g2, g3 and u with the same values on the sphere, neither with g2.

    The first has powers of u, the second none but the first.
    """
    return _pole_form(tape, sigma, None), _pole_form(tape, sigma, _SQUARE_OF_U)


def _pole_form(tape: Tape, sigma: int, relation: SquareRelation | None) -> Tape:
    writer = _Writer(relation)
    result = writer.register(tape.evaluate(writer, writer.coordinates(sigma)))
    return writer.recorder.whole(result)


class _Writer(DerivedOperations[Element]):
    """An algebra that writes instructions for all that is no polynomial."""

    def __init__(self, relation: SquareRelation | None) -> None:
        self.recorder = Recorder(VARIABLES)
        self._polynomials = MonomialAlgebra(
            Rules(
                (1, 1, 1),
                relation=relation,
                most_terms=MOST_TERMS,
                most_products=MOST_TERMS**2,
                most_degree=HIGHEST_DEGREE,
            )
        )

    def coordinates(self, sigma: int) -> list[Element]:
        """Return g1, g2 = σ (1 - u) and g3."""
        g1, u, g3 = self._polynomials.coordinates()
        one = self._polynomials.constant(Fraction(sigma))
        return [g1, self._polynomials.add(one, {key: -sigma * value for key, value in u.items()}), g3]

    def constant(self, value: Fraction) -> Element:
        return self._polynomials.constant(value)

    def pi(self) -> Element:
        return self._emit(Instruction("pi"))

    def add(self, left: Element, right: Element) -> Element:
        return self._combined("add", self._polynomials.add, left, right)

    def negate(self, operand: Element) -> Element:
        if isinstance(operand, dict):
            return self._polynomials.negate(operand)
        return self._emit(Instruction("negate", operand))

    def multiply(self, left: Element, right: Element) -> Element:
        return self._combined("multiply", self._polynomials.multiply, left, right)

    def divide(self, left: Element, right: Element) -> Element:
        if isinstance(right, dict) and set(right) == {ONE}:
            return self.multiply(left, {ONE: 1 / right[ONE]})
        return self._emit(Instruction("divide", self.register(left), self.register(right)))

    def power(self, base: Element, exponent: Fraction) -> Element:
        if isinstance(base, dict) and exponent.denominator == 1 and 0 < exponent <= HIGHEST_DEGREE:
            try:
                return self._polynomials.power(base, exponent)
            except NotAMonomialSumError:
                pass
        return self._emit(Instruction("power", self.register(base), number=exponent))

    def general_power(self, base: Element, exponent: Element) -> Element:
        return self._emit(Instruction("general_power", self.register(base), self.register(exponent)))

    def call(self, name: str, argument: Element) -> Element:
        return self._emit(Instruction("call", self.register(argument), name=name))

    def register(self, element: Element) -> int:
        """Return the register of an element, a polynomial being written as the sum of its terms."""
        if isinstance(element, int):
            return element
        ordered = sorted(element.items(), key=lambda term: (term[0][0], term[0][2], term[0][1]))
        terms = [self._term(monomial[:3], as_fraction(value)) for monomial, value in ordered]
        if not terms:
            return self._emit(Instruction("constant", number=Fraction(0)))
        total, *rest = terms
        for term in rest:
            total = self._emit(Instruction("add", total, term))
        return total

    def _term(self, exponents: tuple[int, int, int], value: Fraction) -> int:
        powers = {place: power for place, power in zip(_PLACES, exponents, strict=True) if power}
        factors = [
            place if power == 1 else self._emit(Instruction("power", place, number=Fraction(power)))
            for place, power in sorted(powers.items())
        ]
        if value != 1 or not factors:
            factors.insert(0, self._emit(Instruction("constant", number=value)))
        product, *rest = factors
        for factor in rest:
            product = self._emit(Instruction("multiply", product, factor))
        return product

    def _combined(
        self,
        operation: Literal["add", "multiply"],
        combine: Callable[[MonomialSum, MonomialSum], MonomialSum],
        left: Element,
        right: Element,
    ) -> Element:
        if isinstance(left, dict) and isinstance(right, dict):
            try:
                return combine(left, right)
            except NotAMonomialSumError:
                pass
        return self._emit(Instruction(operation, self.register(left), self.register(right)))

    def _emit(self, instruction: Instruction) -> int:
        return self.recorder.emit(instruction)
