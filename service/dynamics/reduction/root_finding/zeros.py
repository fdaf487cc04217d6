"""Encloses in balls the zeros of the radicand between places where its sign is known.

The order of a zero is the power of the distance that P behaves like.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import inf, isfinite
from typing import Literal

from flint import arb, ctx

Order = Literal["power", "fractional", "none"]
"""P is like the second to MAX_ORDER-th power of the distance; like one between the first and the second, or,
where it touches 0, below the second; like none of these."""

MAX_ORDER = 16
GROWTH_LOG2_DISTANCES = (8, 12, 16, 20, 24)
"""-log2 of the distances, relative to the place, at which the growth of P is measured."""
WHOLE_EXPONENT_DISTANCE = 0.02
MIN_FRACTIONAL_EXPONENT = 1.0 + WHOLE_EXPONENT_DISTANCE
"""An exponent closer than this to a whole number, at two neighbouring distances, is that number."""
STEADY_EXPONENT_CHANGE = 0.002
"""A fractional exponent is the same to this at two neighbouring distances."""
GOLDEN_SECTIONS = 80
"""Golden sections of a bracket at least: 2^-55 of it is left, where |x| is that small itself."""
MINIMUM_SHARE = 1e-6
"""Share of where it began that a minimum must fall below then to be a zero: |x|^(1/2) comes to 1e-8."""


def order_of_zero(function: Callable[[arb], arb], x: arb, least: float = MIN_FRACTIONAL_EXPONENT) -> Order:
    """Tell whether ``function`` grows about its zero ``x`` like a whole power of the distance from it.

    ``least`` is the least exponent that is told as ``fractional``, if it is below the second power.

    The exponent is measured at distances that shrink until it settles: another zero, or
    the function's own curvature, may be seen from afar. Where it never settles, as about
    the zero of exp(-1/x²), whose exponent grows without bound, or settles below ``least``, the
    answer is ``none``.
    """
    x, before = x.mid(), inf
    for bits in GROWTH_LOG2_DISTANCES:
        exponent = exponent_at(function, x, abs(x) * arb(2) ** -bits)
        nearest = round(exponent) if isfinite(exponent) else 0
        settled = (
            abs(exponent - nearest) <= WHOLE_EXPONENT_DISTANCE
            and abs(before - nearest) <= WHOLE_EXPONENT_DISTANCE
        )
        if settled and 2 <= nearest <= MAX_ORDER:
            return "power"
        if (
            abs(exponent - before) <= STEADY_EXPONENT_CHANGE
            and least < exponent < 2.0 - WHOLE_EXPONENT_DISTANCE
        ):
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
        if is_far_below or (
            section >= GOLDEN_SECTIONS and (lowest <= nothing or lowest > MINIMUM_SHARE * begin)
        ):
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


Region = Literal["north", "middle", "south"]
"""Near a pole the coordinate x is the distance to it; in the middle it is v."""
PoleKind = Literal["passable", "blocked", "collision", "asymptotic", "flat"]


@dataclass(frozen=True, slots=True)
class LoopPlace:
    """A point 0 < v < π: x in its region, with the sign of g3 of the half."""

    region: Region
    x: arb
    nothing: arb | float = 0.0
    """Values of P up to this size count as zero here: set at critical points. It may be below any double."""
    sign: int | None = None
    """The sign of P where doubles leave no doubt of it."""
    is_infinite: bool = False
    """P is proved to grow without bound here, where it has a value, and ``x`` encloses the place."""

    def v(self) -> arb:
        """Return the loop coordinate, 0 < v < π."""
        return arb.pi() - self.x if self.region == "south" else self.x


BRACKET_BITS = 200
"""A bracket about a zero of high order is halved to 2^-200 of where it is: enough for what comes near."""
MAX_HALVINGS = 4000
SIGN_RELATIVE_BITS = 32
"""Relative accuracy at which a value and its sign are believed."""
POLE_LOG2_DISTANCES = (-1408, -704, -352)
"""log2 of the distances to a pole that determine the behaviour of P there: terms of V whose coefficients
differ by 1e600 may change places at 2^-1000. A formula that cancels next to the pole needs more
bits at the nearest than there are: then the others serve."""

MIN_ZERO_POWER = 0.01
"""Power of the distance that a zero without an order is at least seen to be like."""
MAX_POLE_POWER = 2000.0
"""Largest power of the distance to a pole that P is taken to be like."""

Radicand = Callable[[LoopPlace], arb]
"""P as a function of the place."""


ZeroKind = Literal["simple", "multiple", "standstill", "flat", "edge", "infinite"]
"""A zero of order one; of order two or more: an equilibrium or separatrix; of an order between these; of no
order that is known; the edge of where P is defined; no zero of P but one of 1/P, which P > 0 comes to on one
side at least."""
_KIND_OF: dict[Order, ZeroKind] = {"power": "multiple", "fractional": "standstill", "none": "flat"}


@dataclass(frozen=True, slots=True)
class Zero:
    """A place v (a ball that contains it) where P ceases to be positive, touches zero, or is infinite."""

    v: arb
    kind: ZeroKind


def zeros_between(cuts: list[LoopPlace], radicand: Radicand) -> tuple[list[Zero], list[int]]:
    """Return the zeros between the cuts, and the signs around them.

    Between neighbouring cuts P is monotone, so a change of sign is exactly one
    zero. A cut at which P vanishes is itself a zero, and one at which it is infinite
    a change from one branch of P to another. Where P is not defined
    there is no motion: the sign is negative, and a positive stretch ends at an edge.
    """
    zeros, signs = list[Zero](), list[int]()
    for infinite, branch in _branches(cuts):
        found, of_branch = _zeros_of_branch(branch, radicand)
        if infinite is None or 1 in (signs[-1], of_branch[0]):
            zeros.extend([] if infinite is None else [Zero(infinite.v(), "infinite")])
            signs.extend(of_branch)
        else:
            signs.extend(of_branch[1:])
        zeros.extend(found)
    return zeros, signs


def _branches(cuts: list[LoopPlace]) -> Iterator[tuple[LoopPlace | None, list[LoopPlace]]]:
    """Yield the stretches of cuts between places where P is infinite, each after such a place."""
    infinite: LoopPlace | None = None
    branch: list[LoopPlace] = []
    for place in cuts:
        if place.is_infinite:
            yield infinite, branch
            infinite, branch = place, []
        else:
            branch.append(place)
    yield infinite, branch


def _zeros_of_branch(cuts: list[LoopPlace], radicand: Radicand) -> tuple[list[Zero], list[int]]:
    zeros: list[Zero] = []
    signs: list[int] = []
    last: LoopPlace | None = None  # the cut before, unless P vanished there
    last_is_defined = True
    touched: LoopPlace | None = None
    for place, found in _with_edges(cuts, radicand):
        if found == 0:
            touched = touched or place
            continue
        sign, is_defined = found or -1, found is not None
        if last is None:
            signs.append(sign)
        elif not (is_defined and last_is_defined):
            if sign != signs[-1]:
                zeros.append(Zero((place if is_defined else last).v(), "edge"))
                signs.append(sign)
        elif touched is not None:
            crosses = sign != signs[-1]
            zeros.append(_crossing(radicand, last, place) if crosses else _touch(radicand, touched))
            signs.append(sign)
        elif sign != signs[-1]:
            zeros.append(_crossing(radicand, last, place))
            signs.append(sign)
        last, last_is_defined, touched = place, is_defined, None
    return zeros, signs or [-1]


def _with_edges(cuts: list[LoopPlace], radicand: Radicand) -> list[tuple[LoopPlace, int | None]]:
    """Return the cuts with their signs, and between one with a value and one without the edge itself."""
    signed: list[tuple[LoopPlace, int | None]] = []
    for place in cuts:
        sign = place.sign if place.sign is not None else _sign(radicand(place), place.nothing)
        if signed and (sign is None) != (signed[-1][1] is None):
            edge = _edge(radicand, signed[-1][0], place)
            signed.append((edge, _sign(radicand(edge), 0.0)))
        signed.append((place, sign))
    return signed


def _edge(radicand: Radicand, left: LoopPlace, right: LoopPlace) -> LoopPlace:
    """Return the last place with a value between one that has a value and one that has none."""
    if left.region != right.region:
        left, right = _common_region(left, right)

    def is_defined(x: arb) -> bool:
        return bool(radicand(LoopPlace(left.region, x)).is_finite())

    a, b = left.x.mid(), right.x.mid()
    defined, undefined = (a, b) if is_defined(a) else (b, a)
    for _ in range(ctx.prec):
        middle = ((defined + undefined) / 2).mid()
        if middle in (defined, undefined):
            break
        defined, undefined = (middle, undefined) if is_defined(middle) else (defined, middle)
    return LoopPlace(left.region, defined)


def is_known(value: arb) -> bool:
    """Tell whether a value of P is known well enough."""
    return bool(value.is_finite() and value.rel_accuracy_bits() >= SIGN_RELATIVE_BITS)


def _sign(value: arb, nothing: arb | float) -> int | None:
    """Return the certain sign of a value, 0 if it is as good as zero, None if undefined."""
    if not value.is_finite():
        return None
    if abs(value).upper() <= nothing:
        return 0
    return 1 if value > 0 else -1 if value < 0 else 0


def _crossing(radicand: Radicand, left: LoopPlace, right: LoopPlace) -> Zero:
    """Enclose the one zero between two places of opposite sign."""
    if left.region != right.region:
        left, right = _common_region(left, right)

    def function(x: arb) -> arb:
        return radicand(LoopPlace(left.region, x))

    root = LoopPlace(left.region, enclose_zero(function, left.x, right.x))
    # Two simple zeros that are close look like a double one from afar, one beside an infinity like none.
    if any(
        _is_simple(radicand, root, exponent) for exponent in (-60, -3 * ctx.prec // 8, -3 * ctx.prec // 4)
    ):
        return Zero(root.v(), "simple")
    # Where P is flat, or has orders of magnitude to pass, its values say little of where its zero is, and
    # its signs all.
    root = LoopPlace(left.region, _by_signs(function, left.x, right.x))
    return Zero(root.v(), "simple") if _is_simple(radicand, root) else _of_order(radicand, root)


def _touch(radicand: Radicand, place: LoopPlace) -> Zero:
    """Return the zero at a place where P touches 0.

    With P > 0 on both sides a motion has two ways to go on also where P is like |x|, or a root of it.
    """
    zero = _of_order(radicand, place, MIN_ZERO_POWER)
    if zero.kind != "flat":
        return zero
    # The place may be too far from a zero of high order for its order to be seen.
    x = place.x.mid()
    reach = abs(x) * arb(2) ** -8
    better = lowest_place(lambda at: radicand(LoopPlace(place.region, at)), x - reach, x + reach, arb(0))
    return _of_order(radicand, LoopPlace(place.region, better), MIN_ZERO_POWER)


def _of_order(radicand: Radicand, place: LoopPlace, least: float = MIN_FRACTIONAL_EXPONENT) -> Zero:
    return Zero(place.v(), _KIND_OF[_order(radicand, place, least)])


def _order(radicand: Radicand, place: LoopPlace, least: float = MIN_FRACTIONAL_EXPONENT) -> Order:
    return order_of_zero(lambda x: radicand(LoopPlace(place.region, x)), place.x, least)


def tends_to_zero(radicand: Radicand, v: arb) -> bool:
    """Tell whether P is seen to fall towards a place where it changes its sign: no jump, no growth."""
    x = abs(v).mid()
    # No ball tells a power below MIN_ZERO_POWER from a jump.
    return exponent_at(lambda at: radicand(LoopPlace("middle", at)), x, x * arb(2) ** -24) > MIN_ZERO_POWER


def _by_signs(function: Callable[[arb], arb], a: arb, b: arb) -> arb:
    """Return the place between a and b where the sign changes, by halving alone."""
    a, b = a.mid(), b.mid()
    rises = function(b) > 0
    for _ in range(MAX_HALVINGS):
        middle = ((a + b) / 2).mid()
        if middle in (a, b) or abs(b - a) < abs(middle) * arb(2) ** -BRACKET_BITS:
            break
        a, b = (a, middle) if (function(middle) > 0) == rises else (middle, b)
    return a


def _common_region(left: LoopPlace, right: LoopPlace) -> tuple[LoopPlace, LoopPlace]:
    """Express two neighbouring places in one coordinate; regions meet far away from the poles."""
    return LoopPlace("middle", left.v()), LoopPlace("middle", right.v())


def enclose_zero(function: Callable[[arb], arb], a: arb, b: arb) -> arb:
    """Return a ball around the zero of ``function`` between a and b, where its signs differ.

    Regula falsi with Anderson and Björck's weights (1973) on midpoints, then the
    ball is proved by the signs at its ends.
    """
    a, b = a.mid(), b.mid()
    fa, fb = function(a).mid(), function(b).mid()
    small = arb(2) ** (16 - ctx.prec)
    for step in range(8 * ctx.prec):
        # Every fourth step halves: a bracket never shrinks slower than bisection / 4.
        x = ((a + b) / 2 if step % 4 == 3 else (a * fb - b * fa) / (fb - fa)).mid()
        fx = function(x).mid()
        if fx == 0 or abs(b - a) < small * abs(b) or x in (a, b):
            break
        if (fx > 0) == (fb > 0):
            weight = 1 - fx / fb
            fa = fa * (weight if weight > 0 else arb("0.5")).mid()
        else:
            a, fa = b, fb
        b, fb = x, fx
        if abs(fx) < abs(fa) * arb(2) ** (8 - ctx.prec):
            break
    return _proved(function, x)


def _proved(function: Callable[[arb], arb], x: arb) -> arb:
    """Return the smallest ball x ± 2^k ulp at whose ends the signs provably differ."""
    radius = abs(x) * arb(2) ** (12 - ctx.prec)
    for _ in range(ctx.prec // 4):
        low, high = function((x - radius).mid()), function((x + radius).mid())
        if (low > 0 and high < 0) or (low < 0 and high > 0):
            break
        radius = (radius * 4).mid()
    return arb(x.mid(), radius.abs_upper())


def _is_simple(radicand: Radicand, place: LoopPlace, exponent: int = -60) -> bool:
    """Tell whether P grows like the first power of the distance from its zero, at 2^exponent of x."""
    distance = abs(place.x.mid()) * arb(2) ** (exponent - 1)
    grows = exponent_at(lambda x: radicand(LoopPlace(place.region, x)), place.x.mid(), distance)
    # 0 of a place that only looks like a zero of high order, next to it.
    is_near = 0.5 < grows < 1.5
    return is_near and (abs(grows - 1.0) < WHOLE_EXPONENT_DISTANCE or _order(radicand, place) != "fractional")


def classify_pole(radicand: Radicand, side: Region) -> PoleKind:
    """Return the behaviour of P at a pole, from its power law at the nearest distances where it is known."""
    for nearest, farthest in pairwise(POLE_LOG2_DISTANCES):
        near, far = (radicand(LoopPlace(side, arb(2) ** e)) for e in (nearest, farthest))
        if is_known(near) and is_known(far):
            break
    if not (near > 0 and far > 0):
        return "blocked"
    slope = float((near / far).log() / (arb(2).log() * (nearest - farthest)))
    if not abs(slope) < MAX_POLE_POWER:
        return "flat"
    if abs(slope) < 1e-3:
        return "passable"
    return "asymptotic" if slope > 0 else "collision"
