"""The interface of the number types in which a formula is evaluated: numbers, arrays, balls, jets.

Hand-written formulas compute with :class:`Arithmetic`.
"""

from fractions import Fraction
from typing import Generic, Protocol, Self, TypeVar

T = TypeVar("T")


class Algebra(Protocol[T]):
    """The operations a tape needs; undefined results are the algebra's NaN, never an exception."""

    def constant(self, value: Fraction) -> T:
        """Return an exact number."""

    def pi(self) -> T:
        """Return π."""

    def add(self, left: T, right: T) -> T:
        """Return left + right."""

    def subtract(self, left: T, right: T) -> T:
        """Return left - right."""

    def multiply(self, left: T, right: T) -> T:
        """Return left · right."""

    def divide(self, left: T, right: T) -> T:
        """Return left / right."""

    def negate(self, operand: T) -> T:
        """Return -operand."""

    def power(self, base: T, exponent: Fraction) -> T:
        """Return base^exponent; a negative base is defined for integer exponents only."""

    def general_power(self, base: T, exponent: T) -> T:
        """Return exp(exponent · log(base)), defined for base > 0."""

    def call(self, name: str, argument: T) -> T:
        """Return exp, log, sin, cos, tan, abs, or sign (the derivative of abs) of the argument."""


class DerivedOperations(Generic[T]):
    """The part of an algebra that follows from its other operations; what has a closer one overrides it."""

    def subtract(self: Algebra[T], left: T, right: T) -> T:
        """Return left - right."""
        return self.add(left, self.negate(right))

    def general_power(self: Algebra[T], base: T, exponent: T) -> T:
        """Return exp(exponent · log(base))."""
        return self.call("exp", self.multiply(exponent, self.call("log", base)))


class RingElement(Protocol):
    """A type with addition and multiplication: what an :class:`Arithmetic` is, and series."""

    def __add__(self, other: Self, /) -> Self: ...
    def __sub__(self, other: Self, /) -> Self: ...
    def __mul__(self, other: Self, /) -> Self: ...
    def __neg__(self, /) -> Self: ...


class Arithmetic(RingElement, Protocol):
    """A type with division as well: balls, SymPy expressions, arrays, rationals."""

    def __truediv__(self, other: Self, /) -> Self: ...


E = TypeVar("E", bound=RingElement)


class OperatorAlgebra(Generic[E]):
    """The part of an algebra that Python's operators are, for elements that have them."""

    def add(self, left: E, right: E) -> E:
        """Return left + right."""
        return left + right

    def subtract(self, left: E, right: E) -> E:
        """Return left - right."""
        return left - right

    def multiply(self, left: E, right: E) -> E:
        """Return left · right."""
        return left * right

    def negate(self, operand: E) -> E:
        """Return -operand."""
        return -operand
