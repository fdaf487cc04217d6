"""Evaluates ring elements as balls, on a box of the sphere or as constants."""

from fractions import Fraction

from flint import arb

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.verdict.exact_ring.generators import (
    CircleConstant,
    Coordinate,
    Cosine,
    CosineOfTurn,
    Divisor,
    Element,
    Exponential,
    Logarithm,
    Root,
    Sine,
)
from service.dynamics.verdict.exact_ring.ring import Ring

_BALLS = BallAlgebra()


class GeneratorValues:
    """A ball for each generator's value, at the current precision.

    ``gamma`` are balls of g1, g2, g3; none are needed for numbers. A value is
    not finite where the balls are too wide for a division or a logarithm.
    """

    def __init__(self, ring: Ring, gamma: tuple[arb, arb, arb] | None = None) -> None:
        self._ring = ring
        self._gamma = gamma
        self._known: dict[int, arb] = {}

    def element(self, element: Element) -> arb:
        """Return a ball of the element."""
        total = arb(0)
        for exponents, coefficient in element.numerator.terms():
            term = arb(coefficient)
            for index, (low, shift) in enumerate(zip(exponents, element.shift, strict=True)):
                exponent = int(low) + shift
                if exponent:
                    term *= _BALLS.power(self.generator(index), Fraction(exponent))
            total += term
        return total

    def generator(self, index: int) -> arb:
        """Return a ball of the generator."""
        if index not in self._known:
            self._known[index] = self._value(index)
        return self._known[index]

    def _value(self, index: int) -> arb:
        match self._ring.natures[index]:
            case Coordinate(position, degree):
                if self._gamma is None:
                    raise ValueError("a number was expected")
                return _root(self._ring.signs[position] * self._gamma[position], degree)
            case CircleConstant(degree):
                return _root(arb.pi(), degree)
            case Root(base, degree):
                return _root(self.element(base), degree)
            case Divisor(base):
                return self.element(base)
            case Exponential(exponent, degree):
                return (self.element(exponent) / degree).exp()
            case Logarithm(argument):
                return self.element(argument).log()
            case Sine(argument, _):
                return self.element(argument).sin()
            case Cosine(argument, _):
                return self.element(argument).cos()
            case CosineOfTurn(order):
                return 2 * (2 * arb.pi() / order).cos()


def coordinates_in(ring: Ring, element: Element) -> set[int]:
    """Return the positions 0, 1, 2 of the coordinates that an element depends on, by its generators too."""
    found: set[int] = set()
    seen: set[int] = set()
    pending = [element]
    while pending:
        current = pending.pop()
        for index, (degree, shift) in enumerate(zip(current.numerator.degrees(), current.shift, strict=True)):
            if index in seen or (degree <= 0 and shift == 0):
                continue
            seen.add(index)
            match ring.natures[index]:
                case Coordinate(position):
                    found.add(position)
                case Root(inner) | Divisor(inner) | Exponential(inner) | Logarithm(inner):
                    pending.append(inner)
                case Sine(inner) | Cosine(inner):
                    pending.append(inner)
    return found


def _root(ball: arb, degree: int) -> arb:
    """Return the root of a number known not to be negative, even if its ball contains negative ones."""
    if degree == 1:
        return ball
    if ball > 0:
        return _BALLS.power(ball, Fraction(1, degree))
    if not ball.is_finite() or ball.upper() < 0:
        return arb("nan")
    return arb(0).union(_BALLS.power(arb(ball.upper()), Fraction(1, degree)))
