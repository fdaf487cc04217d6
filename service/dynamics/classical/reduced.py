"""The reduced form that the periodic cases share: x' = rate · u · v with u² = U(x), v² = V(x).

The state is a rational function of x, u and v. Nothing here takes a square root, so that one set of formulas
serves balls, doubles, and proofs in a ring of polynomials. Times and angular velocities are in the case's own
scale, and the place of γ is taken by T = |centre| γ: the first moment is 1, and the length of T is what
|centre| then is. A motion of any |centre| follows by changing the unit of time.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

Number: TypeAlias = Any
"""Balls as a rule; also doubles, arrays of them, rationals, polynomials: what can be added and multiplied."""
Coefficients = tuple[Number, ...]
"""Coefficients of a polynomial, that of degree 0 first."""
Constants = Mapping[str, Number]
State = tuple[Number, Number, Number, Number, Number, Number]
"""p, q, r, T1, T2, T3."""
Relations = Mapping[str, Number]
"""Expressions that vanish on the case, by a name for people."""


@dataclass(frozen=True, slots=True)
class Reduced:
    """A reduced motion: polynomials, rate, and the state as a function of (constants, x, u, v)."""

    U: Coefficients
    V: Coefficients
    rate: Number
    constants: Constants
    state: Callable[[Constants, Number, Number, Number], State]
    relations: Callable[[Constants, State], Relations]

    def converted(self, convert: Callable[[Number], Number]) -> "Reduced":
        """Return the same with other numbers."""
        constants = {
            name: tuple(map(convert, value)) if isinstance(value, tuple) else convert(value)
            for name, value in self.constants.items()
        }
        U, V = tuple(map(convert, self.U)), tuple(map(convert, self.V))
        return Reduced(U, V, convert(self.rate), constants, self.state, self.relations)


def value(coefficients: Coefficients, x: Number) -> Number:
    """Return the value of a polynomial at x."""
    total = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        total = total * x + coefficient
    return total


def derivative(coefficients: Coefficients) -> Coefficients:
    """Return the coefficients of the derivative; that of a constant is 0."""
    return tuple(k * c for k, c in enumerate(coefficients) if k) or (0 * coefficients[0],)


def divided(coefficients: Coefficients, root: Number) -> Coefficients:
    """Return the quotient of a polynomial by (x − root); the remainder is dropped."""
    quotient, carry = list[Number](), 0 * root
    for coefficient in reversed(coefficients[1:]):
        carry = carry * root + coefficient
        quotient.append(carry)
    return tuple(reversed(quotient))
