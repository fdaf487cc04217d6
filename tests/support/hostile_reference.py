"""Windows of motions with known features, in balls, without any code of the service.

The zeros of p² are isolated by subdivision of the half loop 0 < v < π: a cell has
p² of one sign, or dp²/dv of one sign, or is halved. Cells end at the places of the
features and at multiples of their widths, so that a feature is never inside a cell
much wider than it without being noticed: the enclosure of such a cell contains all
its values.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

from flint import arb

from tests.support.hostile_curve import Curve, root_between
from tests.support.hostile_features import Feature, exact
from tests.support.jets import Jet, Value, cos

SPREAD = (0, 1, 3, 10, 40)
"""Multiples of the width at which cells end."""
MOST_CELLS = 20_000

End = Literal["rest", "passed", "approached", "collision", "flat", "infinite"]


class UnknownError(Exception):
    """The reference does not know: two zeros too near each other, or too much work."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """A maximal interval of v in (0, π) with p² > 0."""

    lower: arb
    upper: arb
    lower_end: str
    upper_end: str

    @property
    def crosses_equator(self) -> bool:
        half = arb.pi() / 2
        return bool(self.lower < half and self.upper > half)


@dataclass(frozen=True, slots=True)
class Cuts:
    """Where features are, as v."""

    places: tuple[arb, ...]
    kinks: tuple[arb, ...]
    holes: tuple[tuple[arb, arb], ...]
    """Where exp(−1/t²) is less than 1e-43."""
    infinities: tuple[arb, ...] = ()


def cuts_of(curve: Curve, features: Sequence[Feature]) -> Cuts:
    places, kinks, holes, infinities = [], [], [], []
    for feature in features:
        for place, width in zip(feature.places(), feature.widths(), strict=True):
            at = place_of(curve, place)
            (infinities if feature.shape == "infinite" else kinks if feature.is_kinked else places).append(at)
            for k in (sign * k for k in SPREAD[1:] for sign in (1, -1)):
                if abs(place + k * width) < 1 - width / 100:
                    places.append(place_of(curve, place + k * width))
            if feature.shape == "hole":
                holes.append((place_of(curve, place + width / 10), place_of(curve, place - width / 10)))
    return Cuts(tuple(places), tuple(kinks), tuple(holes), tuple(infinities))


def place_of(curve: Curve, y: arb) -> arb:
    """Return v with g2(v) = y; g2 falls from 1 at v = 0 to −1 at π."""
    if not abs(y) < 1:
        raise UnknownError("a place beyond the poles")
    return root_between(lambda v: curve.g2(v) - y, arb(2) ** -100, arb(3.141592653589793))


def sides_at(curve: Curve, features: Sequence[Feature], v: arb) -> tuple[int, ...]:
    """Return on which side of the place of each feature the point is; 0 where it is not certain."""
    y = curve.g2(v)
    sides = []
    for feature in features:
        away = (y if feature.argument == "g2" else 1 - y * y) - exact(feature.place)
        sides.append(1 if away > 0 else -1 if away < 0 else 0)
    return tuple(sides)


def stretches_of(curve: Curve, features: Sequence[Feature], cuts: Cuts) -> list[Stretch]:
    """Return the stretches of the half loop on which there are motions, in the order of v."""
    scan = _Scan(curve, features)
    for low, high in _cells(cuts):
        infinite = [at for at in cuts.infinities if low >= at.lower() and high <= at.upper()]
        if infinite:
            scan.break_at(infinite[0])
        else:
            scan.isolate(low, high)
    if not scan.signs or len(scan.signs) != len(scan.breaks) + 1:
        raise UnknownError("no sign at a pole")
    ends = [(arb(0), curve.at_pole), *scan.breaks, (arb.pi(), curve.at_pole)]
    return [
        Stretch(lower, upper, lower_end, upper_end)
        for ((lower, lower_end), (upper, upper_end)), sign in zip(
            itertools.pairwise(ends), scan.signs, strict=True
        )
        if sign > 0
    ]


def _cells(cuts: Cuts) -> list[tuple[arb, arb]]:
    """Return cells with exact ends that cover [0, π]; a kink has a tiny one of its own."""
    ends = [arb(0), arb(arb.pi().upper())]
    for ball in (*cuts.places, *(end for hole in cuts.holes for end in hole)):
        ends.append(arb(ball.mid()))
    for ball in (*cuts.kinks, *cuts.infinities):
        ends += [arb(ball.lower()), arb(ball.upper())]
    ends.sort(key=_Exact)
    return [(a, b) for a, b in itertools.pairwise(ends) if a < b]


@dataclass(frozen=True, slots=True)
class _Exact:
    """An exact ball that can be sorted."""

    value: arb

    def __lt__(self, other: "_Exact") -> bool:
        return bool(self.value < other.value)


class _Scan:
    """Zeros and signs, cell by cell from the left."""

    def __init__(self, curve: Curve, features: Sequence[Feature]) -> None:
        self.curve, self.features = curve, features
        self.breaks: list[tuple[arb, End]] = []
        """Zeros and places where p² is infinite."""
        self.signs: list[int] = []
        """Before, between and behind them."""
        self._cells = 0

    def break_at(self, at: arb) -> None:
        """Go on behind a place where p² is infinite."""
        self.breaks.append((at, "infinite"))

    def isolate(self, first: arb, last: arb) -> None:
        sides = sides_at(self.curve, self.features, arb(((first + last) / 2).mid()))
        waiting = [(first, last)]
        while waiting:
            low, high = waiting.pop()
            self._cells += 1
            if self._cells > MOST_CELLS:
                raise UnknownError("too many cells")
            sign = self._sign(self._value(low.union(high), low, high, sides))
            if sign:
                self._note(sign)
                continue
            if self._is_monotone(low, high, sides):
                self._enclose(low, high, sides)
                continue
            middle = arb(((low + high) / 2).mid())
            if not (low < middle and middle < high) or high - low < arb(2) ** -140:
                raise UnknownError("a zero that is not simple, or at a kink")
            waiting += [(middle, high), (low, middle)]

    def _note(self, sign: int) -> None:
        if len(self.signs) == len(self.breaks):
            self.signs.append(sign)
        if self.signs[-1] != sign:
            raise UnknownError("a sign change between cells")

    def _enclose(self, low: arb, high: arb, sides: tuple[int, ...]) -> None:
        before = self._sign(self._value(low, low, low, sides))
        after = self._sign(self._value(high, high, high, sides))
        if not before or not after:
            raise UnknownError("a zero at the end of a cell")
        self._note(before)
        if before != after:
            self.breaks.append((root_between(partial(self._at, sides), low, high), "rest"))
            self.signs.append(after)

    def _at(self, sides: tuple[int, ...], v: arb) -> arb:
        return self._value(v, v, v, sides)

    def _is_monotone(self, low: arb, high: arb, sides: tuple[int, ...]) -> bool:
        if not (low > 0 and high < arb.pi()) or 0 in sides:
            return False
        jet = Jet(low.union(high), arb(1))
        tau = self.curve.tau(jet)
        slope = self.curve.sign_function(tau, self.curve.c_of(tau) * cos(jet), sides).slope
        return bool(slope > 0 or slope < 0)

    def _value(self, v: arb, low: arb, high: arb, sides: tuple[int, ...]) -> arb:
        tau = self._tau(v, low, high)
        return self.curve.sign_function(tau, self.curve.c_of(tau) * v.cos(), sides)

    def _tau(self, v: arb, low: arb, high: arb) -> arb:
        if low > 0 and high < arb.pi():
            return self.curve.tau(v)
        # The sine of a ball about a pole may be negative, by rounding; it grows up to the equator.
        inner = high if not low > 0 else low
        is_near = inner < arb.pi() / 2 if not low > 0 else inner > arb.pi() / 2
        return (self.curve.tau(inner) if is_near else arb(1)).union(arb(0))

    @staticmethod
    def _sign(value: Value) -> int:
        return 1 if value > 0 else -1 if value < 0 else 0
