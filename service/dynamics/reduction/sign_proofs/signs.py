r"""Proves the sign of P on whole halves of loops, by cells that cover them from pole to pole.

Every cell has a certain sign by bounds of D, or P is monotone on it by bounds of X D
(:mod:`.slopes`), or it is open and is cut. A stretch of cells without a sign, between two that have one,
on which P grows all over or falls all over, is closed: it has one zero if the signs differ, and none else.

Nearly all that a map of signs takes for one half is the handling of short arrays. So the cells of many halves
are evaluated together, each half having the map that it has alone. Cells that bounds in doubles leave open
are settled in balls.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.intervals import Bounds
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    CELL_MIN_RELATIVE_WIDTH,
    QUARTER_TURN,
    Cells,
    Loops,
)
from service.dynamics.reduction.sign_proofs.cells import (
    Bound,
    CellSigns,
    Curves,
    Half,
    Side,
    bound_on_cell,
    bound_on_stretch,
    signs_on_cells,
    turn_on_stretch,
    width_of,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
FIRST = np.concatenate([[0.0], np.geomspace(1e-3, 0.128, 8), np.linspace(0.2, QUARTER_TURN, 12)])
"""Ends of the first cells, from a pole to the equator."""
CUT_PARTS = 4
"""Number of parts into which an open cell is cut."""
NEAREST_POLE_DISTANCE = 1e-100
"""An open cell at a pole that ends here is not cut again."""
MAX_OPEN_CELLS = 8192
"""Open ones at a time."""
CELLS, FOUND = ("owner", "hemisphere", "low", "high"), ("sign", "slope", "is_undefined", "is_faint")
INFINITE, NAMED = 99, 98
Gap = tuple[int, int]
"""Numbers of the cells without a certain sign, first ≤ k < last, as many as there are in a row."""


@dataclass(frozen=True, slots=True)
class SignMap:
    """The results for every cell of a half; arrays of one shape, in the order of growing v."""

    cells: Cells
    found: CellSigns
    most_zeros: IntArray
    """So many has P on the stretch of such cells that the cell belongs to, as balls say; −1 elsewhere.
    INFINITE where P is proved to be infinite at one place of the stretch, NAMED where it is proved to have
    one zero there, of an order that is known."""

    @property
    def is_settled(self) -> BoolArray:
        """Tell for each cell whether the sign of P, or that P has no value, is proved."""
        settled: BoolArray = (self.found.sign != 0) | self.found.is_undefined
        return settled

    def gaps(self) -> list[Gap]:
        """Return the stretches of cells without a certain sign."""
        settled = self.is_settled
        edges = (np.flatnonzero(settled[1:] != settled[:-1]) + 1).tolist()
        if len(settled) and not settled[0]:
            edges.insert(0, 0)
        if len(edges) % 2:
            edges.append(len(settled))
        return list(zip(edges[::2], edges[1::2], strict=True))

    def is_closed(self, gap: Gap) -> bool:
        """Tell whether P has signs before and after the gap, and grows all over it or falls all over it."""
        first, last = gap
        if first == 0 or last == len(self.found.sign):
            return False
        if self.found.sign[first - 1] == 0 or self.found.sign[last] == 0:
            return False
        slopes = self.found.slope[first:last]
        return bool(slopes[0] != 0 and (slopes == slopes[0]).all())

    def open_gaps(self) -> list[Gap]:
        """Return the gaps that are not closed."""
        return [gap for gap in self.gaps() if not self.is_closed(gap)]

    def turns(self, gap: Gap) -> list[Gap]:
        """Return the stretches of a gap on which the slope has no certain sign, or has both.

        With them the cells next to a pole, or to a stretch without values: P has no sign to begin from.
        """
        first, last = gap
        slopes = self.found.slope[first:last]
        is_silent = slopes == 0
        changes = slopes[1:] * slopes[:-1] < 0
        is_silent[1:] |= changes
        is_silent[:-1] |= changes
        is_silent[0] |= first == 0 or self.found.sign[first - 1] == 0
        is_silent[-1] |= last == len(self.found.sign) or self.found.sign[last] == 0
        edges = np.diff(np.concatenate([[False], is_silent, [False]]).astype(np.int8))
        starts, stops = np.flatnonzero(edges > 0) + first, np.flatnonzero(edges < 0) + first
        return list(zip(starts.tolist(), stops.tolist(), strict=True))

    def is_infinite(self, gap: Gap) -> bool:
        """Tell whether P is proved to be infinite at one place of a gap."""
        return bool((self.most_zeros[gap[0] : gap[1]] == INFINITE).all())

    def is_known(self, gap: Gap) -> bool:
        """Tell whether it is proved what is in a gap: an infinity, or a zero of high order."""
        most = self.most_zeros[gap[0] : gap[1]]
        return bool((most == most[0]).all() and most[0] in (INFINITE, NAMED))

    def is_bounded(self, gap: Gap) -> bool:
        """Tell whether balls have found all places of a gap where P turns."""
        return all((self.most_zeros[first:last] == 2).all() for first, last in self.turns(gap))


def first_sign_map(half: Half) -> SignMap:
    """Return what bounds of D say of some forty cells."""
    cells = first_cells()
    return SignMap(cells, signs_on_cells(half, cells, with_slope=False), np.full(len(cells.low), -1))


@cache
def first_cells() -> Cells:
    """Return the cells to begin with, the same for every half."""
    low, high = FIRST[:-1], FIRST[1:]
    return Cells(
        np.zeros(2 * len(low), dtype=np.int64),
        np.repeat([1.0, -1.0], len(low)),
        np.concatenate([low, low[::-1]]),
        np.concatenate([high, high[::-1]]),
    )


def refined(half: Half, sign_map: SignMap, most_rounds: int) -> SignMap:
    """Return the sign map with its open cells cut until all gaps are closed, or so many times.

    A cell that cannot be cut, and one among more than MAX_OPEN_CELLS, is left as it is.
    """
    for _ in range(most_rounds):
        is_cut = cells_to_cut(sign_map)
        if not is_cut.any() or is_cut.sum() > MAX_OPEN_CELLS:
            break
        parts = parts_of(sign_map.cells.at(is_cut))
        found = signs_on_cells(half, parts, with_slope=True)
        sign_map = joined(chosen(sign_map, ~is_cut), SignMap(parts, found, np.full(len(parts.low), -1)))
    return sign_map


def is_crowded(sign_map: SignMap) -> bool:
    """Tell whether more cells are open than are cut."""
    return bool(cells_to_cut(sign_map).sum() > MAX_OPEN_CELLS)


def cells_to_cut(sign_map: SignMap) -> BoolArray:
    """Tell which cells to cut: those of open gaps on which P may turn."""
    is_cut = np.zeros(len(sign_map.found.sign), dtype=np.bool_)
    low, high = sign_map.cells.low, sign_map.cells.high
    can_be_cut = np.where(
        low > 0.0, high - low > CELL_MIN_RELATIVE_WIDTH * high, high > NEAREST_POLE_DISTANCE
    )
    can_be_cut &= (sign_map.most_zeros < 0) & ~sign_map.found.is_faint
    for gap in sign_map.open_gaps():
        for first, last in sign_map.turns(gap):
            is_cut[first:last] = can_be_cut[first:last]
    return is_cut


def parts_of(cells: Cells) -> Cells:
    """Return the parts of each cell; next to a pole the nearer ones are much the smaller."""
    low, high = cells.low[:, None], cells.high[:, None]
    shares = np.arange(CUT_PARTS + 1) / CUT_PARTS
    with np.errstate(all="ignore"):
        steps = np.where(high > 2.0 * low, low * (high / low) ** shares, low + (high - low) * shares)
        at_pole = high * np.minimum(1.0 / 16.0, high) ** np.arange(CUT_PARTS, -1.0, -1.0)
    ends = np.where(low == 0.0, at_pole, steps)
    ends[:, 0], ends[:, -1] = cells.low, cells.high
    return Cells(
        np.repeat(cells.owner, CUT_PARTS),
        np.repeat(cells.hemisphere, CUT_PARTS),
        ends[:, :-1].ravel(),
        ends[:, 1:].ravel(),
    )


def joined(one: SignMap, other: SignMap) -> SignMap:
    """Return the cells of both, in the order of growing v."""
    cells = Cells(*(np.concatenate([getattr(one.cells, name), getattr(other.cells, name)]) for name in CELLS))
    found = CellSigns(
        *(np.concatenate([getattr(one.found, name), getattr(other.found, name)]) for name in FOUND)
    )
    most = np.concatenate([one.most_zeros, other.most_zeros])
    return chosen(SignMap(cells, found, most), np.lexsort((cells.hemisphere * cells.low, -cells.hemisphere)))


def chosen(sign_map: SignMap, which: IntArray | BoolArray) -> SignMap:
    """Return some of the cells."""
    found = sign_map.found
    return SignMap(
        sign_map.cells.at(which),
        CellSigns(*(getattr(found, name)[which] for name in FOUND)),
        sign_map.most_zeros[which],
    )


CUT_ROUNDS = 4
"""Rounds of cuts in doubles, between two looks in balls."""
BALL_STAGES = 8
MAX_GAPS = 1000
"""Open ones: beyond, nothing is settled in balls."""
MAX_GAP_RELATIVE_WIDTH = 0.05
"""Largest width of a gap, against its distance to the pole: a wider one is cut first."""
MAX_BALL_CELLS, MAX_BALL_CELLS_AT_POLES = 600, 100
"""At cells where doubles fail, of one half."""
BALL_CELL_MIN_RELATIVE_WIDTH = 1e-6
"""Relative width of a cell that is not halved any more."""
MIN_HALVINGS = 12
"""Least number of halvings that a cell has had before its relative width counts as small."""


def settled(half: Half, sign_map: SignMap) -> SignMap:
    """Return the sign map with its open gaps closed, or the number of their zeros bounded, where possible."""
    at_poles = [gap for gap in sign_map.open_gaps() if gap[0] == 0 or gap[1] == len(sign_map.cells.low)]
    sign_map = _halved(half, sign_map, at_poles, MAX_BALL_CELLS_AT_POLES)
    for _ in range(BALL_STAGES):
        gaps = _unbounded(sign_map)
        if not gaps:
            return sign_map
        if len(gaps) > MAX_GAPS or is_crowded(sign_map):
            return sign_map
        sign_map = _bounded(half, sign_map, gaps)
        before = len(sign_map.cells.low)
        sign_map = refined(half, sign_map, CUT_ROUNDS)
        if len(sign_map.cells.low) == before:
            break
    return sign_map


def halved(half: Half, sign_map: SignMap) -> SignMap:
    """Return the sign map with the cells of what is open still halved in balls."""
    gaps = _unbounded(sign_map)
    is_too_much = len(gaps) > MAX_GAPS or is_crowded(sign_map)
    return sign_map if is_too_much else _halved(half, sign_map, gaps, MAX_BALL_CELLS)


def ends_of(sign_map: SignMap, gap: Gap) -> tuple[Side, Side]:
    """Return the places where a gap begins and ends."""
    cells = sign_map.cells
    first, last = gap[0], gap[1] - 1
    north, south = float(cells.hemisphere[first]), float(cells.hemisphere[last])
    return (
        (north, float((cells.low if north > 0 else cells.high)[first])),
        (south, float((cells.high if south > 0 else cells.low)[last])),
    )


def _unbounded(sign_map: SignMap) -> list[Gap]:
    return [gap for gap in sign_map.open_gaps() if not (sign_map.is_bounded(gap) or sign_map.is_known(gap))]


def _bounded(half: Half, sign_map: SignMap, gaps: list[Gap]) -> SignMap:
    """Return the sign map with what balls say of each stretch on which P may turn."""
    found, most = sign_map.found, sign_map.most_zeros.copy()
    sign, slope = found.sign.copy(), found.slope.copy()
    turns = [turn for gap in gaps for turn in sign_map.turns(gap)]
    for first, last in turns:
        start, stop = ends_of(sign_map, (first, last))
        if most[first] >= 0 or not width_of(start, stop) < MAX_GAP_RELATIVE_WIDTH:
            continue
        order, its_sign = _known(half, start, stop)
        here = slice(first, last)
        most[here] = order
        sign[here] = its_sign if order == 0 else sign[here]
        slope[here] = its_sign if order == 1 else slope[here]
    return SignMap(sign_map.cells, CellSigns(sign, slope, found.is_undefined, found.is_faint), most)


def _known(half: Half, start: Side, stop: Side) -> tuple[int, int]:
    """Return the order of the first derivative of P with one sign on the stretch, and this; −1 for none."""
    bound = bound_on_stretch(half, start, stop)
    if bound is None or bound.order < 2:
        return (-1, 0) if bound is None else (bound.order, bound.sign)
    turn = turn_on_stretch(half, start, stop)
    if turn is None:
        return -1, 0
    return (2, bound.sign) if turn.slope == 0 else (1, turn.slope)


def _halved(half: Half, sign_map: SignMap, gaps: list[Gap], most_looks: int) -> SignMap:
    """Return the sign map with the cells of these gaps halved in balls, as long as looks are left."""
    looks = 0
    for gap in reversed(gaps):
        first, last = gap
        cells = sign_map.cells.at(slice(first, last))
        waiting = [
            _Cell(*ends) for ends in zip(*(getattr(cells, name).tolist() for name in CELLS[1:]), strict=True)
        ]
        if first == 0 or last == len(sign_map.cells.low):
            # What cancels at the pole, doubles lose all over the gap.
            waiting = _whole_sides(waiting)
        done = list[_Cell]()
        while waiting:
            cell = waiting.pop(0)
            looks += 1
            if looks <= most_looks:
                cell = replace(cell, bound=bound_on_cell(half, cell.hemisphere, cell.low, cell.high))
            if cell.bound is not None or cell.is_small or looks > most_looks:
                done.append(cell)
            else:
                waiting.extend(cell.halves())
        kept = np.ones(len(sign_map.cells.low), dtype=np.bool_)
        kept[first:last] = False
        sign_map = joined(chosen(sign_map, kept), _sign_map_of(done))
    return sign_map


def _whole_sides(cells: "list[_Cell]") -> "list[_Cell]":
    """Return one cell for those of each hemisphere."""
    sides = [[cell for cell in cells if cell.hemisphere == side] for side in (1.0, -1.0)]
    return [
        replace(side[0], low=min(cell.low for cell in side), high=max(cell.high for cell in side))
        for side in sides
        if side
    ]


@dataclass(frozen=True, slots=True)
class _Cell:
    hemisphere: float
    low: float
    high: float
    halvings: int = 0
    bound: Bound | None = None

    @property
    def is_small(self) -> bool:
        if self.low == 0.0:
            return self.halvings >= MIN_HALVINGS
        return (
            self.high - self.low < BALL_CELL_MIN_RELATIVE_WIDTH * self.high and self.halvings >= MIN_HALVINGS
        )

    def halves(self) -> "tuple[_Cell, _Cell]":
        """Return both parts; next to a pole the nearer one is much the smaller."""
        low, high = self.low, self.high
        middle = high * min(1 / 16, high) if low == 0.0 else sqrt(low) * sqrt(high)
        middle = middle if low == 0.0 or high > 2.0 * low else 0.5 * (low + high)
        later = self.halvings + 1
        return replace(self, high=middle, halvings=later), replace(self, low=middle, halvings=later)


def _sign_map_of(done: list[_Cell]) -> SignMap:
    bounds = [(-1, 0) if cell.bound is None else (cell.bound.order, cell.bound.sign) for cell in done]
    order, its_sign = (np.array(each, dtype=np.int64) for each in zip(*bounds, strict=True))
    nothing = np.zeros(len(done), dtype=np.bool_)
    hemisphere, low, high = (np.array([getattr(cell, name) for cell in done]) for name in CELLS[1:])
    found = CellSigns(np.where(order == 0, its_sign, 0), np.where(order == 1, its_sign, 0), nothing, nothing)
    cells = Cells(np.zeros(len(done), dtype=np.int64), hemisphere, low, high)
    return SignMap(cells, found, np.full(len(done), -1))


MAX_CELLS_CUT = 256
"""Open cells of one half that are cut together with those of others: one with more has a sign map alone."""


def sign_maps_together(halves: Sequence[Half], most_rounds: int) -> list[SignMap | None]:
    """Return the refined sign map of each half, all of one tape, body and shape; None for one of many cells.

    Whether a cell is open may depend, by the last bit of a bound, on what is looked at beside it; what is
    found of it holds all the same.
    """
    first = halves[0]
    Z, G = (_together([getattr(half.loops, name) for half in halves]) for name in "ZG")
    curves = Curves(first.tape, first.body, Loops(first.loops.shape, Z, G), first.turn)
    sign_maps: list[SignMap | None] = list(
        _sign_maps(curves, [first_cells()] * len(halves), with_slope=False)
    )
    waiting = list(range(len(halves)))
    for _ in range(most_rounds):
        cut: list[tuple[int, SignMap, NDArray[np.bool_]]] = []
        for k in waiting:
            sign_map = sign_maps[k]
            assert sign_map is not None
            is_cut = cells_to_cut(sign_map)
            count = int(is_cut.sum())
            if count > MAX_CELLS_CUT:
                sign_maps[k] = None
            elif count:
                cut.append((k, sign_map, is_cut))
        if not cut:
            break
        parts = [parts_of(sign_map.cells.at(is_cut)) for _, sign_map, is_cut in cut]
        waiting = [k for k, _, _ in cut]
        found = _sign_maps(curves, parts, with_slope=True, owners=waiting)
        for (k, sign_map, is_cut), part in zip(cut, found, strict=True):
            sign_maps[k] = joined(chosen(sign_map, ~is_cut), part)
    return sign_maps


def _together(bounds: Sequence[Bounds]) -> Bounds:
    low, high = zip(*bounds, strict=True)
    return np.concatenate(low), np.concatenate(high)


def _sign_maps(
    curves: Curves, cells: Sequence[Cells], *, with_slope: bool, owners: Sequence[int] | None = None
) -> list[SignMap]:
    """Return what bounds say of the cells of each half; they are of the curves ``owners``, or of all."""
    counts = [len(each.low) for each in cells]
    owner = np.repeat(np.arange(len(cells)) if owners is None else np.array(owners, dtype=np.int64), counts)
    rest = (np.concatenate([getattr(each, name) for each in cells]) for name in CELLS[1:])
    found = signs_on_cells(curves, Cells(owner, *rest), with_slope=with_slope)
    sign_maps, start = [], 0
    for each, count in zip(cells, counts, strict=True):
        here = slice(start, start + count)
        part = CellSigns(*(getattr(found, name)[here] for name in FOUND))
        sign_maps.append(SignMap(each, part, np.full(count, -1)))
        start += count
    return sign_maps
