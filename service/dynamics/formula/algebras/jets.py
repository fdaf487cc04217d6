"""Jets: a value with its derivatives along chosen directions, over any algebra.

A derivative that is identically zero is ``None``: nothing is multiplied by it,
which keeps balls tight and evaluation fast. ``gradient`` and ``hessian`` fill
the zeros in.
The derivatives of the one-argument operations are written once, in the algebra's own arithmetic.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Generic, NamedTuple, TypeVar

from service.dynamics.formula.algebra import Algebra, DerivedOperations

T = TypeVar("T")


def power_slope(algebra: Algebra[T], x: T, exponent: Fraction) -> T:
    """Return e·x^(e-1), for e other than 0 and 1."""
    numerator, denominator = exponent.as_integer_ratio()
    lowered = _power(algebra, x, numerator - denominator, denominator)
    return algebra.multiply(algebra.constant(exponent), lowered)


def power_curvature(algebra: Algebra[T], x: T, exponent: Fraction) -> T:
    """Return e·(e-1)·x^(e-2), for e other than 0 and 1."""
    numerator, denominator = exponent.as_integer_ratio()
    factor = algebra.constant(_fraction(numerator * (numerator - denominator), denominator**2))
    if numerator == 2 * denominator:
        return factor
    return algebra.multiply(factor, _power(algebra, x, numerator - 2 * denominator, denominator))


def call_slope(algebra: Algebra[T], name: str, x: T, value: T) -> T | None:
    """Return the derivative of the named function at x, where it has the given value; None is 0."""
    one = _fraction(1, 1)
    if name == "exp":
        return value
    if name == "log":
        return algebra.divide(algebra.constant(one), x)
    if name == "sin":
        return algebra.call("cos", x)
    if name == "cos":
        return algebra.negate(algebra.call("sin", x))
    if name == "tan":
        return algebra.add(algebra.constant(one), algebra.multiply(value, value))
    if name == "abs":
        return algebra.call("sign", x)
    return None


def call_curvature(algebra: Algebra[T], name: str, x: T, value: T) -> T | None:
    """Return the second derivative of the named function at x; None is 0."""
    if name == "exp":
        return value
    if name == "log":
        return algebra.negate(algebra.power(x, _fraction(-2, 1)))
    if name in ("sin", "cos"):
        return algebra.negate(value)
    if name == "tan":
        slope = algebra.add(algebra.constant(_fraction(1, 1)), algebra.multiply(value, value))
        return algebra.multiply(algebra.add(value, value), slope)
    return None


def _power(algebra: Algebra[T], x: T, numerator: int, denominator: int) -> T:
    return x if numerator == denominator else algebra.power(x, _fraction(numerator, denominator))


@lru_cache(maxsize=256)
def _fraction(numerator: int, denominator: int) -> Fraction:
    """Return the fraction; remembered, because making one costs more than a ball operation."""
    return Fraction(numerator, denominator)


Parts = tuple[T | None, ...]


class Jet(NamedTuple, Generic[T]):
    """A value and its derivatives; ``None`` is the zero derivative.

    ``first[i]`` is the derivative along direction i; ``triangle`` holds the
    second ones along (0,0), (0,1), ..., (1,1), ... and is empty for first order.
    """

    value: T
    first: tuple[T | None, ...]
    triangle: tuple[T | None, ...] = ()


class FirstOrderJets(DerivedOperations[Jet[T]], Generic[T]):
    """Values with first derivatives along ``directions`` directions; an Algebra itself."""

    def __init__(self, base: Algebra[T], directions: int) -> None:
        self._base = base
        self._zeros: Parts[T] = (None,) * directions

    def seed(self, value: T, first: Sequence[T | None]) -> Jet[T]:
        """Return an independent quantity with the given derivatives along the directions."""
        rates = tuple(first)
        # The zero derivatives are one shared object, so that they are recognised by identity.
        return self._constant(value) if all(rate is None for rate in rates) else self._linear(value, rates)

    def variables(self, values: Sequence[T]) -> tuple[Jet[T], ...]:
        """Return one quantity per direction, each growing at rate 1 along its own."""
        one = self._base.constant(Fraction(1))
        count = range(len(values))
        return tuple(
            [self._linear(values[i], tuple([one if i == j else None for j in count])) for i in count]
        )

    def gradient(self, jet: Jet[T]) -> tuple[T, ...]:
        """Return the first derivatives, zeros filled in."""
        return self._filled(jet.first)

    def constant(self, value: Fraction) -> Jet[T]:
        """Return an exact number."""
        return self._constant(self._base.constant(value))

    def pi(self) -> Jet[T]:
        """Return π."""
        return self._constant(self._base.pi())

    def add(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return left + right."""
        return Jet(self._base.add(left.value, right.value), self._sum(left.first, right.first))

    def subtract(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return left - right."""
        return Jet(self._base.subtract(left.value, right.value), self._difference(left.first, right.first))

    def negate(self, operand: Jet[T]) -> Jet[T]:
        """Return -operand."""
        return Jet(self._base.negate(operand.value), self._negated(operand.first))

    def multiply(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return left · right."""
        first = self._sum(self._scaled(right.value, left.first), self._scaled(left.value, right.first))
        return Jet(self._base.multiply(left.value, right.value), first)

    def divide(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return q = left / right; q' = (left' - q right') / right."""
        quotient = self._base.divide(left.value, right.value)
        rest = self._difference(left.first, self._scaled(quotient, right.first))
        return Jet(quotient, self._divided(rest, right.value))

    def power(self, base: Jet[T], exponent: Fraction) -> Jet[T]:
        """Return base^exponent, the exponent being neither 0 nor 1."""
        algebra, x = self._base, base.value
        value = algebra.power(x, exponent)
        if base.first is self._zeros:
            return self._constant(value)
        slope = power_slope(algebra, x, exponent)
        return self._chained(base, value, slope, lambda: power_curvature(algebra, x, exponent))

    def call(self, name: str, argument: Jet[T]) -> Jet[T]:
        """Return the function; the derivative of abs is sign, that of sign 0."""
        algebra, x = self._base, argument.value
        value = algebra.call(name, x)
        slope = None if argument.first is self._zeros else call_slope(algebra, name, x, value)
        if slope is None:
            return self._constant(value)
        return self._chained(argument, value, slope, lambda: call_curvature(algebra, name, x, value))

    def _constant(self, value: T) -> Jet[T]:
        return Jet(value, self._zeros)

    def _linear(self, value: T, first: Parts[T]) -> Jet[T]:
        return Jet(value, first)

    def _chained(self, inner: Jet[T], value: T, slope: T, curvature: Callable[[], T | None]) -> Jet[T]:
        """Return f(inner) from f, f' and, where second derivatives are wanted, f''."""
        return Jet(value, self._scaled(slope, inner.first))

    def _filled(self, parts: Parts[T]) -> tuple[T, ...]:
        zero = self._base.constant(Fraction(0))
        return tuple([zero if part is None else part for part in parts])

    def _sum(self, left: Parts[T], right: Parts[T]) -> Parts[T]:
        if right is self._zeros:
            return left
        if left is self._zeros:
            return right
        add = self._base.add
        return tuple(
            [y if x is None else x if y is None else add(x, y) for x, y in zip(left, right, strict=True)]
        )

    def _difference(self, left: Parts[T], right: Parts[T]) -> Parts[T]:
        if right is self._zeros:
            return left
        if left is self._zeros:
            return self._negated(right)
        subtract, negate = self._base.subtract, self._base.negate
        return tuple(
            [
                (None if y is None else negate(y)) if x is None else x if y is None else subtract(x, y)
                for x, y in zip(left, right, strict=True)
            ]
        )

    def _negated(self, parts: Parts[T]) -> Parts[T]:
        if parts is self._zeros:
            return parts
        negate = self._base.negate
        return tuple([None if part is None else negate(part) for part in parts])

    def _scaled(self, factor: T, parts: Parts[T]) -> Parts[T]:
        if parts is self._zeros:
            return parts
        multiply = self._base.multiply
        return tuple([None if part is None else multiply(factor, part) for part in parts])

    def _divided(self, parts: Parts[T], divisor: T) -> Parts[T]:
        if parts is self._zeros:
            return parts
        divide = self._base.divide
        return tuple([None if part is None else divide(part, divisor) for part in parts])


class SecondOrderJets(FirstOrderJets[T]):
    """Values with first and second derivatives along ``directions`` directions; an Algebra itself."""

    def __init__(self, base: Algebra[T], directions: int) -> None:
        super().__init__(base, directions)
        self._pairs = [(i, j) for i in range(directions) for j in range(i, directions)]
        self._flat: Parts[T] = (None,) * len(self._pairs)

    def hessian(self, jet: Jet[T]) -> tuple[tuple[T, ...], ...]:
        """Return the symmetric matrix of second derivatives, zeros filled in."""
        filled = dict(zip(self._pairs, self._filled(jet.triangle), strict=True))
        indices = range(len(jet.first))
        return tuple(tuple(filled[min(i, j), max(i, j)] for j in indices) for i in indices)

    def add(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return left + right."""
        value, first, _ = super().add(left, right)
        return Jet(value, first, self._sum(left.triangle, right.triangle))

    def subtract(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return left - right."""
        value, first, _ = super().subtract(left, right)
        return Jet(value, first, self._difference(left.triangle, right.triangle))

    def negate(self, operand: Jet[T]) -> Jet[T]:
        """Return -operand."""
        value, first, _ = super().negate(operand)
        return Jet(value, first, self._negated(operand.triangle))

    def multiply(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return left · right."""
        value, first, _ = super().multiply(left, right)
        plain = self._sum(self._scaled(right.value, left.triangle), self._scaled(left.value, right.triangle))
        return Jet(value, first, self._sum(plain, self._crossed(left.first, right.first)))

    def divide(self, left: Jet[T], right: Jet[T]) -> Jet[T]:
        """Return q = left / right; left = q · right is differentiated twice."""
        value, first, _ = super().divide(left, right)
        rest = self._difference(left.triangle, self._scaled(value, right.triangle))
        rest = self._difference(rest, self._crossed(first, right.first))
        return Jet(value, first, self._divided(rest, right.value))

    def _constant(self, value: T) -> Jet[T]:
        return Jet(value, self._zeros, self._flat)

    def _linear(self, value: T, first: Parts[T]) -> Jet[T]:
        return Jet(value, first, self._flat)

    def _chained(self, inner: Jet[T], value: T, slope: T, curvature: Callable[[], T | None]) -> Jet[T]:
        second = self._scaled(slope, inner.triangle)
        bend = curvature()
        if bend is not None:
            second = self._sum(second, self._outer(inner.first, self._scaled(bend, inner.first)))
        return Jet(value, self._scaled(slope, inner.first), second)

    def _outer(self, x: Parts[T], y: Parts[T]) -> Parts[T]:
        """Return x_i y_j for i ≤ j; for x parallel to y this is symmetric."""
        return tuple([self._product(x[i], y[j]) for i, j in self._pairs])

    def _crossed(self, x: Parts[T], y: Parts[T]) -> Parts[T]:
        """Return x_i y_j + x_j y_i for i ≤ j."""
        if x is self._zeros or y is self._zeros:
            return self._flat
        return self._sum(self._outer(x, y), tuple([self._product(x[j], y[i]) for i, j in self._pairs]))

    def _product(self, x: T | None, y: T | None) -> T | None:
        return None if x is None or y is None else self._base.multiply(x, y)
