"""Sines and cosines: generators for a basis of their arguments, numbers for multiples of π."""

from fractions import Fraction
from math import lcm
from typing import Protocol

from flint import fmpz_poly

from service.dynamics.verdict.exact_ring.factors import as_fraction
from service.dynamics.verdict.exact_ring.generators import Cosine, Element, Sine
from service.dynamics.verdict.exact_ring.layout import LayoutTooSmallError
from service.dynamics.verdict.exact_ring.ring import Ring
from service.dynamics.verdict.ring_functions.algebraic_numbers import MAX_ORDER, AlgebraicNumbers
from service.dynamics.verdict.ring_functions.arguments import ArgumentBasis

MAX_MULTIPLE = 40
"""sin(k x) is written in sin(x) and cos(x) up to this k; beyond it, sin(k x) is a generator."""
MAX_BASES = 4
"""Arguments too high multiples of one another are put into different bases, unrelated."""

Pair = tuple[Element, Element]
"""Cosine and sine."""


class TrigonometricArithmetic(Protocol):
    """The part of the ring's algebra that trigonometry uses."""

    def power(self, base: Element, exponent: Fraction) -> Element:
        """Return base^exponent."""
        ...


class Trigonometry:
    """Sines and cosines in one ring."""

    def __init__(self, ring: Ring, algebra: TrigonometricArithmetic, numbers: AlgebraicNumbers) -> None:
        self._ring = ring
        self._algebra = algebra
        self._numbers = numbers
        self._bases: list[ArgumentBasis] = [ArgumentBasis()]

    def cosine_and_sine(self, argument: Element) -> Pair:
        """Return both for any argument."""
        ring = self._ring
        half_turns, argument = self._without_half_turns(ring.canonical(argument))
        result = self._of_half_turns(half_turns)
        if argument.is_zero:
            return result
        argument = ring.canonical(argument)
        for number in range(MAX_BASES):
            if number == len(self._bases):
                self._bases.append(ArgumentBasis())
            found = self._in_basis(self._bases[number], argument)
            if found is not None:
                return self._sum(result, found)
        return self._sum(result, self._whole(argument))

    def _in_basis(self, basis: ArgumentBasis, argument: Element) -> Pair | None:
        """Return both by the addition theorems, None if the basis does not hold the argument."""
        ring, layout = self._ring, self._ring.layout
        coordinates = basis.coordinates(argument)
        if coordinates is None:
            return None
        keys = {k: f"angle:{basis.elements[k].text}" for k in coordinates}
        for k, coefficient in coordinates.items():
            degree = lcm(layout.degree(keys[k]), coefficient.denominator)
            if abs(coefficient) * degree > MAX_MULTIPLE:
                return None
            if degree != layout.degree(keys[k]):
                raise LayoutTooSmallError(layout.with_degree(keys[k], coefficient.denominator))
        result = ring.constant(Fraction(1)), ring.constant(Fraction(0))
        for k, coefficient in coordinates.items():
            pair = self._generators(keys[k], basis.elements[k])
            times = coefficient * layout.degree(keys[k])
            result = self._sum(result, self._multiple(pair, times.numerator))
        return result

    def _generators(self, key: str, basis_element: Element) -> Pair:
        """Return cosine and sine of the element divided by its degree."""
        ring = self._ring
        sine, cosine = ring.find(f"sin:{key}"), ring.find(f"cos:{key}")
        if sine is None or cosine is None:
            part = ring.constant(Fraction(1, ring.layout.degree(key)))
            argument = ring.multiply(part, basis_element)
            # The relation cos² = 1 - sin² needs the cosine to be the greater generator: made second.
            sine = ring.atom(f"sin:{key}", Sine(argument, ring.next_atom() - 1))
            cosine = ring.atom(f"cos:{key}", Cosine(argument, sine))
        return ring.polynomial(ring.context.gen(cosine)), ring.polynomial(ring.context.gen(sine))

    def _whole(self, argument: Element) -> Pair:
        """Return cosine and sine as generators of their own, the argument's sign apart."""
        negative = argument.numerator.leading_coefficient() < 0
        argument = self._ring.negate(argument) if negative else argument
        cosine, sine = self._generators(f"whole:{argument.text}", argument)
        return cosine, self._ring.negate(sine) if negative else sine

    # --- multiples of π -------------------------------------------------------------

    def _without_half_turns(self, argument: Element) -> tuple[Fraction, Element]:
        """Return r and the rest of an argument r π + rest."""
        ring = self._ring
        pi = ring.pi()
        for term, coefficient in argument.numerator.terms():
            exponents = tuple(int(e) + s for e, s in zip(term, argument.shift, strict=True))
            if exponents == tuple(int(e) for e in pi.numerator.monomial(0)):
                r = as_fraction(coefficient)
                if lcm(4, 2 * r.denominator) > MAX_ORDER:
                    break
                return r, ring.normal(ring.add(argument, ring.multiply(ring.constant(-r), pi)))
        return Fraction(0), argument

    def _of_half_turns(self, r: Fraction) -> Pair:
        """Return cos(π r) and sin(π r)."""
        ring, key = self._ring, "half turn"
        degree = lcm(ring.layout.degree(key), r.denominator)
        if degree != ring.layout.degree(key) and lcm(4, 2 * degree) <= MAX_ORDER:
            raise LayoutTooSmallError(ring.layout.with_degree(key, r.denominator))
        order = lcm(4, 2 * r.denominator)
        if lcm(4, 2 * degree) <= MAX_ORDER and r.denominator > 2:
            order = lcm(4, 2 * degree)
        turns = int(r / 2 * order)
        return self._cosine_of_turns(turns, order), self._cosine_of_turns(order // 4 - turns, order)

    def _cosine_of_turns(self, turns: int, order: int) -> Element:
        """Return cos(2π turns/order)."""
        ring = self._ring
        turns = min(turns % order, -turns % order)
        sign = 1
        if 4 * turns > order:
            sign, turns = -1, order // 2 - turns
        if turns == 0 or 4 * turns == order:
            return ring.constant(Fraction(sign if turns == 0 else 0))
        before, current = ring.constant(Fraction(2)), self._unit(order)
        double = current
        for _ in range(turns - 1):
            before, current = (
                current,
                ring.normal(ring.add(ring.multiply(double, current), ring.negate(before))),
            )
        return ring.multiply(ring.constant(Fraction(sign, 2)), current)

    def _unit(self, order: int) -> Element:
        """Return 2 cos(2π/order), in square roots if its degree is at most 4."""
        ring = self._ring
        minimal = fmpz_poly.cos_minpoly(order)
        a = [ring.constant(Fraction(int(minimal[k]))) for k in range(3)]
        half = Fraction(1, 2)
        match int(minimal.degree()):
            case 2:  # order 8 or 12: x² + a0
                return self._algebra.power(ring.negate(a[0]), half)
            case 4:  # order 16, 20 or 24: x⁴ + a2 x² + a0, the largest root
                inside = ring.add(ring.multiply(a[2], a[2]), ring.multiply(ring.constant(Fraction(-4)), a[0]))
                square = ring.add(self._algebra.power(inside, half), ring.negate(a[2]))
                return self._algebra.power(ring.multiply(ring.constant(half), square), half)
        return self._numbers.cosine_of_turn(order)

    # --- addition theorems ------------------------------------------------------------

    def _sum(self, one: Pair, other: Pair) -> Pair:
        """Return cosine and sine of the sum of two angles."""
        ring, (c, s), (d, t) = self._ring, one, other
        cosine = ring.add(ring.multiply(c, d), ring.negate(ring.multiply(s, t)))
        return ring.normal(cosine), ring.normal(ring.add(ring.multiply(s, d), ring.multiply(c, t)))

    def _multiple(self, pair: Pair, times: int) -> Pair:
        """Return cosine and sine of ``times`` the angle."""
        ring = self._ring
        if times < 0:
            pair, times = (pair[0], ring.negate(pair[1])), -times
        result = None
        while times:
            if times & 1:
                result = pair if result is None else self._sum(result, pair)
            times >>= 1
            if times:
                pair = self._sum(pair, pair)
        return result if result is not None else (ring.constant(Fraction(1)), ring.constant(Fraction(0)))
