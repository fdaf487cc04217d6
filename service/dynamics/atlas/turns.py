r"""Settles stretches of the curve on which D turns at most once, next to two zeros that are about to meet.

The number of cells that would be needed there grows without end, because bounds of D on a cell are wider than
D by the width of the cell, while D is as small as its square. Where s X² D ≥ m > 0 on the whole stretch, s
being the sign of D at both ends, s D is convex along the curve; its value and slope at one place decide:

* s D < 0 there: D has two zeros, one on each side;
* s D > (X D)² / 2m there: D has none.

Where the signs at the ends differ it has one zero, and where s X² D < 0 none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from service.dynamics.atlas.curves import HalfCurves, LambdaStretch, d_on_curves, equator_of
from service.dynamics.atlas.sign_maps import Finest, sign_maps_of, with_infinities
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import QUARTER_TURN, Cells
from service.dynamics.reduction.sign_proofs.cells import CellSigns, Curves, derivative_values
from service.dynamics.reduction.sign_proofs.signs import SignMap, chosen, joined

FloatArray = NDArray[np.float64]

MAX_GAP_RELATIVE_WIDTH = 0.3
"""Relative width of a gap in which a single turn is looked for."""
MAX_GAPS = 4
BEND_CELLS = 4
"""Cells on which X² D is bounded."""
SIGNED = 2
"""Marks a cell on which X² D has one sign: it is not cut."""
TURN_CELL_RELATIVE_WIDTH = 1e-13
"""Relative width of the cell about a place."""
GRID_POINTS, GRID_REFINEMENTS, DIFFERENCE_RELATIVE_STEP, NEWTON_STEPS = 33, 3, 1e-5, 3


@dataclass(frozen=True, slots=True)
class TurningGap:
    """Cells of the sign map number ``owner`` on which D turns."""

    owner: int
    first: int
    last: int
    hemisphere: float
    low: float
    high: float
    before: int
    """The sign of p² before the gap in the order of v, from where D leads to the turn."""
    after: int


def settled_sign_maps(
    half: HalfCurves,
    stretches: Sequence[LambdaStretch],
    starts: Sequence[SignMap | None],
    finest: Sequence[Finest],
) -> list[SignMap]:
    """Return for each stretch, all with the same ``is_inverse``, what bounds say, with and without turns."""
    curves = half.over(stretches)
    single = half.loops([replace(each, high=each.low) for each in stretches])
    mapped = with_infinities(curves, single, sign_maps_of(curves, starts, finest))
    return _with_turns(half, curves, stretches, mapped)


def _with_turns(
    half: HalfCurves, curves: Curves, stretches: Sequence[LambdaStretch], sign_maps: Sequence[SignMap]
) -> list[SignMap]:
    """Return the sign maps, each gap on which X² D has one sign being settled, or made one cell."""
    found = list(sign_maps)
    gaps = [gap for k, sign_map in enumerate(sign_maps) for gap in turning_gaps(k, sign_map)]
    if not gaps:
        return found
    least = _least_bends(curves, gaps)
    bent = np.flatnonzero(least != 0.0).tolist()
    gaps, least = [gaps[k] for k in bent], least[bent]
    if not gaps:
        return found
    centres = turning_points(half, [stretches[gap.owner] for gap in gaps], gaps)
    settled = _settled(curves, gaps, least, centres)
    # The later gap of a sign map first: the numbers of the other cells stay.
    for gap, cells in sorted(zip(gaps, settled, strict=True), key=lambda each: -each[0].first):
        keep = np.ones(len(found[gap.owner].found.sign), dtype=np.bool_)
        keep[gap.first : gap.last] = False
        found[gap.owner] = joined(chosen(found[gap.owner], keep), cells)
    return found


def turning_gaps(owner: int, sign_map: SignMap) -> list[TurningGap]:
    """Return the open gaps of a sign map, if they are few and narrow, in which D may turn once."""
    gaps = [gap for gap in sign_map.open_gaps() if not sign_map.is_infinite(gap)]
    found = [_candidate(owner, sign_map, gap) for gap in gaps] if len(gaps) <= MAX_GAPS else []
    return [gap for gap in found if gap is not None]


def _candidate(owner: int, sign_map: SignMap, gap: tuple[int, int]) -> TurningGap | None:
    """Return the stretch of an open gap that holds all places where D turns; None where it is too wide.

    It is the gap, or the part of it to which D leads from the same sign on both sides.
    """
    sign, slope = sign_map.found.sign, sign_map.found.slope
    if gap[0] == 0 or gap[1] == len(sign):
        return None
    before, after = int(sign[gap[0] - 1]), int(sign[gap[1]])
    if not before or not after:
        return None
    turns = sign_map.turns(gap)
    first, last = turns[0][0], turns[-1][1]
    leads = (slope[gap[0] : first] == -before).all() and (slope[last : gap[1]] == after).all()
    for start, stop in ([(first, last)] if leads and before == after else []) + [gap]:
        here = slice(start, stop)
        low, high = float(sign_map.cells.low[here].min()), float(sign_map.cells.high[here].max())
        side = sign_map.cells.hemisphere[here]
        if (
            (side == side[0]).all()
            and low > 0.0
            and high < QUARTER_TURN
            and high - low < MAX_GAP_RELATIVE_WIDTH * high
        ):
            return TurningGap(owner, start, stop, float(side[0]), low, high, before, after)
    return None


def _least_bends(curves: Curves, gaps: Sequence[TurningGap]) -> FloatArray:
    """Return for each gap the smallest |X² D| with the sign that X² D has all over it; 0 without one."""
    ends = np.array([np.linspace(gap.low, gap.high, BEND_CELLS + 1) for gap in gaps])
    *_, (low, high) = derivative_values(curves, _cells(gaps, ends[:, :-1], ends[:, 1:]), 2)
    least, most = (side.reshape(len(gaps), BEND_CELLS) for side in (low, high))
    # Written so that NaN is no bound.
    is_up, is_down = (least > 0.0).all(axis=1), (most < 0.0).all(axis=1)
    found: FloatArray = np.where(is_up, least.min(axis=1), np.where(is_down, most.max(axis=1), 0.0))
    return found


def turning_points(
    half: HalfCurves, stretches: Sequence[LambdaStretch], gaps: Sequence[TurningGap]
) -> FloatArray:
    """Return where D turns in each gap for a λ inside the stretch, in doubles: a estimate."""
    low, high = (np.array([getattr(gap, end) for gap in gaps])[:, None] for end in ("low", "high"))
    side = np.array([gap.hemisphere for gap in gaps])[:, None]
    Z, G = equator_of(half, stretches)

    def D(x: FloatArray) -> FloatArray:
        return d_on_curves(half, Z, G, side, x)

    left, right = low, high
    shares = np.linspace(0.0, 1.0, GRID_POINTS)
    for _ in range(GRID_REFINEMENTS):
        x = left + (right - left) * shares
        values = D(x)
        # The chord is taken off: D turns where it is farthest from it.
        middle = np.abs(values - (values[:, :1] + (values[:, -1:] - values[:, :1]) * shares))
        best = np.clip(np.argmax(middle, axis=1), 1, GRID_POINTS - 2)[:, None]
        left, right = np.take_along_axis(x, best - 1, axis=1), np.take_along_axis(x, best + 1, axis=1)
    x = 0.5 * (left + right)
    step = DIFFERENCE_RELATIVE_STEP * high
    for _ in range(NEWTON_STEPS):
        below, here, above = np.split(D(np.concatenate([x - step, x, x + step], axis=1)), 3, axis=1)
        with np.errstate(all="ignore"):
            move = 0.5 * step * (above - below) / (above - 2.0 * here + below)
        x = np.clip(x - np.nan_to_num(move), low, high)
    found: FloatArray = x[:, 0]
    return found


def _settled(
    curves: Curves, gaps: Sequence[TurningGap], least: FloatArray, centres: FloatArray
) -> list[SignMap]:
    """Return the cells that take the place of each gap."""
    low, high = (
        centres[:, None] * (1.0 - TURN_CELL_RELATIVE_WIDTH),
        centres[:, None] * (1.0 + TURN_CELL_RELATIVE_WIDTH),
    )
    (value, slope) = derivative_values(curves, _cells(gaps, low, high), 1)
    found = []
    for k, gap in enumerate(gaps):
        bend = float(least[k])
        D = float(value[0][k]), float(value[1][k])
        steepest = max(abs(float(slope[0][k])), abs(float(slope[1][k])))
        ends = (gap.low, float(low[k, 0]), float(high[k, 0]), gap.high)
        found.append(_decided(gap, bend, D, steepest * steepest / (2.0 * abs(bend)), ends))
    return found


def _decided(
    gap: TurningGap, bend: float, D: tuple[float, float], drop: float, ends: tuple[float, float, float, float]
) -> SignMap:
    sign = gap.before
    if gap.before != gap.after:
        # Convex from one sign to the other: one zero, as if D grew or fell all over it.
        return _row(gap, (gap.low, gap.high), (0,), (gap.after,))
    if sign * bend < 0.0:
        return _row(gap, (gap.low, gap.high), (sign,), (0,))
    lowest, highest = (D[0], D[1]) if sign > 0 else (-D[1], -D[0])
    if highest < 0.0 and gap.low < ends[1] and ends[2] < gap.high:
        # In the order of v, the first stretch leads away from the sign at the ends.
        return _row(gap, ends, (0, -sign, 0), (-sign, 0, sign))
    if lowest > drop * (1.0 + 1e-9):
        return _row(gap, (gap.low, gap.high), (sign,), (0,))
    return _row(gap, (gap.low, gap.high), (0,), (0,))


def _row(gap: TurningGap, ends: Sequence[float], signs: Sequence[int], slopes: Sequence[int]) -> SignMap:
    """Return cells one after the other, with signs and slopes in the order of growing v."""
    n = len(signs)
    order = slice(None) if gap.hemisphere > 0 else slice(None, None, -1)
    low, high = np.array(ends[:-1]), np.array(ends[1:])
    cells = Cells(np.full(n, gap.owner), np.full(n, gap.hemisphere), low[order], high[order])
    nothing = np.zeros(n, dtype=np.bool_)
    return SignMap(cells, CellSigns(np.array(signs), np.array(slopes), nothing, nothing), np.full(n, SIGNED))


def _cells(gaps: Sequence[TurningGap], low: FloatArray, high: FloatArray) -> Cells:
    """Return cells of gaps, shape (gaps, n)."""
    n = low.shape[1]
    owner = np.repeat(np.array([gap.owner for gap in gaps]), n)
    side = np.repeat(np.array([gap.hemisphere for gap in gaps]), n)
    return Cells(owner, side, low.ravel(), high.ravel())
