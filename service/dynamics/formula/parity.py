"""Decides from its instructions whether a formula is even or odd in variables."""

from enum import Enum
from fractions import Fraction

from service.dynamics.formula.tape import Tape


class Parity(Enum):
    """The effect of a change of signs on a value."""

    EVEN = 0
    ODD = 1
    NEITHER = 2


class ParityAlgebra:
    """An Algebra of proven parities; NEITHER means that nothing is proved."""

    def constant(self, value: Fraction) -> Parity:
        """Return that a number stays what it is."""
        return Parity.EVEN

    def pi(self) -> Parity:
        """Return that π stays what it is."""
        return Parity.EVEN

    def add(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a sum."""
        return left if left is right else Parity.NEITHER

    def subtract(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a difference."""
        return self.add(left, right)

    def multiply(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a product."""
        if Parity.NEITHER in (left, right):
            return Parity.NEITHER
        return Parity.EVEN if left is right else Parity.ODD

    def divide(self, left: Parity, right: Parity) -> Parity:
        """Return the parity of a quotient."""
        return self.multiply(left, right)

    def negate(self, operand: Parity) -> Parity:
        """Return the parity of -operand."""
        return operand

    def power(self, base: Parity, exponent: Fraction) -> Parity:
        """Return the parity of base^exponent; roots of what changes its sign have none."""
        if base is Parity.ODD:
            if exponent.denominator != 1:
                return Parity.NEITHER
            return Parity.ODD if exponent.numerator % 2 else Parity.EVEN
        return base

    def general_power(self, base: Parity, exponent: Parity) -> Parity:
        """Return the parity of base^exponent."""
        return Parity.EVEN if base is exponent is Parity.EVEN else Parity.NEITHER

    def call(self, name: str, argument: Parity) -> Parity:
        """Return the parity of a function."""
        if argument is Parity.ODD:
            if name in ("abs", "cos"):
                return Parity.EVEN
            return Parity.ODD if name in ("sin", "tan", "sign") else Parity.NEITHER
        return argument


def is_written_even(tape: Tape, position: int) -> bool:
    """Tell whether the instructions prove that the formula is even in the variable at this position."""
    known: bool | None = tape.derived.get(("even", position))
    if known is None:
        known = tape.derived["even", position] = _is_even(tape, position)
    return known


def _is_even(tape: Tape, position: int) -> bool:
    parities = [Parity.ODD if k == position else Parity.EVEN for k in range(len(tape.variables))]
    return tape.evaluate(ParityAlgebra(), parities) is Parity.EVEN
