"""Finds the order of a zero of the radicand: the power of the distance that P behaves like."""

from collections.abc import Callable
from math import inf, isfinite
from typing import Literal

from flint import arb, ctx

Order = Literal["power", "fractional", "none"]
"""P is like the second to HIGHEST_ORDER-th power of the distance; like one between the first and the second;
like none of these."""

HIGHEST_ORDER = 16
DISTANCES = (8, 12, 16, 20, 24)
"""-log2 of the distances, relative to the place, at which the growth of P is measured."""
WHOLE = 0.02
"""An exponent closer than this to a whole number, at two neighbouring distances, is that number."""
STEADY = 0.002
"""A fractional exponent is the same to this at two neighbouring distances."""
SECTIONS = 80
"""Golden sections of a bracket at least: 2^-55 of it is left, where |x| is that small itself."""
SHALLOW = 1e-6
"""Share of where it began that a minimum must fall below then to be a zero: |x|^(1/2) comes to 1e-8."""


def order_of_zero(function: Callable[[arb], arb], x: arb) -> Order:
    """Tell whether ``function`` grows about its zero ``x`` like a whole power of the distance from it.

    The exponent is measured at distances that shrink until it settles: another zero, or
    the function's own curvature, may be seen from afar. Where it never settles, as about
    the zero of exp(-1/x²), whose exponent grows without bound, or settles below 1, as
    about that of |x|^(1/2), the answer is ``none``.
    """
    x, before = x.mid(), inf
    for bits in DISTANCES:
        exponent = exponent_at(function, x, abs(x) * arb(2) ** -bits)
        nearest = round(exponent) if isfinite(exponent) else 0
        settled = abs(exponent - nearest) <= WHOLE and abs(before - nearest) <= WHOLE
        if settled and 2 <= nearest <= HIGHEST_ORDER:
            return "power"
        if abs(exponent - before) <= STEADY and 1.0 + WHOLE < exponent < 2.0 - WHOLE:
            return "fractional"
        before = exponent
    return "none"


def exponent_at(function: Callable[[arb], arb], x: arb, distance: arb) -> float:
    """Return the exponent of |function| between ``distance`` and twice that, the mean of both sides."""
    near, far = (
        abs(function((x - step).mid()) * function((x + step).mid())).mid()
        for step in (distance, 2 * distance)
    )
    if not (near > 0 and far > 0):
        return inf
    return float((far / near).log() / arb(4).log())


def lowest_place(function: Callable[[arb], arb], left: arb, right: arb, nothing: arb) -> arb:
    """Return where |function| is least between two places, by golden section, or where it has no value.

    It ends where |function| is at most ``nothing``, or plainly comes to no zero.
    """
    ratio = (arb(5).sqrt() - 1) / 2
    a, b = left.mid(), right.mid()
    x, y = (b - ratio * (b - a)).mid(), (a + ratio * (b - a)).mid()
    at_x, at_y = abs(function(x)).mid(), abs(function(y)).mid()
    begin, far_below = at_x.max(at_y), nothing**4
    for section in range(2 * ctx.prec):
        if not (at_x.is_finite() and at_y.is_finite()):
            return y if at_x.is_finite() else x
        lowest = at_x.min(at_y)
        # So little is near enough to a zero of any order, and may take thousands of bits to go on from.
        is_far_below = lowest < far_below
        if is_far_below or (section >= SECTIONS and (lowest <= nothing or lowest > SHALLOW * begin)):
            break
        if at_x < at_y:
            b, y, at_y = y, x, at_x
            x = (b - ratio * (b - a)).mid()
            at_x = abs(function(x)).mid()
        else:
            a, x, at_x = x, y, at_y
            y = (a + ratio * (b - a)).mid()
            at_y = abs(function(y)).mid()
    return x if at_x < at_y else y
