"""Exact Laurent polynomials on the sphere |g| = 1, in which formulas can be evaluated.

An element is a sum of |g1|^i |g3|^j g2^k σ^e with rational coefficients, where σ
is the sign of g3, i and j are any integers, and k and e are 0 or 1: g2² is
replaced by 1 − g1² − g3² and σ² by 1, so that every function has one form. The
sign of g1 is given. None represents any other function.
"""

from collections.abc import Mapping
from fractions import Fraction

from service.dynamics.exact import added_up, without_zeros

Exponents = tuple[int, int, int, int]
"""Exponents of |g1|, |g3|, g2 and σ."""
Laurent = Mapping[Exponents, Fraction]

MAX_TERMS = 200
MAX_POWER = 64

G2: Laurent = {(0, 0, 1, 0): Fraction(1)}
G3: Laurent = {(0, 1, 0, 1): Fraction(1)}

_SQUARE_OF_G2: tuple[tuple[int, int, int], ...] = ((0, 0, 1), (2, 0, -1), (0, 2, -1))
"""1 − g1² − g3²: exponents of g1 and g3, and the coefficient."""


def g1_of_sign(sign: int) -> Laurent:
    """Return g1 where it has this sign."""
    return {(1, 0, 0, 0): Fraction(sign)}


class LaurentAlgebra:
    """Laurent polynomials; None if a result is not one, or has more than MAX_TERMS terms.

    With ``most_products``, the result is None too after so many products of terms.
    """

    def __init__(self, most_products: int | None = None) -> None:
        self._products_left = most_products

    def constant(self, value: Fraction) -> Laurent | None:
        """Return the constant."""
        return {(0, 0, 0, 0): value} if value else {}

    def pi(self) -> Laurent | None:
        """Return None: π is not rational."""
        return None

    def add(self, left: Laurent | None, right: Laurent | None) -> Laurent | None:
        """Return left + right."""
        if left is None or right is None:
            return None
        return _collected([*left.items(), *right.items()])

    def subtract(self, left: Laurent | None, right: Laurent | None) -> Laurent | None:
        """Return left - right."""
        return self.add(left, self.negate(right))

    def multiply(self, left: Laurent | None, right: Laurent | None) -> Laurent | None:
        """Return left · right."""
        if left is None or right is None:
            return None
        if self._products_left is not None:
            self._products_left -= len(left) * len(right)
            if self._products_left < 0:
                return None
        terms: list[tuple[Exponents, Fraction]] = []
        for (i, j, k, e), factor in left.items():
            for (i2, j2, k2, e2), other in right.items():
                product, sign = factor * other, e ^ e2
                if k + k2 < 2:
                    terms.append(((i + i2, j + j2, k + k2, sign), product))
                else:
                    terms.extend(
                        ((i + i2 + a, j + j2 + b, 0, sign), product * c) for a, b, c in _SQUARE_OF_G2
                    )
        return _collected(terms)

    def divide(self, left: Laurent | None, right: Laurent | None) -> Laurent | None:
        """Return left / right, for a right that is one term without g2."""
        return self.multiply(left, _inverse(right))

    def negate(self, operand: Laurent | None) -> Laurent | None:
        """Return -operand."""
        return None if operand is None else {exponents: -factor for exponents, factor in operand.items()}

    def power(self, base: Laurent | None, exponent: Fraction) -> Laurent | None:
        """Return base^exponent for an integer exponent of at most MAX_POWER."""
        if exponent.denominator != 1 or abs(exponent) > MAX_POWER:
            return None
        factor = base if exponent >= 0 else _inverse(base)
        result = self.constant(Fraction(1))
        for _ in range(abs(exponent.numerator)):
            result = self.multiply(result, factor)
        return result

    def general_power(self, base: Laurent | None, exponent: Laurent | None) -> Laurent | None:
        """Return None: the exponent is not a constant."""
        return None

    def call(self, name: str, argument: Laurent | None) -> Laurent | None:
        """Return |argument| for one term without g2; None for other functions."""
        if name != "abs" or argument is None or len(argument) > 1:
            return None
        if any(k for _, _, k, _ in argument):
            return None
        return {(i, j, 0, 0): abs(factor) for (i, j, _, _), factor in argument.items()}


def _collected(terms: list[tuple[Exponents, Fraction]]) -> Laurent | None:
    result = without_zeros(added_up(terms))
    return result if len(result) <= MAX_TERMS else None


def _inverse(operand: Laurent | None) -> Laurent | None:
    if operand is None or len(operand) != 1:
        return None
    ((i, j, k, e), factor), *_ = operand.items()
    return None if k else {(-i, -j, 0, e): 1 / factor}
