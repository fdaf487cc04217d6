"""Settles in balls the cells of half a loop that bounds in doubles leave open."""

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Cells
from service.dynamics.reduction.sign_proofs.cells import Found, Half
from service.dynamics.reduction.sign_proofs.signs import (
    CELLS,
    Gap,
    Picture,
    chosen,
    is_crowded,
    joined,
    refined,
)
from service.dynamics.reduction.sign_proofs.signs_in_balls import (
    Bound,
    Side,
    bound_on_cell,
    bound_on_stretch,
    turn_on_stretch,
    width_of,
)

ROUNDS = 4
"""Rounds of cuts in doubles, between two looks in balls."""
STAGES = 8
MOST_GAPS = 1000
"""Open ones: beyond, nothing is settled in balls."""
WIDE = 0.05
"""Largest width of a gap, against its distance to the pole: a wider one is cut first."""
MOST_LOOKS, LOOKS_AT_POLES = 600, 100
"""At cells where doubles fail, of one half."""
NARROW = 1e-6
"""Relative width of a cell that is not halved any more."""
HALVINGS = 12
"""Least number of halvings that a cell has had before its relative width counts as small."""


def settled(half: Half, picture: Picture) -> Picture:
    """Return the picture with its open gaps closed, or the number of their zeros bounded, where possible."""
    at_poles = [gap for gap in picture.open_gaps() if _is_at_pole(picture, gap)]
    picture = _halved(half, picture, at_poles, LOOKS_AT_POLES)
    for _ in range(STAGES):
        gaps = _unbounded(picture)
        if not gaps:
            return picture
        if len(gaps) > MOST_GAPS or is_crowded(picture):
            return picture
        picture = _bounded(half, picture, gaps)
        before = len(picture.cells.low)
        picture = refined(half, picture, ROUNDS)
        if len(picture.cells.low) == before:
            break
    return picture


def halved(half: Half, picture: Picture) -> Picture:
    """Return the picture with the cells of what is open still halved in balls."""
    gaps = _unbounded(picture)
    is_too_much = len(gaps) > MOST_GAPS or is_crowded(picture)
    return picture if is_too_much else _halved(half, picture, gaps, MOST_LOOKS)


def _is_at_pole(picture: Picture, gap: Gap) -> bool:
    return gap[0] == 0 or gap[1] == len(picture.cells.low)


def ends_of(picture: Picture, gap: Gap) -> tuple[Side, Side]:
    """Return the places where a gap begins and ends."""
    cells = picture.cells
    first, last = gap[0], gap[1] - 1
    north, south = float(cells.hemisphere[first]), float(cells.hemisphere[last])
    return (
        (north, float((cells.low if north > 0 else cells.high)[first])),
        (south, float((cells.high if south > 0 else cells.low)[last])),
    )


def _unbounded(picture: Picture) -> list[Gap]:
    return [gap for gap in picture.open_gaps() if not (picture.is_bounded(gap) or picture.is_known(gap))]


def _bounded(half: Half, picture: Picture, gaps: list[Gap]) -> Picture:
    """Return the picture with what balls say of each stretch on which P may turn."""
    found, most = picture.found, picture.most_zeros.copy()
    sign, slope = found.sign.copy(), found.slope.copy()
    turns = [turn for gap in gaps for turn in picture.turns(gap)]
    for first, last in turns:
        start, stop = ends_of(picture, (first, last))
        if most[first] >= 0 or not width_of(start, stop) < WIDE:
            continue
        order, its_sign = _known(half, start, stop)
        here = slice(first, last)
        most[here] = order
        sign[here] = its_sign if order == 0 else sign[here]
        slope[here] = its_sign if order == 1 else slope[here]
    return Picture(picture.cells, Found(sign, slope, found.is_undefined, found.is_faint), most)


def _known(half: Half, start: Side, stop: Side) -> tuple[int, int]:
    """Return the order of the first derivative of P with one sign on the stretch, and this; −1 for none."""
    bound = bound_on_stretch(half, start, stop)
    if bound is None or bound.order < 2:
        return (-1, 0) if bound is None else (bound.order, bound.sign)
    turn = turn_on_stretch(half, start, stop)
    if turn is None:
        return -1, 0
    return (2, bound.sign) if turn.slope == 0 else (1, turn.slope)


def _halved(half: Half, picture: Picture, gaps: list[Gap], most_looks: int) -> Picture:
    """Return the picture with the cells of these gaps halved in balls, as long as looks are left."""
    looks = 0
    for gap in reversed(gaps):
        first, last = gap
        cells = picture.cells.at(slice(first, last))
        waiting = [
            _Cell(*ends) for ends in zip(*(getattr(cells, name).tolist() for name in CELLS[1:]), strict=True)
        ]
        if first == 0 or last == len(picture.cells.low):
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
        kept = np.ones(len(picture.cells.low), dtype=np.bool_)
        kept[first:last] = False
        picture = joined(chosen(picture, kept), _picture_of(done))
    return picture


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
            return self.halvings >= HALVINGS
        return self.high - self.low < NARROW * self.high and self.halvings >= HALVINGS

    def halves(self) -> "tuple[_Cell, _Cell]":
        """Return both parts; next to a pole the nearer one is much the smaller."""
        low, high = self.low, self.high
        middle = high * min(1 / 16, high) if low == 0.0 else sqrt(low) * sqrt(high)
        middle = middle if low == 0.0 or high > 2.0 * low else 0.5 * (low + high)
        later = self.halvings + 1
        return replace(self, high=middle, halvings=later), replace(self, low=middle, halvings=later)


def _picture_of(done: list[_Cell]) -> Picture:
    bounds = [(-1, 0) if cell.bound is None else (cell.bound.order, cell.bound.sign) for cell in done]
    order, its_sign = (np.array(each, dtype=np.int64) for each in zip(*bounds, strict=True))
    nothing = np.zeros(len(done), dtype=np.bool_)
    hemisphere, low, high = (np.array([getattr(cell, name) for cell in done]) for name in CELLS[1:])
    found = Found(np.where(order == 0, its_sign, 0), np.where(order == 1, its_sign, 0), nothing, nothing)
    cells = Cells(np.zeros(len(done), dtype=np.int64), hemisphere, low, high)
    return Picture(cells, found, np.full(len(done), -1))
