"""Motions from any state by power series in integers: a reference that shares no code with the service.

Numbers are integers, multiples of 2^-bits. V is a sum of powers c g1^i g2^j g3^k with whole exponents; series
of all products that its gradient and the equations need are found order by order (Moore 1966). Steps leave
out some 2^-(bits - SPARE): errors grow as those of doubles do, and begin 1e14 times smaller.

Beside the six variables there may be the turn since t = 0, dq/dt = q ω / 2 with q = 1 at first, and the 36
derivatives of the state by that at t = 0, dΦ/dt = J Φ: the equations of variation of the same series.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import log2
from operator import mul

BITS = 160
SPARE = 60
"""Bits beyond those to which a step is taken: what a coefficient of order 30 is rounded off by may grow."""
CAREFUL = 0.9

Term = tuple[Fraction, int, int, int]
"""c, i, j, k of c g1^i g2^j g3^k."""
Series = list[int]
State = tuple[Fraction, ...]
Sum = list[tuple[Fraction, Series]]
"""A sum of series times numbers."""
Rule = Callable[[int], int]
"""Returns the coefficient of an order from those that it needs."""


@dataclass(frozen=True)
class Motion:
    """The six equations of one body in one field."""

    moments: tuple[Fraction, Fraction, Fraction]
    terms: tuple[Term, ...]
    bits: int = BITS

    @property
    def order(self) -> int:
        """Return the order of the series: steps are about as long with any number of bits."""
        return max(2, round(0.34 * (self.bits - SPARE)))

    def at(self, state: State, times: Sequence[Fraction]) -> list[list[int]]:
        """Return p, q, r, g1, g2, g3 at times that go away from 0 on one side, in multiples of 2^-bits."""
        return self._followed(_Recurrence(self, state), times)

    def turned(self, state: State, times: Sequence[Fraction]) -> list[list[int]]:
        """Return the same and the four parts of the turn since t = 0, seen from the body there."""
        return self._followed(_Recurrence(self, state, turns=True), times)

    def carried(self, state: State, time: Fraction) -> list[list[int]]:
        """Return the derivatives of the six variables at a time by those at t = 0: row by row."""
        (found,) = self._followed(_Recurrence(self, state, varies=True), [time])
        return [found[6 + row :: 6] for row in range(6)]

    def _followed(self, now: "_Recurrence", times: Sequence[Fraction]) -> list[list[int]]:
        place, found = Fraction(0), []
        for time in times:
            while place != time:
                length = now.length(abs(time - place))
                place += length if time > 0 else -length
                now.move(length if time > 0 else -length)
            found.append([series[0] for series in now.state])
        return found


class _Recurrence:
    """Series of the variables, and of all products of them that are needed."""

    def __init__(self, motion: Motion, state: State, *, turns: bool = False, varies: bool = False) -> None:
        self._bits, self._order = motion.bits, motion.order
        self.state: list[Series] = [[self._scaled(number)] for number in state]
        self._rows: list[tuple[Rule, Series]] = []
        self._known: dict[tuple[object, ...], Series] = {}
        self._one: Series = [1 << self._bits]
        p, q, r, *g = self.state
        A, B, C = motion.moments
        unit = Fraction(1)
        V = [self._slope(motion.terms, (axis,)) for axis in range(3)]

        def torque(i: int, j: int) -> Sum:
            one = [(c, self._product(g[i], series)) for c, series in V[j]]
            return one + [(-c, self._product(g[j], series)) for c, series in V[i]]

        self._rates = [
            _over(A, [(B - C, self._product(q, r)), *torque(1, 2)]),
            _over(B, [(C - A, self._product(p, r)), *torque(2, 0)]),
            _over(C, [(A - B, self._product(p, q)), *torque(0, 1)]),
            [(unit, self._product(r, g[1])), (-unit, self._product(q, g[2]))],
            [(unit, self._product(p, g[2])), (-unit, self._product(r, g[0]))],
            [(unit, self._product(q, g[0])), (-unit, self._product(p, g[1]))],
        ]
        if turns:
            self._add_turn(p, q, r)
        if varies:
            self._add_variations(motion)
        self._fill()

    def _add_turn(self, p: Series, q: Series, r: Series) -> None:
        w, x, y, z = turn = [[*self._one], [0], [0], [0]]
        self.state += turn
        signed = ((-1, x, y, z), (1, w, y, z), (1, w, z, x), (1, w, x, y))
        # 2 w' = −x p − y q − z r, 2 x' = w p + y r − z q, and so on in turn.
        for n, (first, a, b, c) in enumerate(signed):
            parts = ((p, q, r), (p, r, q), (q, p, r), (r, q, p))[n]
            signs = (first, -1, -1) if n == 0 else (first, 1, -1)
            self._rates.append(
                [
                    (Fraction(sign, 2), self._product(one, other))
                    for sign, one, other in zip(signs, (a, b, c), parts, strict=True)
                ]
            )

    def _add_variations(self, motion: Motion) -> None:
        p, q, r, *g = self.state[:6]
        A, B, C = motion.moments
        V = [self._slope(motion.terms, (axis,)) for axis in range(3)]
        bends = [[self._slope(motion.terms, (i, j)) for j in range(3)] for i in range(3)]

        def torque(i: int, j: int, by: int) -> Sum:
            """Return the derivative of g_i V_j − g_j V_i by g of the number ``by``."""
            found = [(c, self._product(g[i], series)) for c, series in bends[j][by]]
            found += [(-c, self._product(g[j], series)) for c, series in bends[i][by]]
            return found + (V[j] if by == i else []) + ([(-c, s) for c, s in V[i]] if by == j else [])

        unit = Fraction(1)
        none: Sum = []
        jacobian: list[list[Sum]] = [
            [none, [((B - C) / A, r)], [((B - C) / A, q)], *(_over(A, torque(1, 2, k)) for k in range(3))],
            [[((C - A) / B, r)], none, [((C - A) / B, p)], *(_over(B, torque(2, 0, k)) for k in range(3))],
            [[((A - B) / C, q)], [((A - B) / C, p)], none, *(_over(C, torque(0, 1, k)) for k in range(3))],
            [none, [(-unit, g[2])], [(unit, g[1])], none, [(unit, r)], [(-unit, q)]],
            [[(unit, g[2])], none, [(-unit, g[0])], [(-unit, r)], none, [(unit, p)]],
            [[(-unit, g[1])], [(unit, g[0])], none, [(unit, q)], [(-unit, p)], none],
        ]
        entries = [[self._sum(parts) for parts in row] for row in jacobian]
        for column in range(6):
            varied: list[Series] = [[self._one[0] if row == column else 0] for row in range(6)]
            self.state += varied
            for row in entries:
                self._rates.append(
                    [(unit, self._product(e, v)) for e, v in zip(row, varied, strict=True) if e is not None]
                )

    def _slope(self, terms: Sequence[Term], axes: tuple[int, ...]) -> Sum:
        """Return the derivative of V by the g of these numbers."""
        found: Sum = []
        for number, *exponents in terms:
            c = number
            for axis in axes:
                c, exponents[axis] = c * exponents[axis], exponents[axis] - 1
            if c:
                powers = [self._power(self.state[3 + i], n) for i, n in enumerate(exponents)]
                found.append((c, self._product(self._product(powers[0], powers[1]), powers[2])))
        return found

    def _scaled(self, number: Fraction) -> int:
        return (number.numerator << self._bits) // number.denominator

    def _power(self, x: Series, n: int) -> Series:
        if n == 0:
            return self._one
        if n < 0:
            return self._power(self._reciprocal(x), -n)
        return x if n == 1 else self._product(self._power(x, n - 1), x)

    def _product(self, x: Series, y: Series) -> Series:
        if x is self._one or y is self._one:
            return y if x is self._one else x
        return self._new(
            ("product", *sorted((id(x), id(y)))),
            lambda _: lambda k: sum(map(mul, x[: k + 1], y[k::-1])) >> self._bits,
        )

    def _reciprocal(self, x: Series) -> Series:
        def rule(found: Series) -> Rule:
            def coefficient(k: int) -> int:
                if k == 0:
                    return (1 << 2 * self._bits) // x[0]
                # A quotient needs what is found of it so far.
                return -(sum(map(mul, x[1 : k + 1], found[k - 1 :: -1])) // x[0])

            return coefficient

        return self._new(("reciprocal", id(x)), rule)

    def _sum(self, parts: Sum) -> Series | None:
        """Return a sum as a series of its own; None for one without parts."""
        if not parts:
            return None
        # A constant has no further coefficients.
        return self._new(
            ("sum", len(self._rows)),
            lambda _: lambda k: sum(_times(c, part[k]) for c, part in parts if k < len(part)),
        )

    def _new(self, key: tuple[object, ...], rule: Callable[[Series], Rule]) -> Series:
        if key not in self._known:
            self._known[key] = found = []
            self._rows.append((rule(found), found))
        return self._known[key]

    def _fill(self) -> None:
        """Find all orders from the state's of order 0."""
        for _, found in self._rows:
            found.clear()
        for k in range(self._order):
            for rule, found in self._rows:
                found.append(rule(k))
            for series, rate in zip(self.state, self._rates, strict=True):
                series.append(sum(_times(c, part[k]) for c, part in rate) // (k + 1))

    def length(self, most: Fraction) -> Fraction:
        """Return the length of the next step."""
        order = self._order
        last = max(abs(series[k]) for series in self.state for k in (order, order - 1))
        # What is rounded off a coefficient grows as a power of the step: of small motions all that is left of
        # high orders is 0, and steps beyond 1 would lose up to 1e-15 of what then grows.
        most = min(most, Fraction(1))
        if last == 0:
            return most
        exponent = (SPARE - log2(last)) / order
        return min(most, Fraction(int(CAREFUL * 2.0**exponent * 2**40), 2**40))

    def move(self, time: Fraction) -> None:
        """Take a step."""
        scaled = self._scaled(time)
        for series in self.state:
            value = 0
            for coefficient in reversed(series):
                value = (value * scaled >> self._bits) + coefficient
            series[:] = [value]
        self._fill()


def _over(moment: Fraction, sums: Sum) -> Sum:
    return [(c / moment, series) for c, series in sums if c]


def _times(number: Fraction, value: int) -> int:
    return value * number.numerator // number.denominator
