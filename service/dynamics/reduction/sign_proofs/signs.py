r"""Proves the sign of P on a whole half of a loop, by cells that cover it from pole to pole.

Every cell has a certain sign by bounds of D, or P is monotone on it by bounds of X D
(:mod:`.slopes`), or it is open and is cut. A stretch of cells without a sign, between two that have one,
on which P grows all over or falls all over, is closed: it has one zero if the signs differ, and none else.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    CELL_MIN_RELATIVE_WIDTH,
    QUARTER_TURN,
    Cells,
)
from service.dynamics.reduction.sign_proofs.cells import CellSigns, Half, signs_on_cells

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
