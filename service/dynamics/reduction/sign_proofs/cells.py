"""Classifies cells of half a loop: sign of P known, P monotone, or neither; by doubles, then by balls."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import inf, pi

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.formula.algebras.ball import BallAlgebra, ball
from service.dynamics.formula.algebras.intervals import Bounds, Interval, IntervalAlgebra
from service.dynamics.formula.algebras.long_intervals import LongInterval, LongIntervalAlgebra
from service.dynamics.formula.tape import Tape
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.geometry.point import RANGES, make_equator, place_of
from service.dynamics.reduction.geometry.slopes import SecondScale, derivatives_along, rates_along
from service.dynamics.reduction.geometry.tight_form import pole_forms, tight_form
from service.dynamics.reduction.root_finding.zeros import LoopPlace, Region, enclose_zero
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    QUARTER_TURN,
    Cells,
    Loops,
    Shape,
    axes,
    heights,
    scales,
)

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
FAINT_VALUE = 1e-300
"""Below it a double is next to 0, and smaller cells do not help."""
NEAR_POLE_DISTANCE = 0.3
"""Distance from a pole up to which formulas are tried as they are written next to it."""
LOG_POWER = Fraction(1, 16)
Side = tuple[float, float]
"""A place as the sign of g2 there, and the distance to the pole of this sign."""


class _DomainIntervals(IntervalAlgebra):
    """Intervals that remember where a root or a logarithm certainly has no value."""

    def __init__(self, scales: Sequence[Bounds]) -> None:
        super().__init__(scales)
        self.is_undefined: BoolArray = np.zeros((), dtype=np.bool_)

    def power(self, base: Interval, exponent: Fraction) -> Interval:
        """Return base^exponent."""
        if exponent.denominator > 1 and base.sign <= 0:
            self.is_undefined = self.is_undefined | (base.hi < 0.0)
        return super().power(base, exponent)

    def call(self, name: str, argument: Interval) -> Interval:
        """Return the function."""
        if name == "log" and argument.sign <= 0:
            self.is_undefined = self.is_undefined | (argument.hi < 0.0)
        return super().call(name, argument)


@dataclass(frozen=True)
class Curves:
    """Half loops of one potential, 0 < v < π on the side of one sign of g3, of single λ or stretches."""

    tape: Tape
    body: RigidBody
    """In the axes of the client."""
    loops: Loops
    turn: int
    """The sign of P / D."""


@dataclass(frozen=True)
class Half(Curves):
    """One half of one loop, with Z and G in doubles."""

    loop: Loop
    g3_sign: int
    """Sign of the primed g3."""

    @cached_property
    def pole_forms(self) -> dict[int, tuple[Tape, Tape]]:
        """Return the tape as it is next to each pole, g2 = 1 and −1."""
        return {sigma: pole_forms(self.tape, sigma) for sigma in (1, -1)}


@dataclass(frozen=True, slots=True)
class CellSigns:
    """The results for each cell, as arrays."""

    sign: IntArray
    """Sign that P certainly has all over the cell; 0 if it is not known."""
    slope: IntArray
    """Sign that dP/dv certainly has, but for a positive factor of P; 0 if it is not known."""
    is_undefined: BoolArray
    """P certainly has no value anywhere on it."""
    is_faint: BoolArray
    """The bounds are so small that doubles lose them."""


def half_of(loop: Loop, tape: Tape, g3_sign: int) -> Half:
    """Return the half of the loop where the primed g3 has this sign."""
    shape = Shape(loop.alpha, loop.mirrored, loop.g1_sign, g3_sign)
    A, C = (loop.C, loop.A) if loop.mirrored else (loop.A, loop.C)
    loops = Loops(shape, _bounds(loop.Z), _bounds(loop.G))
    is_turned = (loop.g1_sign * g3_sign < 0) != loop.mirrored
    return Half(
        tape=tight_form(tape),
        body=RigidBody(A, None, C, allow_unphysical=True),
        loops=loops,
        turn=-1 if is_turned else 1,
        loop=loop,
        g3_sign=g3_sign,
    )


def signs_on_cells(curves: Curves, cells: Cells, *, with_slope: bool) -> CellSigns:
    """Return what bounds say of the cells."""
    algebra = _DomainIntervals(scales(curves.loops, cells))
    g = _places(algebra, curves.loops, cells)
    with np.errstate(all="ignore"):
        D, *slopes = derivatives_along(algebra, curves.tape, curves.body, g, 1 if with_slope else 0)
    shape = cells.low.shape
    at_pole = cells.low == 0.0
    slope = _signs(slopes[0], shape, at_pole) * curves.turn if slopes else np.zeros(shape, dtype=np.int64)
    is_undefined = np.broadcast_to(algebra.is_undefined, shape)
    return CellSigns(_signs(D, shape, at_pole) * curves.turn, slope, is_undefined, _are_faint(D, shape))


def derivative_values(curves: Curves, cells: Cells, order: int) -> list[Bounds]:
    """Return bounds of D, X D, … up to this order on each cell, times the sign of P / D; NaN for none."""
    algebra = IntervalAlgebra(scales(curves.loops, cells))
    g = _places(algebra, curves.loops, cells)
    zero = algebra.constant(Fraction(0))
    with np.errstate(all="ignore"):
        found = derivatives_along(algebra, curves.tape, curves.body, g, order)
        values = [algebra.bounds(zero if each is None else each) for each in found]
    shape = cells.low.shape
    full = [(np.broadcast_to(lo, shape), np.broadcast_to(hi, shape)) for lo, hi in values]
    return full if curves.turn > 0 else [(-hi, -lo) for lo, hi in full]


def _places(algebra: IntervalAlgebra, loops: Loops, cells: Cells) -> tuple[Interval, Interval, Interval]:
    """Return g1, g2 and g3 on each cell, in the client's axes."""
    first, third = axes(algebra, loops, cells)
    g1, g3 = (third, first) if loops.shape.is_mirrored else (first, third)
    return g1, algebra.interval(*heights(loops, cells)), g3


