r"""Proves where p² grows without bound between two places, and that it is continuous where it is 0.

Where a part u of the formula vanishes, which depends on g2 alone and is monotone there, each side of u = 0
is enclosed in an algebra whose scale is δ = |u|: D = g1 V_3 − g3 V_1 is δ^e times something bounded. If e < 0
and the coefficient is away from 0, |D| → ∞. So it does where X D is δ^e with e ≤ −1 and a coefficient away
from 0: its integral diverges, as that of 1/δ for a logarithm in D. There D is monotone besides, and has one
zero at most on that side, however weak the infinite part is beside the rest.

The time to such a place, ∫ dv/√P, is finite.
"""

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from flint import arb

from service.dynamics.formula.algebras.ball import BallAlgebra
from service.dynamics.formula.algebras.jets import FirstOrderJets
from service.dynamics.formula.algebras.long_intervals import LongInterval, LongIntervalAlgebra
from service.dynamics.formula.vanishing import VanishingPart, has_essential_part, vanishing_parts
from service.dynamics.reduction.geometry.slopes import SecondScale, derivatives_along
from service.dynamics.reduction.root_finding.zeros import LoopPlace, Radicand, enclose_zero
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN
from service.dynamics.reduction.sign_proofs.cells import Curves, Half
from service.dynamics.reduction.sign_proofs.signs_in_balls import (
    LOG_POWER,
    Side,
    place_at,
    place_on_stretch,
    region_of_stretch,
    width_of,
)

UNDEFINED = 2
"""In place of a sign."""
UNDEFINED_HERE = arb.nan()
"""In place of a ball."""
MAX_STRETCHES = 2000
"""At stretches of one half."""
STRETCH_MIN_RELATIVE_WIDTH = 1e-9
"""Relative width of a stretch that is not cut any more."""
INFINITY_LOG2_DISTANCES = (4, 8, 16, 32, 64, 96, 128)
"""-log2 of the distances from an infinity, against the stretch, at which P is tried for the sign it has next
to it."""


@dataclass(frozen=True, slots=True)
class Infinity:
    """The one place of a stretch where P is infinite, and its sign on both sides of it, or UNDEFINED."""

    start: Side
    stop: Side
    place: LoopPlace
    ends: tuple[arb, arb]
    """The coordinates of both ends, in the region of the place."""
    signs: tuple[int, int]

    def cuts(self, radicand: Radicand, before: int, after: int) -> list[LoopPlace] | None:
        """Return places that show the signs of P on the stretch, which has these labels, or 0, at its ends.

        None where they are not found.
        """
        cuts = [self.place]
        for near, label, end in zip(self.signs, (before, after), self.ends, strict=True):
            if near == label or (near == UNDEFINED and label == 0):
                continue
            beside = None if UNDEFINED in (near, label) else self._beside(radicand, end, near)
            if beside is None:
                return None
            cuts.append(beside)
        return cuts

    def _beside(self, radicand: Radicand, end: arb, sign: int) -> LoopPlace | None:
        """Return a place on the side of ``end`` where P has the sign that it has next to the infinity."""
        centre = self.place.x.mid()
        for bits in INFINITY_LOG2_DISTANCES:
            x = (centre + (end - centre) * arb(2) ** -bits).mid()
            if radicand(LoopPlace(self.place.region, x)) * sign > 0:
                return LoopPlace(self.place.region, x, sign=sign)
        return None


def infinity_between(half: Half, start: Side, stop: Side) -> Infinity | None:
    """Return where P is proved to be infinite between two places, the first at the smaller v; None if not."""
    g = place_on_stretch(half, start, stop)
    region, ends = region_of_stretch(start, stop)
    for part in vanishing_parts(half.tape):

        def value(x: arb, part: VanishingPart = part) -> arb:
            return part.part.evaluate(BallAlgebra(), place_at(half, region, x))

        signs = _limits(half, part, g, (value(ends[0]), value(ends[1])))
        if signs is not None:
            place = LoopPlace(region, enclose_zero(value, *ends), is_infinite=True)
            return Infinity(start, stop, place, (ends[0], ends[1]), signs)
    return None


