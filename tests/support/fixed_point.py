"""Motions from any state by power series in integers: a reference that shares no code with the service.

Numbers are integers, multiples of 2^-BITS. V is a sum of powers c g1^i g2^j g3^k with whole exponents; series
of all products that its gradient and the equations need are found order by order (Moore 1966). Steps leave
out some 2^-LEFT_OUT: errors grow as those of doubles do, and begin 1e14 times smaller.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import log2
from operator import mul

BITS = 160
ORDER = 34
LEFT_OUT = 100
CAREFUL = 0.9

Term = tuple[Fraction, int, int, int]
"""c, i, j, k of c g1^i g2^j g3^k."""
Series = list[int]
State = tuple[Fraction, ...]


@dataclass(frozen=True)
class Motion:
    """The six equations of one body in one field."""

    moments: tuple[Fraction, Fraction, Fraction]
    terms: tuple[Term, ...]

    def at(self, state: State, times: Sequence[Fraction]) -> list[list[int]]:
        """Return p, q, r, g1, g2, g3 at times that go away from 0 on one side, in multiples of 2^-BITS."""
        now, place, found = _Recurrence(self, [_scaled(number) for number in state]), Fraction(0), []
        for time in times:
            while place != time:
                length = now.length(abs(time - place))
                place += length if time > 0 else -length
                now.move(length if time > 0 else -length)
            found.append([series[0] for series in now.state])
        return found


def _scaled(number: Fraction) -> int:
    return (number.numerator << BITS) // number.denominator


def _times(number: Fraction, value: int) -> int:
    return value * number.numerator // number.denominator


class _Recurrence:
    """Series of the six variables, and of all products of them that are needed."""

    def __init__(self, motion: Motion, state: list[int]) -> None:
        self.state: list[Series] = [[value] for value in state]
        self._moments = motion.moments
        self._rows: list[tuple[Callable[[int, Series, Series], int], Series, Series, Series]] = []
        self._known: dict[tuple[int, int], Series] = {}
        p, q, r, *g = self.state
        one: Series = [1 << BITS]
        self._one = one
        A, B, C = motion.moments
        V: list[list[tuple[Fraction, Series]]] = [[], [], []]
        for c, *exponents in motion.terms:
            for axis, n in enumerate(exponents):
                if n:
                    powers = [self._power(g[i], m - (i == axis)) for i, m in enumerate(exponents)]
                    V[axis].append((c * n, self._product(self._product(powers[0], powers[1]), powers[2])))

        def torque(i: int, j: int) -> list[tuple[Fraction, Series]]:
            one = [(c, self._product(g[i], series)) for c, series in V[j]]
            return one + [(-c, self._product(g[j], series)) for c, series in V[i]]

        def over(moment: Fraction, sums: list[tuple[Fraction, Series]]) -> list[tuple[Fraction, Series]]:
            return [(c / moment, series) for c, series in sums if c]

        unit = Fraction(1)
        self._rates = [
            over(A, [(B - C, self._product(q, r)), *torque(1, 2)]),
            over(B, [(C - A, self._product(p, r)), *torque(2, 0)]),
            over(C, [(A - B, self._product(p, q)), *torque(0, 1)]),
            [(unit, self._product(r, g[1])), (-unit, self._product(q, g[2]))],
            [(unit, self._product(p, g[2])), (-unit, self._product(r, g[0]))],
            [(unit, self._product(q, g[0])), (-unit, self._product(p, g[1]))],
        ]
        self._fill()

    def _power(self, x: Series, n: int) -> Series:
        if n == 0:
            return self._one
        if n < 0:
            return self._power(self._new(_reciprocal, x, x), -n)
        return x if n == 1 else self._product(self._power(x, n - 1), x)

    def _product(self, x: Series, y: Series) -> Series:
        if x is self._one or y is self._one:
            return y if x is self._one else x
        return self._new(_product, x, y)

    def _new(self, rule: Callable[[int, Series, Series], int], x: Series, y: Series) -> Series:
        key = (id(x), id(y)) if rule is _product else (id(x), 0)
        if key not in self._known:
            self._known[key] = found = []
            self._rows.append((rule, x, y, found))
        return self._known[key]

    def _fill(self) -> None:
        """Find all orders from the state's of order 0."""
        for *_, found in self._rows:
            found.clear()
        for k in range(ORDER):
            for rule, x, y, found in self._rows:
                # A quotient needs what is found of it so far.
                found.append(rule(k, x, found if rule is _reciprocal else y))
            for series, rate in zip(self.state, self._rates, strict=True):
                series.append(sum(_times(c, part[k]) for c, part in rate) // (k + 1))

    def length(self, most: Fraction) -> Fraction:
        """Return the length of the next step."""
        last = max(abs(series[k]) for series in self.state for k in (ORDER, ORDER - 1))
        # What is rounded off a coefficient grows as a power of the step: of small motions all that is left of
        # high orders is 0, and steps beyond 1 would lose up to 1e-15 of what then grows.
        most = min(most, Fraction(1))
        if last == 0:
            return most
        exponent = (BITS - LEFT_OUT - log2(last)) / ORDER
        return min(most, Fraction(int(CAREFUL * 2.0**exponent * 2**40), 2**40))

    def move(self, time: Fraction) -> None:
        """Take a step."""
        scaled = _scaled(time)
        for series in self.state:
            value = 0
            for coefficient in reversed(series):
                value = (value * scaled >> BITS) + coefficient
            series[:] = [value]
        self._fill()


def _product(k: int, x: Series, y: Series) -> int:
    return sum(map(mul, x[: k + 1], y[k::-1])) >> BITS


def _reciprocal(k: int, x: Series, found: Series) -> int:
    if k == 0:
        return (1 << 2 * BITS) // x[0]
    return -(sum(map(mul, x[1 : k + 1], found[k - 1 :: -1])) // x[0])
