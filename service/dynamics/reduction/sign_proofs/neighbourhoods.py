r"""The signs and sizes of p² about a place where parts of the formula vanish that depend on g2 alone.

Each side of the place is enclosed in an algebra whose scale is |u| for a monotone part u, whose place need
not be known exactly, or else the distance δ = |g2 − c|, c being exact: every part with a zero of order k is
δ^k times T there, where T is among the values of its k-th derivative over k!, and its slope is k δ^(k−1)
times another one of them. So exp(g2) − 1 − g2 is δ² times something, and sin(g2) over it 1/δ times something.
"""

import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from math import nan

from flint import arb

from service.dynamics.formula.algebra import DerivedOperations
from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.long_intervals import LongInterval, LongIntervalAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.formula.vanishing import VanishingPart, vanishing_parts
from service.dynamics.reduction.geometry.slopes import SecondScale, derivatives_along
from service.dynamics.reduction.root_finding.zeros import enclose_zero
from service.dynamics.reduction.sign_proofs.cells import LOG_POWER, Curves
from service.dynamics.reduction.sign_proofs.high_zeros import ExactPlace, exact_place, taylor_of_function

UNDEFINED = 2
"""In place of a sign."""
UNDEFINED_HERE = arb.nan()
"""In place of a ball."""
MAX_ORDER_OF_PART = 6
"""Largest order of a zero of a divisor that is looked for."""
_ONE = LongInterval(arb(1), arb(1))


class UnbrokenBalls(BallAlgebra):
    """Balls in which what jumps has no value where it may do so."""

    def call(self, name: str, argument: arb) -> arb:
        """Return the function of the ball."""
        if name == "sign" and argument.contains(0):
            return arb.nan()
        return super().call(name, argument)


@dataclass(frozen=True, slots=True)
class _Split:
    """A number beside u = 0: what is continuous there, and something else; None is 0."""

    regular: arb | None
    rest: LongInterval | None = None


class _SplitAlgebra(DerivedOperations[_Split]):
    """The algebra of numbers with a continuous part at u = 0 and a part known by a power of |u|."""

    def __init__(self, intervals: "LongDomainIntervals") -> None:
        self._intervals, self._balls = intervals, UnbrokenBalls()

    def limit(self, x: _Split) -> arb | None:
        """Return a ball of all values of what has a limit at u = 0, which is that of its regular part."""
        regular = arb(0) if x.regular is None else x.regular
        if x.rest is None:
            return regular if regular.is_finite() else None
        if not (x.rest.exponent > 0 and x.rest.is_bounded):
            return None
        values = self._intervals.beside_nothing(x.rest)
        total = regular + values.lo.union(values.hi)
        return total if total.is_finite() else None

    def constant(self, value: Fraction) -> _Split:
        """Return the number."""
        return _Split(self._balls.constant(value) if value else None)

    def pi(self) -> _Split:
        """Return π."""
        return _Split(arb.pi())

    def add(self, left: _Split, right: _Split) -> _Split:
        """Return left + right."""
        balls, rests = (left.regular, right.regular), (left.rest, right.rest)
        regular = balls[0] if balls[1] is None else balls[1] if balls[0] is None else balls[0] + balls[1]
        rest = rests[0] if rests[1] is None else rests[1]
        if rests[0] is not None and rests[1] is not None:
            rest = self._intervals.add(rests[0], rests[1])
        return _Split(regular, rest)

    def negate(self, operand: _Split) -> _Split:
        """Return -operand."""
        regular, rest = operand.regular, operand.rest
        return _Split(
            None if regular is None else -regular, None if rest is None else self._intervals.negate(rest)
        )

    def multiply(self, left: _Split, right: _Split) -> _Split:
        """Return left · right."""
        regular = None if left.regular is None or right.regular is None else left.regular * right.regular
        found = _Split(regular)
        for one, other in ((left, right), (right, left)):
            if one.rest is not None and other.regular is not None:
                factor = LongInterval(other.regular.lower(), other.regular.upper())
                found = self.add(found, _Split(None, self._intervals.multiply(one.rest, factor)))
        if left.rest is not None and right.rest is not None:
            found = self.add(found, _Split(None, self._intervals.multiply(left.rest, right.rest)))
        return found

    def divide(self, left: _Split, right: _Split) -> _Split:
        """Return left / right."""
        return self.multiply(left, self.power(right, Fraction(-1)))

    def power(self, base: _Split, exponent: Fraction) -> _Split:
        """Return base^exponent."""
        if base.regular is None and base.rest is not None:
            return _Split(None, self._intervals.power(base.rest, exponent))
        total = self.limit(base)
        return _Split(arb.nan() if total is None else self._balls.power(total, exponent))

    def call(self, name: str, argument: _Split) -> _Split:
        """Return the function: of what has a limit it has one, but for signs and logarithms of what is 0."""
        total = self.limit(argument)
        is_known = total is not None and name not in ("abs", "sign", "log")
        if argument.regular is None and argument.rest is not None and not is_known:
            return _Split(None, self._intervals.call(name, argument.rest))
        return _Split(arb.nan() if total is None else self._balls.call(name, total))


