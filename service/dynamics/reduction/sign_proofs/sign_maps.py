"""Proves the signs of P on halves of many loops at once: of one formula and body, on curves of their own.

Nearly all that a map of signs takes for one half is the handling of short arrays. Here the cells of all
halves are evaluated together; each half has the map of :mod:`.signs`, with the same cells. Cells that
bounds in doubles leave open are settled in balls.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from service.dynamics.formula.algebras.intervals import Bounds
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Cells, Loops
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
from service.dynamics.reduction.sign_proofs.signs import (
    CELLS,
    FOUND,
    Gap,
    SignMap,
    cells_to_cut,
    chosen,
    first_cells,
    is_crowded,
    joined,
    parts_of,
    refined,
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
CELL_MIN_RELATIVE_WIDTH = 1e-6
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
        return self.high - self.low < CELL_MIN_RELATIVE_WIDTH * self.high and self.halvings >= MIN_HALVINGS

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
