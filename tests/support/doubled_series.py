"""Motions from any state by series in twice the digits: a reference that shares no code with the service.

A number is a double and what it leaves out, which tells 2^-104 of it (Dekker 1971). V is a sum of powers
c g1^i g2^j g3^k with whole exponents; series of all products that its gradient and the equations need are
found order by order (Moore 1966). Steps leave out some 2^-100: errors grow as those of doubles do, and begin
1e14 times smaller.

Beside the six variables there may be the turn since t = 0, dq/dt = q ω / 2 with q = 1 at first, and the 36
derivatives of the state by that at t = 0, dΦ/dt = J Φ: the equations of variation of the same series.
"""

import fcntl
import math
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

ORDER = 34
STEP_ERROR = 2.0**-100
CAREFUL = 0.9
PRODUCT, RECIPROCAL, SUM, ONE = range(4)
"""Kinds of rows of the recurrence: a product of two rows, 1 over a row, a sum of rows times numbers, 1."""

MOST_STEPS = 20_000
"""Steps from one time to the next, some seconds at most: nothing interrupts compiled code."""

Term = tuple[Fraction, int, int, int]
"""c, i, j, k of c g1^i g2^j g3^k."""
State = tuple[Fraction, ...]
Sum = list[tuple[Fraction, int]]
"""A sum of rows times numbers."""


class TooManyStepsError(ArithmeticError):
    """A motion needs more than MOST_STEPS steps."""


@intrinsic
def _fused(_, a, b, c):
    """Give a b + c with one rounding."""
    number = types.float64
    return number(number, number, number), lambda _context, builder, _signature, given: builder.fma(*given)


@njit(cache=True)
def _sum(a, b):
    """Return a + b and what that leaves out (Knuth)."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@njit(cache=True)
def _plus(a, b, c, d):
    high, low = _sum(a, c)
    return _sum(high, low + (b + d))


@njit(cache=True)
def _times(a, b, c, d):
    high = a * c
    return _sum(high, _fused(a, c, -high) + (a * d + b * c))


@njit(cache=True)
def _over(a, b, c, d):
    first = a / c
    high, low = _times(first, 0.0, c, d)
    high, low = _plus(a, b, -high, -low)
    second = high / c
    more, less = _times(second, 0.0, c, d)
    high, _ = _plus(high, low, -more, -less)
    first, second = _sum(first, second)
    return _sum(first, second + high / c)


@njit(cache=True)
def _dot(x, y, begin, k):
    """Return the sum of x_j y_(k - j), j from ``begin`` to k, rounded as if in twice the digits."""
    total, rest = 0.0, 0.0
    for j in range(begin, k + 1):
        a, c = x[j, 0], y[k - j, 0]
        high = a * c
        total, left = _sum(total, high)
        rest += left + (_fused(a, c, -high) + (a * y[k - j, 1] + x[j, 1] * c))
    return _sum(total, rest)


@njit(cache=True)
def _fill(codes, first, second, rows, numbers, rates, series):
    """Find all orders of the rows from the state's of order 0."""
    count = len(rates)
    for k in range(ORDER):
        for n in range(len(codes)):
            own, x, y = series[count + n], first[n], second[n]
            high, low = 0.0, 0.0
            if codes[n] == PRODUCT:
                high, low = _dot(series[x], series[y], 0, k)
            elif codes[n] == RECIPROCAL:
                a, b = series[x, 0, 0], series[x, 0, 1]
                high, low = (1.0, 0.0) if k == 0 else _dot(series[x], own, 1, k)
                high, low = _over(high, low, a, b) if k == 0 else _over(-high, -low, a, b)
            elif codes[n] == SUM:
                for m in range(x, y):
                    a, b = series[rows[m], k]
                    a, b = _times(numbers[m, 0], numbers[m, 1], a, b)
                    high, low = _plus(high, low, a, b)
            elif k == 0:
                high = 1.0
            own[k, 0], own[k, 1] = high, low
        for n in range(count):
            a, b = series[rates[n], k]
            series[n, k + 1, 0], series[n, k + 1, 1] = _over(a, b, k + 1.0, 0.0)