def _signs(element: Interval | None, shape: tuple[int, ...], at_pole: BoolArray) -> IntArray:
    if element is None:
        return np.zeros(shape, dtype=np.int64)
    # Written so that NaN is no sign. What is not bounded may be infinite inside, where a sign says nothing of
    # zeros; at a pole it is known by its leading power.
    is_ordered = (element.lo <= element.hi) & (at_pole | (np.isfinite(element.lo) & np.isfinite(element.hi)))
    signs = ((element.lo > 0.0) & is_ordered).astype(np.int64) - ((element.hi < 0.0) & is_ordered)
    return np.broadcast_to(signs, shape)


def _are_faint(element: Interval | None, shape: tuple[int, ...]) -> BoolArray:
    if element is None:
        return np.zeros(shape, dtype=np.bool_)
    return np.broadcast_to((element.lo > -FAINT_VALUE) & (element.hi < FAINT_VALUE), shape)


def _bounds(ball: arb) -> Bounds:
    low, high = float(ball.lower()), float(ball.upper())
    # A ball's end is rounded to the nearest double.
    lower, upper = np.nextafter(low, -np.inf), np.nextafter(high, np.inf)
    return np.array([max(lower, 0.0)]), np.array([min(upper, 1.0)])


@dataclass(frozen=True, slots=True)
class Bound:
    """The first derivative of P along the curve that has one sign all over a stretch, P itself being the 0th.

    P has at most as many zeros there as its order says, each as often as its own order says.
    """

    order: int
    sign: int


