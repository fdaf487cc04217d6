"""Boxes of unknown numbers on which windows stay: N has as many zeros along the curve, all of them simple.

A curve is cut until on each part, for all numbers of a box, N has one sign or its slope has. Windows then
neither appear nor vanish nor merge in the box, and those at its middle are all that there are. At the poles
V may grow without bound: there N is bounded by intervals, whose powers of sin v are exact.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from math import prod

import numpy as np
from flint import acb, arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.ball import ball
from service.dynamics.formula.algebras.intervals import Interval, IntervalAlgebra, outwards
from workers.solvers.errors import PrecisionNeededError
from workers.solvers.searches.family import ALGEBRA, FamilyCurve, ProblemFamily

FloatArray = NDArray[np.float64]
Box = tuple[tuple[Fraction, Fraction], ...]
"""The two ends of each unknown."""

CELLS, MOST_CELLS = (16, 64), 2048
"""Parts of half a turn at first, of which the second are tried where the first do not do, and at most."""
DEEPEST = {1: 18, 2: 10}
"""Number of times that a box of one or two unknowns is cut to find where its windows stay."""
_ONE = Fraction(1)


def share_of(box: Box, whole: Box) -> float:
    """Return the volume of a box in parts of the whole."""
    sides = ((high - low) / (top - bottom) for (low, high), (bottom, top) in zip(box, whole, strict=True))
    return float(prod(sides))


def halves(box: Box, whole: Box) -> list[Box]:
    """Cut a box across its longest side, of the shares of the whole."""
    shares = [(high - low) / (top - bottom) for (low, high), (bottom, top) in zip(box, whole, strict=True)]
    k = shares.index(max(shares))
    low, high = box[k]
    middle = (low + high) / 2
    return [(*box[:k], ends, *box[k + 1 :]) for ends in ((middle, high), (low, middle))]


def stretches(family: ProblemFamily, whole: Box, is_late: Callable[[], bool]) -> tuple[list[Box], list[Box]]:
    """Return boxes on each of which the windows stay, and those for which that is not proved, in order.

    Boxes of one unknown that touch are one.
    """
    kept, open_ = list[Box](), list[Box]()
    waiting = [(whole, DEEPEST[len(whole)])]
    while waiting:
        box, cuts = waiting.pop()
        if not is_late() and windows_stay(family, box):
            kept.append(box)
        elif is_late() or not cuts:
            open_.append(box)
        else:
            waiting += [(half, cuts - 1) for half in halves(box, whole)]
    return joined(kept), joined(open_)


def joined(boxes: Sequence[Box]) -> list[Box]:
    """Join intervals that touch; boxes of two unknowns stay as they are."""
    found: list[Box] = []
    for box in sorted(set(boxes)):
        if found and len(box) == 1 and box[0][0] <= found[-1][0][1]:
            found[-1] = ((found[-1][0][0], max(found[-1][0][1], box[0][1])),)
        else:
            found.append(box)
    return found


def windows_stay(family: ProblemFamily, box: Box) -> bool:
    """Whether it is proved that all numbers of a box have as many windows, and simple zeros at their ends."""
    numbers = [acb(ball(low).union(ball(high))) for low, high in box]
    try:
        curves = [FamilyCurve(family, numbers, side) for side in (1, -1)]
        return all(any(_has_simple_zeros(curve, cells) for cells in CELLS) for curve in curves)
    except PrecisionNeededError:
        return False


def is_analytic_at_poles(family: ProblemFamily, box: Box) -> bool:
    """Whether it is proved that V is analytic about both poles, for all numbers of a box."""
    numbers = [ball(low).union(ball(high)) for low, high in box]
    near = (arb.pi() / CELLS[0]).sin().upper()
    beside = acb(arb(0, near))
    for pole in (1, -1):
        height = acb(pole * (1 - 2 * near * near).union(arb(1)))
        parameters = [acb(numbers[k]) for k in family.extra]
        if not family.tape.evaluate(ALGEBRA, (beside, height, beside, *parameters)).is_finite():
            return False
    return True


def _has_simple_zeros(curve: FamilyCurve, cells: int) -> bool:
    slope = 0  # of N since it last had a sign
    waiting = [(k, cells) for k in reversed(range(cells))]
    while waiting:
        k, of = waiting.pop()
        is_at_pole = k in (0, of - 1)
        ends = [curve.side * arb.pi() * end / of for end in (k, k + 1)]
        v = acb(ends[0].union(ends[1]))
        sign = _sign_at_pole(curve, of, is_north=k == 0) if is_at_pole else _sign(curve.N(v).real)
        rise = 0
        if not sign and not is_at_pole:
            slope_on = curve.slope(v)
            rise = _sign(slope_on.real)
            # Where N rises and falls, its mean value form is far narrower.
            sign = 0 if rise else _sign((curve.N(v.mid()) + slope_on * (v - v.mid())).real)
        if sign:
            slope = 0
        elif rise:
            # Between a rise and a fall N has a sign, or it may touch 0.
            if rise == -slope and not _sign(curve.N(acb(ends[0])).real):
                return False
            slope = rise
        elif of >= MOST_CELLS:
            return False
        else:
            waiting += [(2 * k + 1, 2 * of), (2 * k, 2 * of)]
    return True


def _sign(value: arb) -> int:
    return 1 if value > 0 else -1 if value < 0 else 0


def _sign_at_pole(curve: FamilyCurve, of: int, *, is_north: bool) -> int:
    """Return the sign of N from a pole to the ``of``-th part of half a turn beyond; 0 if it is not known."""
    exponent = curve.exact_alpha
    if exponent is None:
        return 0
    with np.errstate(all="ignore"):
        largest = _doubles((arb.pi() / of).sin())[1]
        algebra = IntervalAlgebra([(np.zeros(()), largest)])

        def interval(value: arb, power: Fraction = Fraction(0)) -> Interval:
            return algebra.interval(*_doubles(value), (power,))

        first = interval(curve.family.g1_sign * curve.G.real, exponent)
        third = interval(curve.side * curve.Z.real, _ONE)
        squares = algebra.add(algebra.multiply(first, first), algebra.multiply(third, third))
        second = algebra.power(algebra.subtract(algebra.constant(_ONE), squares), Fraction(1, 2))
        gamma = [first, second if is_north else algebra.negate(second), third]
        inputs = [interval(number.real) for number in curve.parameters]
        V = curve.family.tape.evaluate(algebra, [*(gamma[::-1] if curve.family.mirrored else gamma), *inputs])
        lo, hi = map(float, algebra.bounds(V))
    least, most = map(float, _doubles(curve.h.real))
    return 1 if hi < least else -1 if lo > most else 0


def _doubles(value: arb) -> tuple[FloatArray, FloatArray]:
    """Return doubles below and above a ball."""
    # An end becomes the nearest double.
    return outwards(np.array(float(value.lower())), np.array(float(value.upper())))
