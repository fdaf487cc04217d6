"""Rewrites a formula near a pole so that terms that cancel on the sphere are removed.

Next to g2 = σ = ±1 a formula may hold 1 − g2², (1 + g2)² or 1 − g2² − g3², which bounds of g2 know to be
small, and no more. With u = 1 − σ g2 the polynomials in g2 are polynomials in u, which is known to all
digits as (g1² + g3²) / (1 + |g2|): (1 + g2)² is u² for σ = −1. And on the sphere
u² = 2u − g1² − g3², so that every polynomial in g1, g2, g3 is one, and only one, without u²:
1 − g2² − g3² is g1².
"""

from dataclasses import dataclass, field
from fractions import Fraction
from itertools import chain

from service.dynamics.exact import added_up, without_zeros
from service.dynamics.formula.tape import Instruction, Recorder, Tape

MOST_TERMS = 24
HIGHEST_DEGREE = 24

Monomial = tuple[int, int, int]
"""The powers of g1, g3 and u."""
Polynomial = dict[Monomial, Fraction]
Element = Polynomial | int
"""A polynomial, or the number of a register."""

ONE: Monomial = (0, 0, 0)
VARIABLES = ("g1", "g2", "g3", "u")


def pole_forms(tape: Tape, sigma: int) -> tuple[Tape, Tape]:
    """Return tapes over g1, g2, g3 and u with the same values on the sphere, neither with g2.

    The first has powers of u, the second none but the first.
    """
    return _pole_form(tape, sigma, HIGHEST_DEGREE), _pole_form(tape, sigma, 1)


def _pole_form(tape: Tape, sigma: int, highest: int) -> Tape:
    writer = _Writer(highest)
    inputs: list[Element] = [
        {(1, 0, 0): Fraction(1)},
        {ONE: Fraction(sigma), (0, 0, 1): Fraction(-sigma)},
        {(0, 1, 0): Fraction(1)},
    ]
    result = writer.register(tape.evaluate(writer, inputs))
    return writer.recorder.whole(result)


@dataclass(slots=True)
class _Writer:
    """An algebra that writes instructions for all that is no polynomial."""

    highest: int
    """Power of u that is left."""
    recorder: Recorder = field(default_factory=lambda: Recorder(VARIABLES))

    def constant(self, value: Fraction) -> Element:
        return {ONE: value} if value else {}

    def pi(self) -> Element:
        return self._emit(Instruction("pi"))

    def add(self, left: Element, right: Element) -> Element:
        if isinstance(left, dict) and isinstance(right, dict):
            total = without_zeros(added_up(chain(left.items(), right.items())))
            if len(total) <= MOST_TERMS:
                return total
        return self._emit(Instruction("add", self.register(left), self.register(right)))

    def subtract(self, left: Element, right: Element) -> Element:
        return self.add(left, self.negate(right))

    def negate(self, operand: Element) -> Element:
        if isinstance(operand, dict):
            return {monomial: -value for monomial, value in operand.items()}
        return self._emit(Instruction("negate", operand))

    def multiply(self, left: Element, right: Element) -> Element:
        if isinstance(left, dict) and isinstance(right, dict):
            product = _product(left, right, self.highest)
            if product is not None:
                return product
        return self._emit(Instruction("multiply", self.register(left), self.register(right)))

    def divide(self, left: Element, right: Element) -> Element:
        if isinstance(right, dict) and set(right) == {ONE}:
            return self.multiply(left, {ONE: 1 / right[ONE]})
        return self._emit(Instruction("divide", self.register(left), self.register(right)))

    def power(self, base: Element, exponent: Fraction) -> Element:
        if isinstance(base, dict) and exponent.denominator == 1 and 0 < exponent <= HIGHEST_DEGREE:
            power: Polynomial | None = base
            for _ in range(exponent.numerator - 1):
                power = None if power is None else _product(power, base, self.highest)
            if power is not None:
                return power
        return self._emit(Instruction("power", self.register(base), number=exponent))

    def general_power(self, base: Element, exponent: Element) -> Element:
        return self._emit(Instruction("general_power", self.register(base), self.register(exponent)))

    def call(self, name: str, argument: Element) -> Element:
        return self._emit(Instruction("call", self.register(argument), name=name))

    def register(self, element: Element) -> int:
        """Return the register of an element, a polynomial being written as the sum of its terms."""
        if isinstance(element, int):
            return element
        terms = [self._term(monomial, value) for monomial, value in sorted(element.items())]
        if not terms:
            return self._emit(Instruction("constant", number=Fraction(0)))
        total, *rest = terms
        for term in rest:
            total = self._emit(Instruction("add", total, term))
        return total

    def _term(self, monomial: Monomial, value: Fraction) -> int:
        factors = [
            variable if power == 1 else self._emit(Instruction("power", variable, number=Fraction(power)))
            for variable, power in zip((0, 2, 3), monomial, strict=True)
            if power
        ]
        if value != 1 or not factors:
            factors.insert(0, self._emit(Instruction("constant", number=value)))
        product, *rest = factors
        for factor in rest:
            product = self._emit(Instruction("multiply", product, factor))
        return product

    def _emit(self, instruction: Instruction) -> int:
        return self.recorder.emit(instruction)


def _product(left: Polynomial, right: Polynomial, highest: int) -> Polynomial | None:
    """Return the product with u to this power at most, the first or any; None if it is too long."""
    if len(left) * len(right) > MOST_TERMS**2:
        return None
    terms: list[tuple[Monomial, Fraction]] = []
    for (i, j, k), x in left.items():
        for (m, n, o), y in right.items():
            first, third, value = i + m, j + n, x * y
            if k + o <= highest:
                terms.append(((first, third, k + o), value))
            else:
                # u² = 2u − g1² − g3².
                terms.append(((first, third, 1), 2 * value))
                terms.append(((first + 2, third, 0), -value))
                terms.append(((first, third + 2, 0), -value))
    total = without_zeros(added_up(terms))
    too_long = len(total) > MOST_TERMS or any(sum(monomial) > HIGHEST_DEGREE for monomial in total)
    return None if too_long else total
