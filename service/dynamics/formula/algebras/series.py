"""Taylor series in one variable, up to an order, over any algebra."""

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Generic, TypeVar

from service.dynamics.formula.algebra import Algebra

T = TypeVar("T")

Series = tuple[T, ...]
"""Coefficients of 1, t, t², …"""


class SeriesAlgebra(Generic[T]):
    """Series c₀ + c₁ t + … + c_n t^n. Over intervals of t the last coefficient bounds what is left out.

    |x| and sign x have a series where the sign of x is known; elsewhere their coefficients are the algebra's NaN.
    """

    def __init__(self, base: Algebra[T], order: int) -> None:
        self._base = base
        self._order = order
        self._zero = base.constant(Fraction(0))

    def variable(self, value: T) -> Series[T]:
        """Return value + t."""
        return self.series([value, self._base.constant(Fraction(1))])

    def series(self, coefficients: Sequence[T]) -> Series[T]:
        """Return the series of these coefficients, the others being 0."""
        return (*coefficients, *[self._zero] * self._order)[: self._order + 1]

    def constant(self, value: Fraction) -> Series[T]:
        """Return an exact number."""
        return self.series([self._base.constant(value)])

    def pi(self) -> Series[T]:
        """Return π."""
        return self.series([self._base.pi()])

    def add(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return left + right."""
        return tuple(map(self._base.add, left, right))

    def subtract(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return left - right."""
        return tuple(map(self._base.subtract, left, right))

    def negate(self, operand: Series[T]) -> Series[T]:
        """Return -operand."""
        return tuple(map(self._base.negate, operand))

    def multiply(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return left · right."""
        return tuple(self._product(left, right, k, range(k + 1)) for k in range(self._order + 1))

    def divide(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return q = left / right, from left = q · right."""
        found: list[T] = []
        for k in range(self._order + 1):
            rest = left[k]
            if k:
                rest = self._base.subtract(rest, self._product(found, right, k, range(k)))
            found.append(self._base.divide(rest, right[0]))
        return tuple(found)

    def power(self, base: Series[T], exponent: Fraction) -> Series[T]:
        """Return p = base^e; where base is not 0, k x₀ p_k = Σ (e j − k + j) x_j p_{k−j}."""
        if exponent.denominator == 1 and 0 < exponent <= 4:
            power = base
            for _ in range(exponent.numerator - 1):
                power = self.multiply(power, base)
            # The value itself is tighter by the algebra's own power.
            return (self._base.power(base[0], exponent), *power[1:])
        found = [self._base.power(base[0], exponent)]
        for k in range(1, self._order + 1):
            total = self._sum(
                [
                    self._scaled(self._base.multiply(base[j], found[k - j]), (exponent * j - k + j) / k)
                    for j in range(1, k + 1)
                ]
            )
            found.append(self._base.divide(total, base[0]))
        return tuple(found)

    def general_power(self, base: Series[T], exponent: Series[T]) -> Series[T]:
        """Return exp(exponent · log(base))."""
        return self.call("exp", self.multiply(exponent, self.call("log", base)))

    def call(self, name: str, argument: Series[T]) -> Series[T]:
        """Return the function."""
        if name == "tan":
            return self.divide(self.call("sin", argument), self.call("cos", argument))
        if name in ("abs", "sign"):
            return self._of_sign(name, argument)
        functions: dict[str, Callable[[Series[T]], Series[T]]] = {
            "exp": self._exp,
            "log": self._log,
            "sin": lambda x: self._sin_cos(x)[0],
            "cos": lambda x: self._sin_cos(x)[1],
        }
        return functions[name](argument)

    def _exp(self, x: Series[T]) -> Series[T]:
        found = [self._base.call("exp", x[0])]
        for k in range(1, self._order + 1):
            found.append(self._rate(x, found, k))
        return tuple(found)

    def _log(self, x: Series[T]) -> Series[T]:
        found = [self._base.call("log", x[0])]
        for k in range(1, self._order + 1):
            rest = x[k]
            if k > 1:
                terms = [
                    self._scaled(self._base.multiply(found[j], x[k - j]), Fraction(j, k)) for j in range(1, k)
                ]
                rest = self._base.subtract(rest, self._sum(terms))
            found.append(self._base.divide(rest, x[0]))
        return tuple(found)

    def _sin_cos(self, x: Series[T]) -> tuple[Series[T], Series[T]]:
        sine, cosine = [self._base.call("sin", x[0])], [self._base.call("cos", x[0])]
        for k in range(1, self._order + 1):
            rates = self._rate(x, cosine, k), self._base.negate(self._rate(x, sine, k))
            sine.append(rates[0])
            cosine.append(rates[1])
        return tuple(sine), tuple(cosine)

    def _of_sign(self, name: str, x: Series[T]) -> Series[T]:
        base = self._base
        sign = base.call("sign", x[0])
        # x/x is 1 where x is not 0, and no number elsewhere.
        known = base.multiply(sign, base.divide(base.constant(Fraction(1)), base.multiply(sign, sign)))
        if name == "sign":
            nothing = base.multiply(self._zero, known)
            return (sign, *[nothing] * self._order)
        return (base.call("abs", x[0]), *[base.multiply(known, each) for each in x[1:]])

    def _rate(self, x: Sequence[T], other: Sequence[T], k: int) -> T:
        """Return Σ j x_j y_{k−j} / k: the coefficient of what has the rate x' y."""
        return self._sum(
            [self._scaled(self._base.multiply(x[j], other[k - j]), Fraction(j, k)) for j in range(1, k + 1)]
        )

    def _product(self, left: Sequence[T], right: Sequence[T], k: int, which: range) -> T:
        return self._sum([self._base.multiply(left[j], right[k - j]) for j in which])

    def _scaled(self, x: T, factor: Fraction) -> T:
        return x if factor == 1 else self._base.multiply(self._base.constant(factor), x)

    def _sum(self, terms: Sequence[T]) -> T:
        total = terms[0]
        for term in terms[1:]:
            total = self._base.add(total, term)
        return total
