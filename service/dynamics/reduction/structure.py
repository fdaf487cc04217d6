r"""Finds the zeros of P on one half of a loop, and proves that there are no others.

For a potential with a formula all of this is proved, by bounds that hold on the whole half from pole to
pole (:mod:`.signs`; :mod:`.cells` where doubles do not settle it):

* P has the stated sign on all cells, which cover the half except for narrow gaps;
* on a gap whose slope has one sign P has one zero, if its signs before and after differ, else none;
* on a gap where X² D has one sign P turns at one place, which is enclosed, and where its sign is known.
  If it is not, at the bits in use, P may touch 0 there: that is a zero of even order, or none, or two
  which these bits do not distinguish;
* on a gap where 1/P tends to 0 at one place, which is enclosed, P grows without bound, to the signs that are
  proved for both sides of it (:mod:`.infinities`).

Where none of these has a sign, exact algebra tells the order of a zero, and the derivative of that order has
a sign all over the gap: there is one zero, and none else (:mod:`.high_zeros`).

What remains is evidence, and such gaps are at most 1e-5 wide against their distance to a pole: a zero of
order three or more, or of no order; the edge of where P is defined. There P is proved to be continuous.
Values in balls then say that P is 0 to all bits in use, or changes its sign, and its growth names the zero
(:mod:`.zeros`); that there is one zero only in this gap is not proved. Where a gap is none of these the
motion is refused.

A potential that is given by an integral has no tape: there all is evidence, of the scan (:mod:`.radicand`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.formula.vanishing import vanishing_parts
from service.dynamics.potentials.potential import NoClosedFormError
from service.dynamics.reduction.geometry.loop import Loop
from service.dynamics.reduction.root_finding.radicand import (
    DOUBLE_ZERO_BITS_SHARE,
    HalfLoop,
    half_between,
    in_order,
    precise_radicand,
    scan_half,
    vanishes,
)
from service.dynamics.reduction.root_finding.zeros import (
    LoopPlace,
    Radicand,
    Region,
    lowest_place,
    tends_to_zero,
)
from service.dynamics.reduction.separatrices import GridMinima, grid_minima_of, with_near_rests
from service.dynamics.reduction.sign_proofs.cells import (
    Half,
    Side,
    half_of,
    height_at,
    is_negative_where_defined,
    turn_on_stretch,
    width_of,
)
from service.dynamics.reduction.sign_proofs.high_zeros import HighZero, high_zero
from service.dynamics.reduction.sign_proofs.infinities import (
    Infinity,
    continuous_sign,
    infinities_of,
    infinity_between,
    is_essential,
)
from service.dynamics.reduction.sign_proofs.neighbourhoods import UNDEFINED
from service.dynamics.reduction.sign_proofs.signs import (
    INFINITE,
    MAX_GAPS,
    NAMED,
    Gap,
    SignMap,
    ends_of,
    first_sign_map,
    halved,
    refined,
    settled,
    sign_maps_together,
)
from service.dynamics.reduction.window import height

IntArray = NDArray[np.int64]
Ends = tuple[Side, Side]
"""The two ends of a gap."""

CUT_ROUNDS = 6
"""Rounds of cuts in doubles before anything else is tried."""
STRETCH_RELATIVE_WIDTH = 1e-5
"""Width, against the distance to the pole, that a stretch about a zero of higher order, or of none, or about
an edge may have."""
MAX_HIGH_ZEROS = 4
"""In no more open gaps than these zeros of high order are looked for before cells are halved."""
SIZE_RELATIVE_DISTANCE = 1 / 16
"""Relative distance from it at which P has its size."""
SAME_PLACE_DISTANCE = 1e-14


class SignsUnsettledError(DynamicsError):
    """On a part of the curve the bounds do not decide where p² is positive."""

    code = "signs_unsettled"


class EssentialSingularityError(SignsUnsettledError):
    """Next to a place p² grows, falls or swings faster than any power of the distance."""

    code = "essential_singularity"

    def __init__(self, low: float, high: float) -> None:
        super().__init__(
            f"between g2 = {low:.15g} and {high:.15g} exp, sin, cos or tan is taken of something that grows "
            "without bound: beside such a place no power of the distance tells the sign of p²",
            pointer="/potential",
        )


@dataclass(frozen=True, slots=True)
class HalfInDoubles:
    """The results of doubles about one half of a loop, before balls look at it."""

    half: Half
    sign_map: SignMap
    minima: GridMinima


def halves_in_doubles(loops: Sequence[Loop], g3_sign: int) -> list[HalfInDoubles | None]:
    """Return what :func:`proved_half` begins with, for loops of one body and formula, and of equal signs.

    None where the sign map has so many cells that it is better made alone.
    """
    halves = [half_of(loop, loop.potential.tape, g3_sign) for loop in loops]
    sign_maps, minima = sign_maps_together(halves, CUT_ROUNDS), grid_minima_of(loops, g3_sign)
    return [
        None if sign_map is None else HalfInDoubles(half, sign_map, low)
        for half, sign_map, low in zip(halves, sign_maps, minima, strict=True)
    ]


def proved_half(loop: Loop, g3_sign: int, in_doubles: HalfInDoubles | None = None) -> HalfLoop:
    """Return the zeros and signs of P where g3 has this sign (primed axes).

    ``in_doubles`` is what was found of this half together with others.

    Raises
    ------
    SignsUnsettledError
        The bounds do not decide the sign of P on a part of the half.
    """
    try:
        tape = loop.potential.tape
    except NoClosedFormError:
        return with_near_rests(loop, _seen_half(loop, g3_sign), g3_sign, ())
    radicand = precise_radicand(loop, g3_sign)
    half = half_of(loop, tape, g3_sign) if in_doubles is None else in_doubles.half
    sign_map = refined(half, first_sign_map(half), CUT_ROUNDS) if in_doubles is None else in_doubles.sign_map
    if (sign_map.found.sign == 0).all() and vanishes(radicand):
        return HalfLoop((), (-1,), "blocked", "blocked")
    infinities, zeros = list[Infinity](), dict[Ends, HighZero]()
    if sign_map.open_gaps():
        sign_map = _with_infinities(half, sign_map, infinities)
        sign_map = _with_infinities(half, settled(half, sign_map), infinities)
        sign_map = halved(half, _with_high_zeros(half, sign_map, zeros, radicand))
        sign_map = _with_infinities(half, sign_map, infinities)
    cuts, gaps = _cuts(sign_map), sign_map.open_gaps()
    if len(gaps) > MAX_GAPS:
        raise _unsettled(half, *ends_of(sign_map, gaps[0]))
    turns = [
        place
        for gap in gaps
        if not sign_map.is_infinite(gap)
        for place in _cuts_inside(half, sign_map, gap, zeros, radicand)
    ]
    cuts.extend(turns)
    for gap in gaps:
        if sign_map.is_infinite(gap):
            cuts.extend(_cuts_about(half, sign_map, gap, infinities, radicand))
    found = half_between(in_order(cuts), g3_sign, radicand)
    for gap in gaps:
        start, stop = ends_of(sign_map, gap)
        # A zero without a name would have to be the only one by bounds of the slope.
        if not (sign_map.is_bounded(gap) or sign_map.is_known(gap)) and any(
            zero.kind == "simple" and _is_between(zero.v, start, stop) for zero in found.zeros
        ):
            raise _unsettled(half, start, stop)
    minima = None if in_doubles is None else in_doubles.minima
    return with_near_rests(loop, found, g3_sign, [place.v() for place in turns], minima)


def _seen_half(loop: Loop, g3_sign: int) -> HalfLoop:
    """Return the half of a potential that is given by an integral, as far as a scan shows it.

    The part of it that has a formula is what may be infinite: that it is, is proved.
    """
    signs = (g3_sign, loop.g1_sign) if loop.mirrored else (loop.g1_sign, g3_sign)
    part = loop.potential.formula_part(*signs)
    radicand, cuts = precise_radicand(loop, g3_sign), list[LoopPlace]()
    if part is not None:
        infinities = infinities_of(half_of(loop, part.tape, g3_sign))
        if infinities is None:
            raise SignsUnsettledError(
                "where a part of the formula vanishes that it divides by, or takes a logarithm of, "
                "the sign of p² is not settled",
                pointer="/potential",
            )
        for infinity in infinities:
            found = infinity.cuts(radicand, 0, 0)
            if found is None:
                raise _not_settled(*(float(infinity.place.v().cos()),) * 2)
            cuts.extend(found)
    half = scan_half(loop, g3_sign, cuts)
    for zero in half.zeros:
        if zero.kind == "flat" and not tends_to_zero(radicand, zero.v):
            raise _not_settled(*(height(loop, zero.v),) * 2)
    return half


def _with_infinities(half: Half, sign_map: SignMap, found: list[Infinity]) -> SignMap:
    """Return the sign map with the gaps in which P is proved to be infinite, appended to ``found``."""
    gaps = [gap for gap in sign_map.open_gaps() if not (sign_map.is_bounded(gap) or sign_map.is_known(gap))]
    if not gaps or len(gaps) > MAX_GAPS or not vanishing_parts(half.tape):
        return sign_map
    most = sign_map.most_zeros.copy()
    for gap in gaps:
        if gap[0] > 0 and gap[1] < len(most):
            infinity = infinity_between(half, *ends_of(sign_map, gap))
            if infinity is not None:
                found.append(infinity)
                most[gap[0] : gap[1]] = INFINITE
    return replace(sign_map, most_zeros=most)


def _with_high_zeros(
    half: Half, sign_map: SignMap, found: dict[Ends, HighZero], radicand: Radicand
) -> SignMap:
    """Return the sign map with the gaps in which P is proved to have one zero of high order, in ``found``."""
    most, open_gaps = sign_map.most_zeros.copy(), list[tuple[Gap, Ends, tuple[int, int]]]()
    for gap in sign_map.open_gaps():
        signs, ends = _labels_around(sign_map, gap), ends_of(sign_map, gap)
        is_open = not (
            sign_map.is_bounded(gap) or sign_map.is_known(gap) or width_of(*ends) < STRETCH_RELATIVE_WIDTH
        )
        if is_open and not {0, UNDEFINED} & set(signs):
            open_gaps.append((gap, ends, signs))
    # A look for one takes as long as some hundred cells.
    for gap, ends, signs in open_gaps if len(open_gaps) <= MAX_HIGH_ZEROS else ():
        zero = high_zero(half, *ends, signs, radicand)
        if zero is not None and zero.is_proved:
            found[ends] = zero
            most[gap[0] : gap[1]] = NAMED
    return replace(sign_map, most_zeros=most)


def _cuts_about(
    half: Half, sign_map: SignMap, gap: Gap, infinities: Sequence[Infinity], radicand: Radicand
) -> list[LoopPlace]:
    """Return the place in a gap where P is infinite, and others that show its signs on both sides of it."""
    ends = ends_of(sign_map, gap)
    infinity = next(each for each in infinities if (each.start, each.stop) == ends)
    cuts = infinity.cuts(radicand, *_labels_around(sign_map, gap))
    if cuts is None:
        raise _unsettled(half, *ends)
    return cuts


def _labels_around(sign_map: SignMap, gap: Gap) -> tuple[int, int]:
    labels = _labels(sign_map)
    before, after = (int(labels[k]) if 0 <= k < len(labels) else 0 for k in (gap[0] - 1, gap[1]))
    return before, after


def _is_between(v: arb, start: Side, stop: Side) -> bool:
    """Tell whether a zero, on either half, lies on the stretch, as far as doubles resolve."""
    low, high = (x if side > 0 else np.pi - x for side, x in (start, stop))
    return bool(low * (1.0 - SAME_PLACE_DISTANCE) <= abs(float(v)) <= high * (1.0 + SAME_PLACE_DISTANCE))


def _cuts(sign_map: SignMap) -> list[LoopPlace]:
    """Return a place on the first and the last cell of each stretch where P has a sign."""
    cells = sign_map.cells
    label = _labels(sign_map)
    is_inside = np.zeros(len(label), dtype=np.bool_)
    is_inside[1:-1] = (label[:-2] == label[1:-1]) & (label[1:-1] == label[2:])
    cuts = []
    for k in np.flatnonzero((label != 0) & ~is_inside).tolist():
        x = arb(0.5 * (float(cells.low[k]) + float(cells.high[k])))
        cuts.append(
            LoopPlace(
                _region(float(cells.hemisphere[k])), x, sign=int(label[k]) if label[k] != UNDEFINED else None
            )
        )
    return cuts


def _labels(sign_map: SignMap) -> IntArray:
    """Return the sign of P on each cell, 0 if it is not known, UNDEFINED where P has no value."""
    return np.where(sign_map.found.is_undefined, UNDEFINED, sign_map.found.sign)


def _region(hemisphere: float) -> Region:
    return "north" if hemisphere > 0 else "south"


def _cuts_inside(
    half: Half, sign_map: SignMap, gap: Gap, zeros: Mapping[Ends, HighZero], radicand: Radicand
) -> list[LoopPlace]:
    """Return the place where P turns, or touches 0, in a gap that is not closed; none if it has an edge."""
    start, stop = ends_of(sign_map, gap)
    before, after = _labels_around(sign_map, gap)
    if 0 in (before, after):
        raise _unsettled(half, start, stop)
    if UNDEFINED in (before, after):
        if before == after or not width_of(start, stop) < STRETCH_RELATIVE_WIDTH:
            raise _unsettled(half, start, stop)
        return []
    if (start, stop) in zeros:
        return _cut_at(zeros[start, stop], before, after)
    if sign_map.is_bounded(gap):
        turns = [turn_on_stretch(half, *ends_of(sign_map, turn)) for turn in sign_map.turns(gap)]
        return [turn.place for turn in turns if turn is not None and turn.place is not None]
    sign = continuous_sign(half, start, stop)
    if sign and before == after:
        return []
    if not width_of(start, stop) < STRETCH_RELATIVE_WIDTH:
        zero = high_zero(half, start, stop, (before, after), radicand)
        if zero is None or not zero.is_settled(STRETCH_RELATIVE_WIDTH):
            raise _unsettled(half, *((start, stop) if zero is None else zero.rest))
        return _cut_at(zero, before, after)
    if sign is not None:
        if before != after:
            return []
        touch = _touch(start, stop, radicand)
        if touch is not None:
            return [touch]
    if before == after == -1 and is_negative_where_defined(half, start, stop):
        return []
    raise _unsettled(half, start, stop)


def _cut_at(zero: HighZero, before: int, after: int) -> list[LoopPlace]:
    return [LoopPlace("middle", zero.v.mid(), np.inf)] if before == after else []


def _touch(start: Side, stop: Side, radicand: Radicand) -> LoopPlace | None:
    """Return the place in a narrow gap where balls do not exclude P = 0, None if there is none."""
    region: Region = "middle" if start[0] != stop[0] else _region(start[0])
    left, right = (
        arb.pi() - arb(x) if region == "middle" and side < 0 else arb(x) for side, x in (start, stop)
    )

    def value(x: arb) -> arb:
        return radicand(LoopPlace(region, x))

    middle = (left + right) / 2
    # As balls: beside a flat zero P is below all doubles.
    one, other = (
        abs(value(middle * (1 + share))).mid()
        for share in (arb(SIZE_RELATIVE_DISTANCE), -arb(SIZE_RELATIVE_DISTANCE))
    )
    size = one.max(other)
    nothing = size * arb(2) ** -int(DOUBLE_ZERO_BITS_SHARE * ctx.prec)
    x = lowest_place(value, left, right, nothing)
    at_x = value(x)
    if at_x.is_finite():
        touches = abs(at_x).upper() <= nothing
    else:
        # The formula has no value there, such as exp(-1/x²) at 0: P is 0 if it comes to 0 on both sides.
        touches = all(abs(value(end)).upper() <= nothing for end in (left, right))
    return LoopPlace(region, x, np.inf) if touches else None


def _unsettled(half: Half, start: Side, stop: Side) -> DynamicsError:
    low, high = sorted(height_at(half, side) for side in (start, stop))
    return (
        EssentialSingularityError(low, high) if is_essential(half, start, stop) else _not_settled(low, high)
    )


def _not_settled(low: float, high: float) -> SignsUnsettledError:
    return SignsUnsettledError(
        f"between g2 = {low:.15g} and {high:.15g} on the curve the sign of p² is not settled: bounds "
        "do not decide where it is positive",
        pointer="/potential",
    )