def bound_on_cell(half: Half, hemisphere: float, low: float, high: float) -> Bound | None:
    """Return what is known of P, or of its slope, on a cell, which may begin at the pole; None if nothing."""
    for log_power in (Fraction(0), LOG_POWER) if low == 0.0 else (Fraction(0),):
        algebra, g = _long(half, hemisphere, low, high, log_power)
        forms: list[tuple[Tape, list[SecondScale[LongInterval]]]] = [(half.tape, [])]
        if high < NEAR_POLE_DISTANCE:
            sigma = 1 if hemisphere > 0 else -1
            _, rate, _ = rates_along(algebra, half.body, g)
            drop = SecondScale(_drop(algebra, g), algebra.negate(rate) if sigma > 0 else rate)
            forms.extend((form, [drop]) for form in half.pole_forms[sigma])
        for order in (0,) if low == 0.0 else (0, 1):
            for tape, beside in forms:
                found = derivatives_along(algebra, tape, half.body, g, order, beside)[order]
                # What is not bounded may be infinite inside; at the pole it is known by its leading power.
                if found is not None and found.sign and (low == 0.0 or found.is_bounded):
                    return Bound(order, found.sign * half.turn)
    return None


def _drop(algebra: LongIntervalAlgebra, g: list[LongInterval]) -> LongInterval:
    """Return 1 − |g2| = (g1² + g3²) / (1 + |g2|)."""
    g1, g2, g3 = g
    two = Fraction(2)
    square = algebra.add(algebra.power(g1, two), algebra.power(g3, two))
    return algebra.divide(square, algebra.add(algebra.constant(Fraction(1)), algebra.call("abs", g2)))


def is_negative_where_defined(half: Half, start: Side, stop: Side) -> bool:
    """Tell whether P < 0 wherever it has a value between two places."""
    if start[0] != stop[0]:
        return all(
            is_negative_where_defined(half, (side, x), (side, QUARTER_TURN)) for side, x in (start, stop)
        )
    low, high = sorted((start[1], stop[1]))
    algebra, g = _long(half, start[0], low, high, Fraction(0), skips_undefined=True)
    (D,) = derivatives_along(algebra, half.tape, half.body, g, 0)
    return D is not None and D.sign * half.turn < 0


def bound_on_stretch(half: Half, start: Side, stop: Side) -> Bound | None:
    """Return what is known of P between two places, the first at the smaller v; None for nothing."""
    found = derivatives_along(BallAlgebra(), half.tape, half.body, place_on_stretch(half, start, stop), 2)
    for order, derivative in enumerate(found):
        if _sign(derivative):
            return Bound(order, _sign(derivative) * half.turn)
    return None


@dataclass(frozen=True, slots=True)
class Turn:
    """The behaviour of the slope of P on a stretch where the second derivative has one sign."""

    slope: int
    """Its sign all over the stretch, 0 if P turns on it, at one place."""
    place: LoopPlace | None = None
    """The place at which P turns, with the sign of P; P counts as 0 there if its sign is not known."""


def turn_on_stretch(half: Half, start: Side, stop: Side) -> Turn | None:
    """Return where P turns between two places if its second derivative has one sign there, else None."""
    region, ends = region_of_stretch(start, stop)

    def derivative(x: arb, order: int) -> arb:
        found = derivatives_along(BallAlgebra(), half.tape, half.body, place_at(half, region, x), order)[
            order
        ]
        return arb(0) if found is None else found

    slopes = [_sign(derivative(x, 1)) * half.turn for x in ends]
    if 0 in slopes:
        return None
    if slopes[0] == slopes[1]:
        return Turn(slopes[0])
    x = enclose_zero(lambda at: derivative(at, 1), *ends)
    if _sign(derivative(x.lower(), 1)) * _sign(derivative(x.upper(), 1)) >= 0:
        return None
    P = derivative(x, 0) * half.turn
    if not P.is_finite():
        return None
    return Turn(0, LoopPlace(region, x.mid(), sign=_sign(P)) if _sign(P) else LoopPlace(region, x.mid(), inf))


def width_of(start: Side, stop: Side) -> float:
    """Return the width of a stretch against its distance to the nearer pole."""
    if start[0] == stop[0]:
        return abs(stop[1] - start[1]) / max(min(start[1], stop[1]), 1e-300)
    return pi - start[1] - stop[1]