def limits_between(curves: Curves, g: list[arb], ends: tuple[arb, arb]) -> tuple[int, int] | None:
    """Return the signs of P next to the one place in a box where it is infinite, first where g2 is larger.

    The box holds a stretch of a curve, of each λ of some; ``ends`` hold g2 where the stretches begin and end.
    On a side P has this sign, or is monotone.
    """
    for part in vanishing_parts(curves.tape):
        values = (part.part.evaluate(BallAlgebra(), [g[0], end, g[2]]) for end in ends)
        signs = _limits(curves, part, g, (next(values), next(values)))
        if signs is not None:
            return signs
    return None


def _limits(
    curves: Curves, part: VanishingPart, g: list[arb], values: tuple[arb, arb]
) -> tuple[int, int] | None:
    """Return the signs of P, or UNDEFINED, beside where a part vanishes, whose ``values`` are at the ends."""
    near = _Neighbourhood.of(curves, part, g)
    if near is None or not values[0] * values[1] < 0:
        return None
    before, after = near.limit(1), near.limit(-1)
    if before is None or after is None or before == after == UNDEFINED:
        return None
    return before, after


def infinities_of(half: Half) -> list[Infinity] | None:
    """Return all places of a half where P is infinite; None where a part vanishes and it is not settled.

    Without bounds of P: for a potential of which the formula is all that can be infinite.
    """
    found = list[Infinity]()
    for part in vanishing_parts(half.tape):
        waiting, looks = _stretches(), 0
        while waiting:
            start, stop = waiting.pop()
            looks += 1
            if looks > MAX_STRETCHES:
                return None
            if not _may_vanish(half, part, start, stop):
                continue
            infinity = infinity_between(half, start, stop)
            if infinity is not None:
                found.append(infinity)
            elif width_of(start, stop) > STRETCH_MIN_RELATIVE_WIDTH:
                waiting.extend(_halves(start, stop))
            elif continuous_sign(half, start, stop) is None:
                return None
    return found


def _may_vanish(half: Half, part: VanishingPart, start: Side, stop: Side) -> bool:
    """Tell whether a part may vanish on a stretch; at the edge of where it has a value it is not asked."""
    g = [LongInterval(x.lower(), x.upper()) for x in place_on_stretch(half, start, stop)]
    algebra = _DomainIntervals(arb(0), arb(1) / 2)
    u = part.part.evaluate(algebra, g)
    if algebra.is_undefined or u.sign:
        return False
    return bool(u.lo <= u.hi) or width_of(start, stop) > STRETCH_MIN_RELATIVE_WIDTH


def _stretches() -> list[tuple[Side, Side]]:
    """Return stretches from pole to pole, one of them across the equator."""
    ends = [1e-6, 1e-3, 0.1, *(0.25 * k for k in range(1, 7))]
    north = [((1.0, low), (1.0, high)) for low, high in pairwise(ends)]
    south = [((-1.0, high), (-1.0, low)) for low, high in pairwise(ends)]
    return [*north, ((1.0, ends[-1]), (-1.0, ends[-1])), *south]


def _halves(start: Side, stop: Side) -> list[tuple[Side, Side]]:
    if start[0] == stop[0]:
        # A place that is likely to be one where a part vanishes is no end.
        middle = (start[0], start[1] + 0.4871 * (stop[1] - start[1]))
        return [(start, middle), (middle, stop)]
    inner = [(side, QUARTER_TURN - 0.4871 * (QUARTER_TURN - x)) for side, x in (start, stop)]
    return [(start, inner[0]), (inner[0], inner[1]), (inner[1], stop)]


def continuous_sign(half: Half, start: Side, stop: Side) -> int | None:
    """Return the sign of P between two places, 0 if it is not known; None if P is not proved continuous.

    Where P has no value on one side of a place, its limit is that of the other side.
    """
    g = place_on_stretch(half, start, stop)
    (D,) = derivatives_along(_UnbrokenBalls(), half.tape, half.body, g, 0)
    if D is None or D.is_finite():
        return _sign(D) * half.turn
    for part in vanishing_parts(half.tape):
        near = _Neighbourhood.of(half, part, g)
        sides = [] if near is None else [near.bounded(side) for side in (1, -1)]
        if sides and all(D is not None for D in sides):
            signs = {_sign(D) for D in sides if D is not UNDEFINED_HERE}
            return signs.pop() * half.turn if len(signs) == 1 else 0
    return None


