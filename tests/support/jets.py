"""A number and its derivative, over balls, for references that differentiate by themselves."""

from dataclasses import dataclass
from typing import Any  # the balls of python-flint have no types

from flint import acb, arb

Ball = Any
"""arb or acb."""
Value = Any
"""A ball, or a :class:`Jet` of balls."""


@dataclass(frozen=True, slots=True)
class Jet:
    """f and its derivative."""

    value: Ball
    slope: Ball

    def __add__(self, other: Value) -> "Jet":
        if isinstance(other, Jet):
            return Jet(self.value + other.value, self.slope + other.slope)
        return Jet(self.value + other, self.slope)

    __radd__ = __add__

    def __neg__(self) -> "Jet":
        return Jet(-self.value, -self.slope)

    def __sub__(self, other: Value) -> "Jet":
        return self + (-other)

    def __rsub__(self, other: Value) -> "Jet":
        return -self + other

    def __mul__(self, other: Value) -> "Jet":
        if isinstance(other, Jet):
            return Jet(self.value * other.value, self.value * other.slope + self.slope * other.value)
        return Jet(self.value * other, self.slope * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Value) -> "Jet":
        if isinstance(other, Jet):
            quotient = self.value / other.value
            return Jet(quotient, (self.slope - quotient * other.slope) / other.value)
        return Jet(self.value / other, self.slope / other)

    def __rtruediv__(self, other: Value) -> "Jet":
        quotient = other / self.value
        return Jet(quotient, -quotient * self.slope / self.value)


def power(x: Value, exponent: int) -> Value:
    """Return a natural power; that of python-flint is no number where a ball reaches below 0."""
    result, square = x * 0 + 1, x
    while exponent:
        if exponent & 1:
            result = result * square
        square, exponent = square * square if exponent > 1 else square, exponent >> 1
    return result


def exp(x: Value) -> Value:
    if isinstance(x, Jet):
        y = x.value.exp()
        return Jet(y, y * x.slope)
    return x.exp()


def sin(x: Value) -> Value:
    return Jet(x.value.sin(), x.value.cos() * x.slope) if isinstance(x, Jet) else x.sin()


def cos(x: Value) -> Value:
    return Jet(x.value.cos(), -x.value.sin() * x.slope) if isinstance(x, Jet) else x.cos()


def root(x: Value, degree: int) -> Value:
    """Return the principal root of a number that is, where it is real, positive."""
    if degree == 1:
        return x
    if isinstance(x, Jet):
        y = root(x.value, degree)
        return Jet(y, y * x.slope / (degree * x.value))
    if isinstance(x, acb):
        # Not analytic: no number, which is what the integration asks for.
        if not x.real > 0:
            return acb("nan")
        return x.sqrt() if degree == 2 else (x.log() / degree).exp()
    return x.sqrt() if degree == 2 else x.root(degree)


def absolute(x: Value, side: int) -> Value:
    """Return |x|; ``side`` is the sign of x where it is known, else 0, of real numbers only."""
    if side:
        return side * x
    if isinstance(x, Jet):
        y = x.value
        sign = arb(1) if y > 0 else arb(-1) if y < 0 else arb(0, 1)
        return Jet(abs(y), sign * x.slope)
    assert isinstance(x, arb)
    return abs(x)