class LongDomainIntervals(LongIntervalAlgebra):
    """Intervals that remember whether a root or a logarithm certainly has no value."""

    is_undefined = False

    def beside_nothing(self, x: LongInterval) -> LongInterval:
        """Return the element without a power of the scale."""
        return self._beside(x, Fraction(0))

    def power(self, base: LongInterval, exponent: Fraction) -> LongInterval:
        """Return base^exponent."""
        self.is_undefined |= exponent.denominator > 1 and base.sign < 0
        return super().power(base, exponent)

    def call(self, name: str, argument: LongInterval) -> LongInterval:
        """Return the function."""
        self.is_undefined |= name == "log" and argument.sign < 0
        return super().call(name, argument)


@dataclass(frozen=True, slots=True)
class _Input:
    """A part of the formula that vanishes at the place, as a power of the scale where g2 is larger."""

    order: int
    value: arb
    """Bounds of the coefficient, beside the scale to the order."""
    slope: arb
    """Bounds of its derivative in g2, beside one power less."""

    def beside(self, algebra: "LongDomainIntervals", side: int, Q: LongInterval) -> SecondScale[LongInterval]:
        """Return the part and X of it on a side of the place; X g2 = −Q."""
        value, slope = self.value * side**self.order, self.slope * side ** (self.order - 1)
        u = LongInterval(value.lower(), value.upper(), Fraction(self.order))
        rate = LongInterval(slope.lower(), slope.upper(), Fraction(self.order - 1))
        return SecondScale(u, algebra.negate(algebra.multiply(rate, Q)))


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """A box of g1, g2, g3 in which parts of the formula vanish at one g2."""

    curves: Curves
    part: VanishingPart
    g: list[arb]
    crossing: Callable[[arb], arb]
    """A function of g2 that changes its sign at the place, and nowhere else."""
    whole: Tape
    """The formula, with the parts as further inputs."""
    inputs: tuple[_Input, ...]
    size: arb
    """Bound of the scale."""
    has_no_g2: bool = False
    """Whether the place is the equator: g2 is the scale itself."""

    def limits(self, at_start: arb, at_stop: arb) -> tuple[int, int] | None:
        """Return the signs of P, or UNDEFINED, beside the place, the side of larger g2 first.

        None if they are not proved, or the crossings at the ends of a stretch do not show that it is on that.
        """
        if not at_start * at_stop < 0:
            return None
        before, after = self.limit(1), self.limit(-1)
        if before is None or after is None or before == after == UNDEFINED:
            return None
        return before, after

    def limit(self, side: int) -> int | None:
        """Return the sign of infinity that P tends to where g2 is larger (side 1) or smaller than at u = 0.

        UNDEFINED if P has no value there, None if nothing is proved.
        """
        for log_power in (Fraction(0), LOG_POWER):
            D, rate, is_undefined = self._enclosed(side, log_power)
            if is_undefined:
                return UNDEFINED
            if D is not None and D.exponent < 0 and _is_away(D):
                return D.sign * self.curves.turn
            if rate is not None and rate.exponent <= -1 and _is_away(rate):
                # X leads from larger g2 to smaller.
                return side * rate.sign * self.curves.turn
        return None

    def bounded(self, side: int) -> arb | None:
        """Return D on a side if it has a limit at u = 0 that depends on g alone; None if that is not proved.

        UNDEFINED_HERE if it certainly has no value on the side.
        """
        for log_power in (Fraction(0), LOG_POWER):
            intervals = LongDomainIntervals(arb(0), self.size, log_power)
            algebra = _SplitAlgebra(intervals)
            # X u is not used: D is no derivative along the curve.
            beside = [
                SecondScale(_Split(None, each.beside(intervals, side, _ONE).u), _Split(None))
                for each in self.inputs
            ]
            g1, g2, g3 = map(_Split, self.g)
            if self.has_no_g2:
                g2 = _Split(None, self._g2(side))
            (D,) = derivatives_along(algebra, self.whole, self.curves.body, [g1, g2, g3], 0, beside)
            if intervals.is_undefined:
                return UNDEFINED_HERE
            limit = arb(0) if D is None else algebra.limit(D)
            if limit is not None:
                return limit
        return None

    def _enclosed(
        self, side: int, log_power: Fraction
    ) -> tuple[LongInterval | None, LongInterval | None, bool]:
        """Return D and X D on a side, and whether they certainly have no value."""
        algebra = LongDomainIntervals(arb(0), self.size, log_power)
        A, C = (algebra.constant(moment) for moment in (self.curves.body.A, self.curves.body.C))
        g1, g2, g3 = (LongInterval(x.lower(), x.upper()) for x in self.g)
        g2 = self._g2(side) if self.has_no_g2 else g2
        Q = algebra.add(
            algebra.multiply(A, algebra.power(g1, Fraction(2))),
            algebra.multiply(C, algebra.power(g3, Fraction(2))),
        )
        beside = [each.beside(algebra, side, Q) for each in self.inputs]
        D, rate = derivatives_along(algebra, self.whole, self.curves.body, [g1, g2, g3], 1, beside)
        return D, rate, algebra.is_undefined

    def sign(self, side: int) -> int:
        """Return the sign of P on a side where it is proved to be bounded and away from 0, else 0."""
        D, _, is_undefined = self._enclosed(side, Fraction(0))
        is_known = D is not None and not is_undefined and D.exponent == 0 and D.is_bounded and _is_away(D)
        return D.sign * self.curves.turn if D is not None and is_known else 0

    @staticmethod
    def _g2(side: int) -> LongInterval:
        return LongInterval(arb(side), arb(side), Fraction(1))


