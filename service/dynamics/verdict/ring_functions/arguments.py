"""Writes arguments of exponentials, sines and cosines in a basis over Q, so that they share generators."""

from dataclasses import dataclass
from fractions import Fraction
from typing import TypeVar

from service.dynamics.verdict.exact_ring.factors import as_fraction
from service.dynamics.verdict.exact_ring.generators import Element

MAX_BASIS = 12
"""Arguments in one basis; with more of them formulas get too many generators anyway."""
MAX_INTEGER = 12
"""An integer in front of an argument up to this one is taken off: sin(3 x) and sin(2 x) share x."""
MAX_ARGUMENT_TERMS = 300
"""Most terms of an argument that is compared with others; a longer one is a basis element by itself."""

K = TypeVar("K")

Exponents = tuple[int, ...]
Vector = dict[Exponents, Fraction]


@dataclass(frozen=True, slots=True)
class _Row:
    """An argument reduced to zero at the earlier pivots; ``of`` are its coefficients in the basis."""

    pivot: Exponents
    vector: Vector
    of: dict[int, Fraction]


class ArgumentBasis:
    """Elements that are linearly independent over Q, taken from the arguments as they come.

    sin(x + y), sin(x), sin(y) get the basis (x + y, x), and y = (x + y) - x.
    """

    def __init__(self) -> None:
        self.elements: list[Element] = []
        self._rows: list[_Row] = []

    def coordinates(self, argument: Element) -> dict[int, Fraction] | None:
        """Return the argument, canonical and not zero, as Σ coefficient · basis element; it may become one.

        None if the basis is full, or the argument is too long.
        """
        if len(argument.numerator) > MAX_ARGUMENT_TERMS:
            return None
        vector, of = as_vector(argument), dict[int, Fraction]()
        for row in self._rows:
            factor = vector.get(row.pivot)
            if factor:
                vector = combined(vector, -factor, row.vector)
                of = combined(of, factor, row.of)
        if not vector:
            return of
        if len(self.elements) == MAX_BASIS:
            return None
        number, leading = len(self.elements), as_fraction(argument.numerator.leading_coefficient())
        if leading.denominator != 1 or abs(leading) > MAX_INTEGER:
            leading = Fraction(1)
        self.elements.append(Element(argument.numerator / int(leading), argument.shift))
        pivot = next(iter(vector))
        scale = 1 / vector[pivot]
        # vector = argument - Σ of · basis, and the argument is leading · (the new element).
        new = {number: leading * scale} | {index: -scale * value for index, value in of.items()}
        self._rows.append(_Row(pivot, {key: scale * value for key, value in vector.items()}, new))
        return {number: leading}


def as_vector(element: Element) -> Vector:
    """Return the coefficients of an element by the exponents of its monomials."""
    vector: Vector = {}
    for term, coefficient in element.numerator.terms():
        exponents = tuple(int(e) + s for e, s in zip(term, element.shift, strict=True))
        vector[exponents] = as_fraction(coefficient)
    return vector


def combined(vector: dict[K, Fraction], factor: Fraction, other: dict[K, Fraction]) -> dict[K, Fraction]:
    """Return vector + factor · other, without zeros."""
    result = dict(vector)
    for key, value in other.items():
        total = result.get(key, Fraction(0)) + factor * value
        if total:
            result[key] = total
        else:
            result.pop(key, None)
    return result