@njit(cache=True)
def _followed(codes, first, second, rows, numbers, rates, state, time, rest):
    """Take the state, shape (d, 2), on by ``time`` + ``rest``; return whether MOST_STEPS suffice."""
    count = len(rates)
    series = np.zeros((count + len(codes), ORDER + 1, 2))
    for _ in range(MOST_STEPS):
        if time == 0.0:
            return True
        series[:count, 0] = state
        _fill(codes, first, second, rows, numbers, rates, series)
        last = max(np.abs(series[:count, ORDER, 0]).max(), np.abs(series[:count, ORDER - 1, 0]).max())
        length = CAREFUL * (STEP_ERROR / last) ** (1.0 / ORDER) if last > 0.0 else math.inf
        step, low = time, rest
        if length < abs(time):
            step, low = math.copysign(length, time), 0.0
        time, rest = _plus(time, rest, -step, -low)
        for n in range(count):
            a, b = series[n, ORDER]
            for k in range(ORDER - 1, -1, -1):
                a, b = _times(a, b, step, low)
                a, b = _plus(a, b, series[n, k, 0], series[n, k, 1])
            state[n, 0], state[n, 1] = a, b
    return time == 0.0


@dataclass(frozen=True)
class Motion:
    """The six equations of one body in one field."""

    moments: tuple[Fraction, Fraction, Fraction]
    terms: tuple[Term, ...]

    def at(self, state: State, times: Sequence[Fraction]) -> list[list[Fraction]]:
        """Return p, q, r, g1, g2, g3 at times that go away from 0 on one side."""
        return _Recurrence(self).followed(state, times)

    def turned(self, state: State, times: Sequence[Fraction]) -> list[list[Fraction]]:
        """Return the same and the four parts of the turn since t = 0, seen from the body there."""
        return _Recurrence(self, turns=True).followed((*state, *map(Fraction, (1, 0, 0, 0))), times)

    def carried(self, state: State, time: Fraction) -> list[list[Fraction]]:
        """Return the derivatives of the six variables at a time by those at t = 0: row by row."""
        unit = [Fraction(int(row == column)) for column in range(6) for row in range(6)]
        (found,) = _Recurrence(self, varies=True).followed((*state, *unit), [time])
        return [found[6 + row :: 6] for row in range(6)]


_ready: set[str] = set()


