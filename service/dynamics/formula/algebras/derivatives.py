"""First and second derivatives of the one-argument operations, in any algebra."""

from fractions import Fraction
from functools import lru_cache
from typing import TypeVar

from service.dynamics.formula.algebra import Algebra

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
