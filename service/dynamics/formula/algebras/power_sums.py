r"""Formulas as sums of powers of one small quantity, which are known where their factors have no value.

Next to a pole of the sphere that quantity is |sin v| of the loop: |g1| = G |sin v|^α and |g3| = Z |sin v|.
What products, quotients, powers and absolute values make of them is c |sin v|^e, with the exponent known
exactly: g3⁴/g1 is a multiple of |sin v|^(4−α), and has a value at the pole, where neither g3⁴ nor 1/g1 tells
it. Such a power is holomorphic as an even power of sin v is, or an odd one with its sign; and on one side of
the pole, whatever e is, in a root of |sin v|. Of a sum the lowest power is taken out where it stands under a
root or a fraction line.
"""

from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import chain
from typing import Generic, TypeVar

from service.dynamics.formula.algebra import Algebra, DerivedOperations

T = TypeVar("T")

Power = tuple[Fraction, int]
"""e and k of |x|^e (sgn x)^k, k being 0 or 1."""
ONE: Power = (Fraction(0), 0)


_EXPANDED = (3, 4)
"""Powers of sums with exact numbers that are multiplied out, as squares are."""
MOST_TERMS = 12
"""Largest number of terms of a product of two sums; of longer ones the lowest powers alone are multiplied."""


@dataclass(frozen=True, slots=True)
class PowerSum(Generic[T]):
    """Σ c |x|^e (sgn x)^k; numbers stay exact for as long as they meet no other factors."""

    terms: "Mapping[Power, T | Fraction]"


@dataclass(frozen=True, slots=True)
class Small(Generic[T]):
    """The variable x at one place: a root of it, the order of the root, and its sign."""

    root: T
    """x itself if ``side`` is 0, else |x|^(1/unit)."""
    unit: int
    side: int
    """The sign of x; 0 about x = 0, where it has both."""

    def power_of_root(self, power: Power) -> int | None:
        """Return which power of the root it is, but for its sign; None if it is none."""
        exponent, odd = power[0] * self.unit, power[1]
        is_one = exponent.denominator == 1 and (self.side != 0 or exponent.numerator % 2 == odd)
        return exponent.numerator if is_one else None


