r"""Formulas on a loop that passes poles: powers of |g1| and |g3| as powers of sin v.

There |g1| = G |sin v|^α and |g3| = Z |sin v|, and |sin v|^{2k} is holomorphic
where |sin v| is not: V = |g1|^{3/2} is a polynomial in sin v for α = 4.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Generic, TypeVar

from service.dynamics.formula.algebra import Algebra

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Monomial(Generic[T]):
    """Something that is known to have the absolute value scale · |sin v|^exponent on the loop."""

    value: T
    scale: T
    exponent: Fraction
    sign: int | None
    """The sign of the value, if it has one all along the loop."""


class LoopAlgebra(Generic[T]):
    """The algebra ``base`` at one place; ``known`` values are recognised in abs, sign and powers."""

    def __init__(self, base: Algebra[T], sine: T, known: Sequence[Monomial[T]]) -> None:
        self._base, self._sine, self._known = base, sine, list(known)
        self.constant, self.pi, self.negate = base.constant, base.pi, base.negate
        self.add, self.subtract = base.add, base.subtract
        self.multiply, self.divide = base.multiply, base.divide
        self.general_power = base.general_power

    def call(self, name: str, argument: T) -> T:
        """Return the function of the argument."""
        found = self._recognised(argument)
        if found is None or name not in ("abs", "sign"):
            return self._base.call(name, argument)
        if name == "sign":
            return self.constant(Fraction(found.sign)) if found.sign else self._base.call(name, argument)
        if found.sign:
            value = argument if found.sign > 0 else self.negate(argument)
        else:
            value = self._base.call(name, argument)
        # An even power of sin v is holomorphic where its absolute value was not seen to be.
        even = self._even_power(found, Fraction(1))
        value = value if even is None else even
        self._known.append(Monomial(value, found.scale, found.exponent, 1))
        return value

    def power(self, base: T, exponent: Fraction) -> T:
        """Return base^exponent."""
        found = self._recognised(base)
        is_of_size = exponent.denominator == 1 and exponent.numerator % 2 == 0
        if found is not None and (found.sign == 1 or is_of_size):
            value = self._even_power(found, exponent)
            if value is not None:
                return value
        return self._base.power(base, exponent)

    def _recognised(self, value: T) -> Monomial[T] | None:
        return next((each for each in self._known if each.value is value), None)

    def _even_power(self, monomial: Monomial[T], exponent: Fraction) -> T | None:
        """Return (scale |sin v|^k)^exponent if that is an even power of sin v."""
        total = monomial.exponent * exponent
        if total.denominator != 1 or total.numerator % 2:
            return None
        base = self._base
        return base.multiply(base.power(self._sine, total), base.power(monomial.scale, exponent))