@contextmanager
def _one_compiles() -> Iterator[None]:
    """Let one process at a time make its first call, which compiles or loads.

    numba numbers the files of a function by an index, which processes that compile at the same time read
    alike: then one finds the code of another signature, or of another processor, under its own number.
    """
    if _ready:
        yield
        return
    with Path(tempfile.gettempdir(), "polhode-doubled-series.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield
        _ready.add("compiled")


class _Recurrence:
    """The rows of the variables, and of all products of them that are needed."""

    def __init__(self, motion: Motion, *, turns: bool = False, varies: bool = False) -> None:
        self._count = 10 if turns else 42 if varies else 6
        self._codes: list[tuple[int, int, int]] = []
        self._terms: Sum = []
        self._known: dict[tuple[int, int, int], int] = {}
        self._one = self._row(ONE, 0, 0)
        p, q, r, *g = range(6)
        A, B, C = motion.moments
        unit = Fraction(1)
        V = [self._slope(motion.terms, (axis,)) for axis in range(3)]

        def torque(i: int, j: int) -> Sum:
            one = [(c, self._product(g[i], row)) for c, row in V[j]]
            return one + [(-c, self._product(g[j], row)) for c, row in V[i]]

        self._rates = [
            self._sum(parts)
            for parts in (
                _divided(A, [(B - C, self._product(q, r)), *torque(1, 2)]),
                _divided(B, [(C - A, self._product(p, r)), *torque(2, 0)]),
                _divided(C, [(A - B, self._product(p, q)), *torque(0, 1)]),
                [(unit, self._product(r, g[1])), (-unit, self._product(q, g[2]))],
                [(unit, self._product(p, g[2])), (-unit, self._product(r, g[0]))],
                [(unit, self._product(q, g[0])), (-unit, self._product(p, g[1]))],
            )
        ]
        if turns:
            self._add_turn(p, q, r)
        if varies:
            self._add_variations(motion)

    def followed(self, state: State, times: Sequence[Fraction]) -> list[list[Fraction]]:
        """Return the variables at the times."""
        codes, first, second = np.array(self._codes, dtype=np.int64).reshape(-1, 3).T.copy()
        rows = np.array([row for _, row in self._terms], dtype=np.int64)
        numbers = np.array([_pair(number) for number, _ in self._terms]).reshape(-1, 2)
        rates, now = np.array(self._rates, dtype=np.int64), np.array([_pair(number) for number in state])
        place, found = Fraction(0), []
        for time in times:
            with _one_compiles():
                is_there = _followed(codes, first, second, rows, numbers, rates, now, *_pair(time - place))
            if not is_there:
                raise TooManyStepsError
            place = time
            found.append([Fraction(high) + Fraction(low) for high, low in now.tolist()])
        return found

    def _add_turn(self, p: int, q: int, r: int) -> None:
        w, x, y, z = range(6, 10)
        signed = ((-1, x, y, z), (1, w, y, z), (1, w, z, x), (1, w, x, y))
        # 2 w' = −x p − y q − z r, 2 x' = w p + y r − z q, and so on in turn.
        for n, (one, a, b, c) in enumerate(signed):
            parts = ((p, q, r), (p, r, q), (q, p, r), (r, q, p))[n]
            signs = (one, -1, -1) if n == 0 else (one, 1, -1)
            halves = zip(signs, (a, b, c), parts, strict=True)
            self._rates.append(self._sum([(Fraction(s, 2), self._product(i, j)) for s, i, j in halves]))

    def _add_variations(self, motion: Motion) -> None:
        p, q, r, *g = range(6)
        A, B, C = motion.moments
        V = [self._slope(motion.terms, (axis,)) for axis in range(3)]
        bends = [[self._slope(motion.terms, (i, j)) for j in range(3)] for i in range(3)]

        def torque(i: int, j: int, by: int) -> Sum:
            """Return the derivative of g_i V_j − g_j V_i by g of the number ``by``."""
            found = [(c, self._product(g[i], row)) for c, row in bends[j][by]]
            found += [(-c, self._product(g[j], row)) for c, row in bends[i][by]]
            return found + (V[j] if by == i else []) + ([(-c, s) for c, s in V[i]] if by == j else [])

        unit = Fraction(1)
        none: Sum = []
        jacobian: list[list[Sum]] = [
            [none, [((B - C) / A, r)], [((B - C) / A, q)], *(_divided(A, torque(1, 2, k)) for k in range(3))],
            [[((C - A) / B, r)], none, [((C - A) / B, p)], *(_divided(B, torque(2, 0, k)) for k in range(3))],
            [[((A - B) / C, q)], [((A - B) / C, p)], none, *(_divided(C, torque(0, 1, k)) for k in range(3))],
            [none, [(-unit, g[2])], [(unit, g[1])], none, [(unit, r)], [(-unit, q)]],
            [[(unit, g[2])], none, [(-unit, g[0])], [(-unit, r)], none, [(unit, p)]],
            [[(-unit, g[1])], [(unit, g[0])], none, [(unit, q)], [(-unit, p)], none],
        ]
        entries = [[self._sum(parts) if parts else None for parts in row] for row in jacobian]
        for column in range(6):
            varied = range(6 + 6 * column, 12 + 6 * column)
            for row in entries:
                pairs = [(e, v) for e, v in zip(row, varied, strict=True) if e is not None]
                self._rates.append(self._sum([(unit, self._product(e, v)) for e, v in pairs]))

    def _slope(self, terms: Sequence[Term], axes: tuple[int, ...]) -> Sum:
        """Return the derivative of V by the g of these numbers."""
        found: Sum = []
        for number, *exponents in terms:
            c = number
            for axis in axes:
                c, exponents[axis] = c * exponents[axis], exponents[axis] - 1
            if c:
                powers = [self._power(3 + i, n) for i, n in enumerate(exponents)]
                found.append((c, self._product(self._product(powers[0], powers[1]), powers[2])))
        return found

    def _power(self, x: int, n: int) -> int:
        if n == 0:
            return self._one
        if n < 0:
            return self._power(self._row(RECIPROCAL, x, 0), -n)
        return x if n == 1 else self._product(self._power(x, n - 1), x)

    def _product(self, x: int, y: int) -> int:
        if self._one in (x, y):
            return y if x == self._one else x
        return self._row(PRODUCT, min(x, y), max(x, y))

    def _sum(self, parts: Sum) -> int:
        begin = len(self._terms)
        self._terms += [(number, row) for number, row in parts if number]
        return self._row(SUM, begin, len(self._terms))

    def _row(self, code: int, x: int, y: int) -> int:
        key = code, x, y
        if key not in self._known:
            self._known[key] = self._count + len(self._codes)
            self._codes.append(key)
        return self._known[key]


def _divided(moment: Fraction, parts: Sum) -> Sum:
    return [(c / moment, row) for c, row in parts]


def _pair(number: Fraction) -> tuple[float, float]:
    high = float(number)
    return high, float(number - Fraction(high))