class PowerAlgebra(DerivedOperations[PowerSum[T]], Generic[T]):
    """The algebra ``base`` at one place; its elements are sums of powers of x."""

    def __init__(self, base: Algebra[T], small: Small[T]) -> None:
        self._base, self._small = base, small
        self._powers: dict[Power, T] = {}

    @property
    def powers(self) -> Set[Power]:
        """Return the powers of x that values were made of."""
        return self._powers.keys()

    def loop(self, G: T, Z: T, alpha: Fraction, g1_sign: int) -> tuple[PowerSum[T], PowerSum[T]]:
        """Return g1 and g3 on a loop, x being sin v, in primed axes."""
        size = G if g1_sign > 0 else self._base.negate(G)
        return PowerSum({(alpha, 0): size}), PowerSum({(Fraction(1), 1): Z})

    def of(self, value: T) -> PowerSum[T]:
        """Return a value that is no power of x."""
        return PowerSum({ONE: value})

    def value(self, element: PowerSum[T]) -> T:
        """Return the value of an element."""
        terms = [self._term(power, factor) for power, factor in element.terms.items()]
        return reduce(self._base.add, terms) if terms else self._base.constant(Fraction(0))

    def constant(self, value: Fraction) -> PowerSum[T]:
        """Return an exact number."""
        return PowerSum({ONE: value} if value else {})

    def pi(self) -> PowerSum[T]:
        """Return π."""
        return self.of(self._base.pi())

    def add(self, left: PowerSum[T], right: PowerSum[T]) -> PowerSum[T]:
        """Return left + right."""
        return self._sum(chain(left.terms.items(), right.terms.items()))

    def negate(self, operand: PowerSum[T]) -> PowerSum[T]:
        """Return -operand."""
        return PowerSum(
            {
                power: -factor if isinstance(factor, Fraction) else self._base.negate(factor)
                for power, factor in operand.terms.items()
            }
        )

    def multiply(self, left: PowerSum[T], right: PowerSum[T]) -> PowerSum[T]:
        """Return left · right."""
        if len(left.terms) > 1 and len(right.terms) > 1 and len(left.terms) * len(right.terms) > MOST_TERMS:
            left, right = (PowerSum(dict([self._lowest(each)])) for each in (left, right))
        return self._sum(
            (_product(power, other), self._times(factor, each))
            for power, factor in left.terms.items()
            for other, each in right.terms.items()
        )

    def divide(self, left: PowerSum[T], right: PowerSum[T]) -> PowerSum[T]:
        """Return left / right."""
        exact = _exact_quotient(left, right)
        if exact is not None:
            return exact
        power, factor = self._lowest(right)
        inverse = (-power[0], power[1])
        return PowerSum({_product(each, inverse): self._over(x, factor) for each, x in left.terms.items()})

    def power(self, base: PowerSum[T], exponent: Fraction) -> PowerSum[T]:
        """Return base^exponent."""
        if exponent == 2:
            return self.multiply(base, base)
        if len(base.terms) > 1 and exponent in _EXPANDED and all(map(_is_exact, base.terms.values())):
            return self.multiply(self.power(base, exponent - 1), base)
        (e, odd), factor = self._lowest(base)
        if odd and exponent.denominator != 1:
            return self.of(self._base.power(self.value(base), exponent))
        power = e * exponent, odd * exponent.numerator % 2
        if isinstance(factor, Fraction) and factor and (factor == 1 or exponent.denominator == 1):
            return PowerSum({power: factor**exponent.numerator})
        return PowerSum({power: self._base.power(self._plain(factor), exponent)})

    def general_power(self, base: PowerSum[T], exponent: PowerSum[T]) -> PowerSum[T]:
        """Return exp(exponent · log(base))."""
        return self.of(self._base.general_power(self.value(base), self.value(exponent)))

    def call(self, name: str, argument: PowerSum[T]) -> PowerSum[T]:
        """Return the function of the argument."""
        if name not in ("abs", "sign"):
            return self.of(self._base.call(name, self.value(argument)))
        (e, odd), factor = self._lowest(argument)
        power = (e, 0) if name == "abs" else (Fraction(0), odd)
        return PowerSum({power: self._base.call(name, self._plain(factor))})

    def _sum(self, terms: "Iterable[tuple[Power, T | Fraction]]") -> PowerSum[T]:
        total: dict[Power, T | Fraction] = {}
        for power, factor in terms:
            known = total.get(power)
            if known is None:
                total[power] = factor
            elif isinstance(known, Fraction) and isinstance(factor, Fraction):
                total[power] = known + factor
            else:
                total[power] = self._base.add(self._plain(known), self._plain(factor))
        return PowerSum(
            {power: factor for power, factor in total.items() if factor != 0 or not _is_exact(factor)}
        )

    def _times(self, left: T | Fraction, right: T | Fraction) -> T | Fraction:
        if isinstance(left, Fraction) and isinstance(right, Fraction):
            return left * right
        if left == 1 and _is_exact(left):
            return right
        if right == 1 and _is_exact(right):
            return left
        return self._base.multiply(self._plain(left), self._plain(right))

    def _over(self, left: T | Fraction, right: T | Fraction) -> T | Fraction:
        if isinstance(left, Fraction) and isinstance(right, Fraction) and right:
            return left / right
        return self._base.divide(self._plain(left), self._plain(right))

    def _plain(self, factor: T | Fraction) -> T:
        return self._base.constant(factor) if isinstance(factor, Fraction) else factor

    def _lowest(self, element: PowerSum[T]) -> "tuple[Power, T | Fraction]":
        """Return the element as one power and its factor, which need not vanish with x."""
        if not element.terms:
            return ONE, Fraction(0)
        if len(element.terms) == 1:
            return next(iter(element.terms.items()))
        lowest = min(element.terms)
        inverse = (-lowest[0], lowest[1])
        rest = PowerSum({_product(power, inverse): factor for power, factor in element.terms.items()})
        return lowest, self.value(rest)

    def _term(self, power: Power, factor: T | Fraction) -> T:
        if power == ONE:
            return self._plain(factor)
        x = self._power_of_x(power)
        return x if factor == 1 and _is_exact(factor) else self._base.multiply(self._plain(factor), x)

    def _power_of_x(self, power: Power) -> T:
        """Return |x|^e (sgn x)^k."""
        found = self._powers.get(power)
        if found is None:
            found = self._powers[power] = self._made(power)
        return found

    def _made(self, power: Power) -> T:
        base, small, (exponent, odd) = self._base, self._small, power
        whole = small.power_of_root(power)
        if whole is not None:
            found = _power(base, small.root, Fraction(whole))
            return base.negate(found) if small.side < 0 and odd else found
        size = _power(base, small.root, Fraction(small.unit)) if small.side else base.call("abs", small.root)
        found = _power(base, size, exponent)
        if not odd:
            return found
        sign = base.constant(Fraction(small.side)) if small.side else base.call("sign", small.root)
        return base.multiply(sign, found)


def _is_exact(factor: object) -> bool:
    return isinstance(factor, Fraction)


def _exact_quotient(left: PowerSum[T], right: PowerSum[T]) -> PowerSum[T] | None:
    """Return the quotient of two sums with exact numbers if it is such a sum, by long division; else None."""
    divisor = {power: factor for power, factor in right.terms.items() if isinstance(factor, Fraction)}
    rest = {power: factor for power, factor in left.terms.items() if isinstance(factor, Fraction)}
    if len(divisor) < max(2, len(right.terms)) or len(rest) < max(2, len(left.terms)):
        return None
    lowest, found = min(divisor), dict[Power, T | Fraction]()
    inverse = (-lowest[0], lowest[1])
    while rest and len(found) < MOST_TERMS:
        power = _product(min(rest), inverse)
        found[power] = factor = rest[min(rest)] / divisor[lowest]
        for other, each in divisor.items():
            place = _product(power, other)
            rest[place] = rest.get(place, Fraction(0)) - factor * each
            if not rest[place]:
                del rest[place]
    return None if rest else PowerSum(found)


def _product(left: Power, right: Power) -> Power:
    return left[0] + right[0], (left[1] + right[1]) % 2


def _power(base: Algebra[T], value: T, exponent: Fraction) -> T:
    if exponent == 0:
        return base.constant(Fraction(1))
    return value if exponent == 1 else base.power(value, exponent)
