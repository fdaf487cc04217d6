r"""Derivatives along the curve, in any algebra: of D = g1 V_3 − g3 V_1, and Taylor coefficients of formulas.

The field

.. math:: X = A g_1 g_2\,\partial_1 - Q\,\partial_2 + C g_3 g_2\,\partial_3,\qquad Q = A g_1^2 + C g_3^2,

leads along every curve |g3| = λ |g1|^{C/A}, from the pole g2 = 1 to g2 = −1: X is a positive multiple of
d/dv for 0 < v < π, smooth up to the poles and without a root. So X D > 0 all over a stretch of the curve
means that D grows there and has one zero at most; where X² D has one sign D has two at most, and so on.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Generic, NamedTuple, TypeVar  # Any: jets of jets have no type of finite length

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebra import Algebra, DerivedOperations
from service.dynamics.formula.algebras.jets import FirstOrderJets, Jet
from service.dynamics.formula.tape import Tape

T = TypeVar("T")


class _WithJumps(FirstOrderJets[T]):
    """First-order jets in which sign(x) has a derivative, 0, only where x is not 0.

    Elsewhere it is no number: what jumps may have any number of zeros.
    """

    def call(self, name: str, argument: Jet[T]) -> Jet[T]:
        if name != "sign" or argument.first is self._zeros:
            return super().call(name, argument)
        base = self._base
        nothing, one = base.constant(Fraction(0)), base.constant(Fraction(1))
        rate = base.multiply(nothing, base.divide(one, argument.value))
        return Jet(base.call(name, argument.value), tuple([rate for _ in argument.first]))


class SecondScale(NamedTuple, Generic[T]):
    """A further input of a formula, a function u of g2, and X u: for derivatives up to the first."""

    u: T
    rate: T


def derivatives_along(
    algebra: Algebra[T],
    tape: Tape,
    body: RigidBody,
    g: Sequence[T],
    order: int,
    beside: Sequence[SecondScale[T]] = (),
) -> list[T | None]:
    """Return D, X D, … up to the derivative of this order at g = (g1, g2, g3), None where it is 0.

    ``beside`` is for a tape that has such inputs beside g1, g2 and g3.
    """
    assert not beside or order <= 1
    inner: Any = algebra
    places: Any = [*g, *(each.u for each in beside)]
    for _ in range(order):
        following = _WithJumps(inner, 1)
        rates = [*rates_along(inner, body, places[:3]), *(each.rate for each in beside)]
        places = [following.seed(place, (rate,)) for place, rate in zip(places, rates, strict=True)]
        inner = following
    turned = _WithJumps(inner, 1)
    g1, g2, g3, *rest = places
    seeds = [turned.seed(g1, (inner.negate(g3),)), turned.seed(g2, (None,)), turned.seed(g3, (g1,))]
    found = tape.evaluate(turned, [*seeds, *(turned.seed(u, (None,)) for u in rest)]).first[0]
    parts: list[T | None] = []
    for depth in range(order + 1):
        part: Any = found
        for level in range(order):
            # The derivatives are taken first, then the value as often as is left.
            part = None if part is None else part.first[0] if level < depth else part.value
        parts.append(part)
    return parts


def rates_along(algebra: Algebra[T], body: RigidBody, g: Sequence[T]) -> list[T]:
    """Return X g1, X g2 and X g3."""
    g1, g2, g3 = g
    A, C = algebra.constant(body.A), algebra.constant(body.C)
    first, third = algebra.multiply(A, g1), algebra.multiply(C, g3)
    Q = algebra.add(algebra.multiply(first, g1), algebra.multiply(third, g3))
    return [algebra.multiply(first, g2), algebra.negate(Q), algebra.multiply(third, g2)]


Series = list[T]
"""Coefficients of 1, t, t², …, as many as the algebra keeps."""


class SeriesAlgebra(DerivedOperations[Series[T]], Generic[T]):
    """Series up to t^``order`` over a ``base``; an Algebra itself.

    Of balls, each coefficient encloses those about every point of the balls: that of t^k is f^(k)/k!. |x| has
    none but the first where x may be 0.
    """

    def __init__(self, base: Algebra[T], order: int) -> None:
        self._base = base
        self._order = order
        self._zero = base.constant(Fraction(0))

    def series(self, coefficients: Sequence[T]) -> Series[T]:
        """Return the series with these first coefficients, and zeros."""
        return [*coefficients, *[self._zero] * (self._order + 1 - len(coefficients))]

    def constant(self, value: Fraction) -> Series[T]:
        """Return an exact number."""
        return self.series([self._base.constant(value)])

    def pi(self) -> Series[T]:
        """Return π."""
        return self.series([self._base.pi()])

    def add(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return left + right."""
        return [self._base.add(x, y) for x, y in zip(left, right, strict=True)]

    def subtract(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return left - right."""
        return [self._base.subtract(x, y) for x, y in zip(left, right, strict=True)]

    def negate(self, operand: Series[T]) -> Series[T]:
        """Return -operand."""
        return [self._base.negate(x) for x in operand]

    def multiply(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return left · right."""
        return [self._convolved(left, right, k, range(k + 1)) for k in range(self._order + 1)]

    def divide(self, left: Series[T], right: Series[T]) -> Series[T]:
        """Return left / right."""
        found: Series[T] = []
        for k in range(self._order + 1):
            rest = self._base.subtract(left[k], self._convolved(found, right, k, range(k)))
            found.append(self._base.divide(rest, right[0]))
        return found

    def power(self, base: Series[T], exponent: Fraction) -> Series[T]:
        """Return base^exponent; whole powers also where the base may be 0."""
        if exponent.denominator == 1 and exponent > 0:
            times, result, square = exponent.numerator, self.constant(Fraction(1)), base
            while times:
                result = self.multiply(result, square) if times & 1 else result
                times >>= 1
                square = self.multiply(square, square) if times else square
            return result
        # b f' = e b' f
        found = [self._base.power(base[0], exponent)]
        for k in range(1, self._order + 1):
            weighted = [
                self._scaled(exponent * j - (k - j), self._base.multiply(base[j], found[k - j]))
                for j in range(1, k + 1)
            ]
            found.append(self._base.divide(self._scaled(Fraction(1, k), self._total(weighted)), base[0]))
        return found

    def call(self, name: str, argument: Series[T]) -> Series[T]:
        """Return the function; sign has the derivative 0 where its argument is not 0, and none else."""
        first = self._base.call(name, argument[0])
        match name:
            case "exp":
                found = [first]
                for k in range(1, self._order + 1):
                    found.append(self._integrated(argument, found, k))
                return found
            case "log":
                rates = self.divide(self._derivative(argument), argument)
                return [first, *(self._scaled(Fraction(1, k + 1), rates[k]) for k in range(self._order))]
            case "sin" | "cos":
                sine, cosine = [self._base.call("sin", argument[0])], [self._base.call("cos", argument[0])]
                for k in range(1, self._order + 1):
                    grown = self._integrated(argument, cosine, k)
                    cosine.append(self._base.negate(self._integrated(argument, sine, k)))
                    sine.append(grown)
                return sine if name == "sin" else cosine
            case "tan":
                return self.divide(self.call("sin", argument), self.call("cos", argument))
            case "abs":
                return self.multiply(self.call("sign", argument), argument)
        # 0/x is 0 where x is not 0, and no number else.
        rate = self._base.divide(self._zero, argument[0])
        return [first, *[rate] * self._order]

    def _integrated(self, argument: Series[T], of: Series[T], k: int) -> T:
        """Return the coefficient of t^k in the integral of argument' · of, whose first k are known."""
        terms = [
            self._scaled(Fraction(j, k), self._base.multiply(argument[j], of[k - j])) for j in range(1, k + 1)
        ]
        return self._total(terms)

    def _derivative(self, operand: Series[T]) -> Series[T]:
        return self.series([self._scaled(Fraction(k), operand[k]) for k in range(1, self._order + 1)])

    def _convolved(self, left: Series[T], right: Series[T], k: int, places: Sequence[int]) -> T:
        return self._total([self._base.multiply(left[j], right[k - j]) for j in places])

    def _scaled(self, factor: Fraction, operand: T) -> T:
        return operand if factor == 1 else self._base.multiply(self._base.constant(factor), operand)

    def _total(self, terms: Sequence[T]) -> T:
        total = self._zero
        for term in terms:
            total = self._base.add(total, term)
        return total


def along_curve(
    base: Algebra[T], moments: tuple[Fraction, Fraction], g: Sequence[T], order: int
) -> list[Series[T]]:
    """Return g1, g2 and g3 as series in g2 - (g2 of the place) on the curve through it, which is no pole.

    Along every curve |g3| = λ |g1|^(C/A), dg1/dg2 = -A g1 w and dg3/dg2 = -C g3 w with
    w = g2 / (A g1² + C g3²); ``moments`` are A and C.
    """
    A, C = (base.constant(moment) for moment in moments)
    zero = base.constant(Fraction(0))
    g1, g3 = [g[0]], [g[2]]
    g2 = [g[1], base.constant(Fraction(1)), *[zero] * order][: order + 1]
    Q, w = list[T](), list[T]()

    def total(left: Sequence[T], right: Sequence[T], k: int, places: Sequence[int]) -> T:
        found = zero
        for j in places:
            found = base.add(found, base.multiply(left[j], right[k - j]))
        return found

    for k in range(order):
        squares = [base.multiply(m, total(x, x, k, range(k + 1))) for m, x in ((A, g1), (C, g3))]
        Q.append(base.add(*squares))
        w.append(base.divide(base.subtract(g2[k], total(w, Q, k, range(k))), Q[0]))
        for moment, x in ((moments[0], g1), (moments[1], g3)):
            rate = base.constant(-moment / (k + 1))
            x.append(base.multiply(rate, total(x, w, k, range(k + 1))))
    return [g1, g2, g3]