def neighbourhoods(curves: Curves, g: list[arb]) -> Iterator[Neighbourhood]:
    """Yield what is known about the places in a box where parts vanish that a formula divides by.

    Of one part that is monotone there, without a place that is exact; then of all parts at an exact place.
    """
    for part in vanishing_parts(curves.tape):
        found = _first_slope(part.part, g[1])
        if found is None:
            continue
        order, slope, size = found
        crossing = partial(_derivative, part.part, order - 1)
        if order == 1:
            of_part = _Input(1, arb(sign_of(slope)), slope)
            yield Neighbourhood(curves, part, g, crossing, part.whole, (of_part,), size)
        exact = _exact_inputs(curves.tape, part.part, g[1], crossing)
        if exact is not None:
            place, inputs = exact
            size, away = abs(g[1] - place.g2).abs_upper(), partial(operator.sub, place.g2)
            yield Neighbourhood(curves, part, g, away, place.whole, inputs, size, has_no_g2=place.g2 == 0)


def spread_about_zeros(tape: Tape, g: Sequence[arb]) -> float:
    """Return by how much a formula varies at most in a box of g1, g2, g3 where parts vanish at an exact g2.

    So 0/0 has bounds where it has a limit. NaN if nothing is proved. Parts of it are bounded by powers of the
    distance from that g2, on either side.
    """
    for part in vanishing_parts(tape):
        found = _first_slope(part.part, g[1])
        crossing = None if found is None else partial(_derivative, part.part, found[0] - 1)
        exact = None if crossing is None else _exact_inputs(tape, part.part, g[1], crossing)
        if exact is None:
            continue
        place, inputs = exact
        algebra = LongDomainIntervals(arb(0), abs(g[1] - place.g2).abs_upper())
        nothing, values = algebra.constant(Fraction(0)), list[LongInterval]()
        for side in (1, -1):
            beside = [each.beside(algebra, side, nothing).u for each in inputs]
            box = [LongInterval(x.lower(), x.upper()) for x in g]
            if place.g2 == 0:
                box[1] = LongInterval(arb(side), arb(side), Fraction(1))
            values.append(algebra.beside_nothing(place.whole.evaluate(algebra, [*box, *beside])))
        if not algebra.is_undefined and all(value.is_bounded for value in values):
            spread = values[0].hi.max(values[1].hi) - values[0].lo.min(values[1].lo)
            return float(spread.upper())
    return nan


def _first_slope(part: Tape, g2: arb) -> tuple[int, arb, arb] | None:
    """Return the lowest k whose derivative, over k!, is away from 0 on a ball, it, and a bound of the part.

    None if the part has no zero there, or none of so low an order.
    """
    value = _derivative(part, 0, g2)
    if not value.contains(0):
        return None
    for order in range(1, MAX_ORDER_OF_PART + 1):
        slope = _derivative(part, order, g2)
        if sign_of(slope if slope.is_finite() else None):
            return order, slope, value.abs_upper()
    return None


def _derivative(part: Tape, order: int, g2: arb) -> arb:
    return taylor_of_function(BallAlgebra(), part, g2, order)[order]


def _exact_inputs(
    tape: Tape, part: Tape, g2: arb, crossing: Callable[[arb], arb]
) -> tuple[ExactPlace, tuple[_Input, ...]] | None:
    """Return the exact place inside a ball at which a part vanishes, and all parts that vanish there."""
    low, high = g2.lower(), g2.upper()
    if not crossing(low) * crossing(high) < 0:
        return None
    place = exact_place(tape, part, enclose_zero(crossing, low, high))
    if place is None or not (low < place.g2 and place.g2 < high):
        return None
    inputs = []
    for each, order in place.vanishing:
        T = _derivative(each, order, g2)
        inputs.append(_Input(order, T, order * T))
    return place, tuple(inputs)


def sign_of(D: arb | None) -> int:
    """Return the sign of a ball, 0 if it is not certain; None is 0."""
    return 0 if D is None or D.contains(0) else 1 if D > 0 else -1


def _is_away(x: LongInterval) -> bool:
    """Tell whether the coefficient is away from 0."""
    return bool(x.lo <= x.hi and (x.lo > 0 or x.hi < 0))