def region_of_stretch(start: Side, stop: Side) -> tuple[Region, list[arb]]:
    """Return the region that a stretch lies in, and the coordinates of its ends there."""
    region: Region = "middle" if start[0] != stop[0] else "north" if start[0] > 0 else "south"
    ends = [arb.pi() - arb(x) if region == "middle" and side < 0 else arb(x) for side, x in (start, stop)]
    return region, ends


def place_at(half: Half, region: Region, x: arb) -> list[arb]:
    """Return g1, g2 and g3 at a place, in the client's axes."""
    sine, cosine = x.sin_cos()
    cosine = -cosine if region == "south" else cosine
    g1, g3, c = _place(half, sine, cosine)
    return [g3, cosine * c, g1] if half.loop.mirrored else [g1, cosine * c, g3]


def _long(
    half: Half,
    hemisphere: float,
    low: float,
    high: float,
    log_power: Fraction,
    *,
    skips_undefined: bool = False,
) -> tuple[LongIntervalAlgebra, list[LongInterval]]:
    """Return an algebra with s = sin v as its scale, and g1, g2, g3 on the cell, in the client's axes."""
    loop = half.loop
    start, end = (abs(_corner(half, hemisphere, x)[1]) for x in (low, high))
    sines = arb(low).sin(), arb(1) if high >= QUARTER_TURN else arb(high).sin()
    algebra = LongIntervalAlgebra(
        sines[0].lower(), sines[1].upper(), log_power, skips_undefined=skips_undefined
    )
    g1 = LongInterval(loop.G.lower(), loop.G.upper(), loop.alpha, 1)
    g3 = LongInterval(loop.Z.lower(), loop.Z.upper(), Fraction(1), 1)
    g2 = LongInterval(end.lower(), start.upper())
    g1, g2, g3 = (
        each if sign > 0 else algebra.negate(each)
        for each, sign in ((g1, loop.g1_sign), (g2, hemisphere), (g3, half.g3_sign))
    )
    return algebra, [g3, g2, g1] if loop.mirrored else [g1, g2, g3]


def height_at(half: Half, side: Side) -> float:
    """Return g2 at a place."""
    return float(_corner(half, *side)[1])


def place_on_stretch(half: Half, start: Side, stop: Side) -> list[arb]:
    """Return balls of g1, g2 and g3 between two places, in the client's axes."""
    if start[0] == stop[0]:
        return _around(half, start[0], *sorted((start[1], stop[1])))
    north, south = (_around(half, side, x, QUARTER_TURN) for side, x in (start, stop))
    return [one.union(other) for one, other in zip(north, south, strict=True)]


def _around(half: Half, hemisphere: float, low: float, high: float) -> list[arb]:
    """Return balls of g1, g2 and g3 on the cell, in the client's axes: each is monotone in v there."""
    start, end = _corner(half, hemisphere, low), _corner(half, hemisphere, high)
    first, second, third = (one.union(other) for one, other in zip(start, end, strict=True))
    return [third, second, first] if half.loop.mirrored else [first, second, third]


def _corner(half: Half, hemisphere: float, x: float) -> tuple[arb, arb, arb]:
    """Return the primed g1, g2 and g3 at a distance x from a pole."""
    loop = half.loop
    if x >= QUARTER_TURN:
        return loop.G * loop.g1_sign, arb(0), loop.Z * half.g3_sign
    if x == 0.0:
        return arb(0), arb(int(hemisphere)), arb(0)
    sine, cosine = arb(x).sin_cos()
    g1, g3, c = _place(half, sine, cosine)
    return g1, cosine * c * int(hemisphere), g3


def _place(half: Half, sine: arb, cosine: arb) -> tuple[arb, arb, arb]:
    """Return the primed g1 and g3, and c = g2 / cos v; cos v may be 0."""
    loop = half.loop
    first, _, third, c = place_of(RANGES, sine, cosine, make_equator(loop.Z, loop.G, ball(loop.alpha)))
    return first * loop.g1_sign, third * half.g3_sign, c


def _sign(value: arb | None) -> int:
    if value is None or not value.is_finite():
        return 0
    return 1 if value > 0 else -1 if value < 0 else 0