def is_essential(half: Half, start: Side, stop: Side) -> bool:
    """Tell whether exp or a wave is taken, between two places, of what grows without bound there."""
    g = place_on_stretch(half, start, stop)
    return any(
        has_essential_part(part) and _Neighbourhood.of(half, part, g) is not None
        for part in vanishing_parts(half.tape)
    )


class _UnbrokenBalls(BallAlgebra):
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


class _SplitAlgebra:
    """The algebra of numbers with a continuous part at u = 0 and a part known by a power of |u|."""

    def __init__(self, intervals: "_DomainIntervals") -> None:
        self._intervals, self._balls = intervals, _UnbrokenBalls()

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

    def subtract(self, left: _Split, right: _Split) -> _Split:
        """Return left - right."""
        return self.add(left, self.negate(right))

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

    def general_power(self, base: _Split, exponent: _Split) -> _Split:
        """Return exp(exponent · log(base))."""
        return self.call("exp", self.multiply(exponent, self.call("log", base)))

    def call(self, name: str, argument: _Split) -> _Split:
        """Return the function: of what has a limit it has one, but for signs and logarithms of what is 0."""
        total = self.limit(argument)
        is_known = total is not None and name not in ("abs", "sign", "log")
        if argument.regular is None and argument.rest is not None and not is_known:
            return _Split(None, self._intervals.call(name, argument.rest))
        return _Split(arb.nan() if total is None else self._balls.call(name, total))


class _DomainIntervals(LongIntervalAlgebra):
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
class _Neighbourhood:
    """A box of g1, g2, g3 in which a part u of the formula vanishes at one g2."""

    curves: Curves
    part: VanishingPart
    g: list[arb]
    slope: arb
    """du/dg2, which has one sign."""
    size: arb
    """Bound of |u|."""

    @staticmethod
    def of(curves: Curves, part: VanishingPart, g: list[arb]) -> "_Neighbourhood | None":
        """Return the box, None if u does not vanish in it, or is not monotone."""
        jets = FirstOrderJets(BallAlgebra(), 1)
        seeds = [jets.seed(x, (rate,)) for x, rate in zip(g, (None, arb(1), None), strict=True)]
        u = part.part.evaluate(jets, seeds)
        slope = u.first[0]
        if slope is None or not (slope.is_finite() and (slope > 0 or slope < 0)):
            return None
        if not u.value.contains(0):
            return None
        return _Neighbourhood(curves, part, g, slope, u.value.abs_upper())

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
            intervals = _DomainIntervals(arb(0), self.size, log_power)
            algebra = _SplitAlgebra(intervals)
            u = LongInterval(arb(1), arb(1), Fraction(1))
            is_positive = (self.slope > 0) == (side > 0)
            # X u is not used: D is no derivative along the curve.
            beside = SecondScale(_Split(None, u if is_positive else intervals.negate(u)), _Split(None))
            g = [_Split(x) for x in self.g]
            (D,) = derivatives_along(algebra, self.part.whole, self.curves.body, g, 0, beside)
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
        algebra = _DomainIntervals(arb(0), self.size, log_power)
        A, C = (algebra.constant(moment) for moment in (self.curves.body.A, self.curves.body.C))
        g1, g2, g3 = (LongInterval(x.lower(), x.upper()) for x in self.g)
        Q = algebra.add(
            algebra.multiply(A, algebra.power(g1, Fraction(2))),
            algebra.multiply(C, algebra.power(g3, Fraction(2))),
        )
        slope = LongInterval(self.slope.lower(), self.slope.upper())
        is_positive = (self.slope > 0) == (side > 0)
        u = LongInterval(arb(1), arb(1), Fraction(1))
        beside = SecondScale(
            u if is_positive else algebra.negate(u), algebra.negate(algebra.multiply(slope, Q))
        )
        D, rate = derivatives_along(algebra, self.part.whole, self.curves.body, [g1, g2, g3], 1, beside)
        return D, rate, algebra.is_undefined


def _sign(D: arb | None) -> int:
    return 0 if D is None or D.contains(0) else 1 if D > 0 else -1


def _is_away(x: LongInterval) -> bool:
    """Tell whether the coefficient is away from 0."""
    return bool(x.lo <= x.hi and (x.lo > 0 or x.hi < 0))
