"""Proves, for many stretches of λ at once, on which cells of the curve p² has a sign."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import arb
from numpy.typing import NDArray

from service.dynamics.formula.algebras.intervals import IntervalAlgebra
from service.dynamics.formula.vanishing import vanishing_parts
from service.dynamics.reduction.sign_proofs.bounds_in_doubles import (
    CELL_MIN_RELATIVE_WIDTH,
    QUARTER_TURN,
    Cells,
    Loops,
    axes,
    heights,
    scales,
)
from service.dynamics.reduction.sign_proofs.cells import Curves, signs_on_cells
from service.dynamics.reduction.sign_proofs.infinities import limits_between
from service.dynamics.reduction.sign_proofs.signs import (
    CELLS,
    INFINITE,
    SignMap,
    cells_to_cut,
    chosen,
    first_cells,
    joined,
    parts_of,
)

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CUT_ROUNDS = 6
MAX_CELLS_CUT = 192
"""Open cells of one stretch of λ that are cut; if there are more, its halves are looked at instead."""

Signature = tuple[int, ...]
"""The signs of p² along a half curve from the north pole to the south pole, one for each stretch of one sign
(``UNDEFINED`` where p² has no value), with ``EQUATOR`` between the hemispheres and ``INFINITE`` between two
where p² is infinite."""
UNDEFINED, EQUATOR = 2, 9


def signs_in(signature: Signature) -> list[int]:
    """Return the signs alone, between which p² has a zero or is infinite."""
    return [sign for sign in signature if sign not in (EQUATOR, INFINITE)]


@dataclass(frozen=True, slots=True)
class Bracket:
    """A stretch of the half curve with one zero of p², or one infinity: between two distances from a pole."""

    hemisphere: int
    """The sign of g2."""
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Finest:
    """Relative widths below which cells are not cut, and how often they are cut."""

    anywhere: float = 0.0
    at_equator: float = 0.0
    """Width for the cell next to the equator, where a zero may cross it."""
    rounds: int = CUT_ROUNDS


def sign_maps_of(curves: Curves, starts: Sequence[SignMap | None], finest: Sequence[Finest]) -> list[SignMap]:
    """Return for each curve what bounds say, open cells being cut.

    A start is a sign map of curves among which this one is: what it settles stays settled.
    """
    found = _first(curves, starts)
    active = list(range(len(found)))
    for round_ in range(CUT_ROUNDS):
        # What is not cut stays as it is.
        cuts = {k: _cut(found[k], finest[k]) for k in active if round_ < finest[k].rounds}
        active = [k for k, cut in cuts.items() if 0 < np.count_nonzero(cut) <= MAX_CELLS_CUT]
        if not active:
            break
        parts = _together([parts_of(found[k].cells.at(cuts[k])) for k in active], active)
        answers = _split(
            SignMap(parts, signs_on_cells(curves, parts, with_slope=True), _no_zeros(parts)), active
        )
        for k in active:
            found[k] = joined(chosen(found[k], ~cuts[k]), answers[k])
    return found


def _cut(sign_map: SignMap, least: Finest) -> BoolArray:
    widths = _widths(sign_map.cells)
    is_cut: BoolArray = cells_to_cut(sign_map) & (widths > least.anywhere)
    return is_cut | (_open_at_equator(sign_map) & (widths > max(least.at_equator, CELL_MIN_RELATIVE_WIDTH)))


def _open_at_equator(sign_map: SignMap) -> BoolArray:
    """Tell which of the two cells next to the equator are without a sign."""
    is_open: BoolArray = (
        (sign_map.cells.high >= QUARTER_TURN) & ~sign_map.is_settled & (sign_map.most_zeros < 0)
    )
    return is_open


def _first(curves: Curves, starts: Sequence[SignMap | None]) -> list[SignMap]:
    """Return the first cells of curves without a start, and the open cells of the others looked at again."""
    found: list[SignMap | None] = list(starts)
    fresh = [k for k, start in enumerate(starts) if start is None]
    if fresh:
        cells = _together([first_cells()] * len(fresh), fresh)
        answers = _split(
            SignMap(cells, signs_on_cells(curves, cells, with_slope=False), _no_zeros(cells)), fresh
        )
        for k in fresh:
            found[k] = answers[k]
    again = {k: _open_cells(start) for k, start in enumerate(starts) if start is not None}
    again = {k: cells for k, cells in again.items() if cells.any()}
    if again:
        given = {k: start for k, start in enumerate(starts) if start is not None and k in again}
        cells = _together([start.cells.at(again[k]) for k, start in given.items()], list(given))
        answers = _split(
            SignMap(cells, signs_on_cells(curves, cells, with_slope=True), _no_zeros(cells)), list(given)
        )
        for k, start in given.items():
            found[k] = joined(chosen(start, ~again[k]), answers[k])
    return [sign_map for sign_map in found if sign_map is not None]


def _open_cells(sign_map: SignMap) -> BoolArray:
    """Tell which cells are without a sign in gaps that are not closed; none that :mod:`.turns` made."""
    is_open = np.zeros(len(sign_map.found.sign), dtype=np.bool_)
    for first, last in sign_map.open_gaps():
        is_open[first:last] = True
    return (is_open & (sign_map.most_zeros < 0)) | _open_at_equator(sign_map)


def _widths(cells: Cells) -> FloatArray:
    """Return the relative widths of cells; those at a pole are cut as if they were as wide as can be."""
    found: FloatArray = 1.0 - cells.low / cells.high
    return found


def _together(parts: Sequence[Cells], owners: Sequence[int]) -> Cells:
    """Return the cells of several curves, each with the number of its curve."""
    owner = np.repeat(np.array(owners), [len(part.low) for part in parts])
    rest = (np.concatenate([getattr(part, name) for part in parts]) for name in CELLS[1:])
    return Cells(owner, *rest)


def _no_zeros(cells: Cells) -> IntArray:
    return np.full(len(cells.low), -1)


def _split(whole: SignMap, owners: Sequence[int]) -> dict[int, SignMap]:
    return {k: chosen(whole, np.flatnonzero(whole.cells.owner == k)) for k in owners}


def with_infinities(curves: Curves, single: Loops, sign_maps: Sequence[SignMap]) -> list[SignMap]:
    """Return the sign maps with the gaps marked in which p² is proved to be infinite once, for every λ.

    On both sides of it p² has the sign that it has beside the gap. ``single`` are loops of one λ of each.
    """
    found = list(sign_maps)
    if not vanishing_parts(curves.tape):
        return found
    for k, sign_map in enumerate(sign_maps):
        most = sign_map.most_zeros.copy()
        for first, last in sign_map.open_gaps():
            if first == 0 or last == len(most) or sign_map.is_infinite((first, last)):
                continue
            beside = int(sign_map.found.sign[first - 1]), int(sign_map.found.sign[last])
            if (
                0 not in beside
                and _limits_in(curves, single, k, sign_map.cells.at(slice(first, last))) == beside
            ):
                most[first:last] = INFINITE
        found[k] = replace(sign_map, most_zeros=most)
    return found


def _limits_in(curves: Curves, single: Loops, owner: int, gap: Cells) -> tuple[int, int] | None:
    """Return the signs of p² on both sides of where it is infinite in a gap of the curves ``owner``."""
    side, loops = float(gap.hemisphere[0]), curves.loops
    if (gap.hemisphere != side).any():
        return None
    # Cells that were known before have the number of other curves.
    cells = replace(gap, owner=np.full(len(gap.low), owner))
    algebra = IntervalAlgebra(scales(loops, cells))
    primed = [algebra.bounds(axis) for axis in axes(algebra, loops, cells)]
    third, first_axis = (primed[0], primed[1]) if loops.shape.is_mirrored else (primed[1], primed[0])
    box = [
        arb(float(low.min())).union(arb(float(high.max())))
        for low, high in (first_axis, heights(loops, cells), third)
    ]
    # Where the gap ends p² is bounded for every λ: what vanishes inside has one sign there.
    near, far = float(cells.low.min()), float(cells.high.max())
    x = np.array([near, far] if side > 0.0 else [far, near])
    low, high = heights(single, Cells(np.full(2, owner), np.full(2, side), x, x))
    ends = [arb(float(one)).union(arb(float(other))) for one, other in zip(low, high, strict=True)]
    return limits_between(curves, box, (ends[0], ends[1]))


def compact(sign_map: SignMap) -> SignMap:
    """Return the sign map with neighbouring cells joined on which the same is proved."""
    settled, hemisphere = sign_map.is_settled, sign_map.cells.hemisphere
    labels = np.where(sign_map.found.is_undefined, UNDEFINED, sign_map.found.sign)
    is_more = settled[1:] & settled[:-1] & (labels[1:] == labels[:-1]) & (hemisphere[1:] == hemisphere[:-1])
    starts = np.concatenate([[0], np.flatnonzero(~is_more) + 1])
    first = chosen(sign_map, starts)
    low, high = (
        np.minimum.reduceat(sign_map.cells.low, starts),
        np.maximum.reduceat(sign_map.cells.high, starts),
    )
    return replace(first, cells=replace(first.cells, low=low, high=high))


def signature_of(sign_map: SignMap) -> Signature | None:
    """Return the signs along the half curve if they are proved, the same for every λ of the stretch, or None.

    Then p² has one simple zero between two signs, or is infinite at one place, and has no other zero, for
    every λ; none at the equator or a pole.
    """
    is_settled, is_infinite = sign_map.is_settled, sign_map.most_zeros == INFINITE
    north = sign_map.cells.hemisphere > 0.0
    border = int(np.count_nonzero(north))
    at_ends = (0, border - 1, border, len(is_settled) - 1)
    if not all(is_settled[k] for k in at_ends) or not all(map(sign_map.is_infinite, sign_map.open_gaps())):
        return None
    labels = np.where(sign_map.found.is_undefined, UNDEFINED, sign_map.found.sign)
    # A change without a stretch of growth or fall between is a jump, or the edge of where p² has a value; in
    # a gap at such an edge nothing is proved by a slope.
    jumps = (labels[1:] != labels[:-1]) & is_settled[1:] & is_settled[:-1]
    if jumps.any() or any(UNDEFINED in (labels[first - 1], labels[last]) for first, last in sign_map.gaps()):
        return None
    labels = np.where(is_infinite, INFINITE, labels)
    parts = [labels[part & (is_settled | is_infinite)] for part in (north, ~north)]
    runs = [part[np.flatnonzero(np.diff(part, prepend=0))].tolist() for part in parts]
    return (*runs[0], EQUATOR, *runs[1])


def brackets_of(sign_map: SignMap) -> list[Bracket]:
    """Return the stretches of a settled sign map with one zero, or infinity, each, from north to south."""
    found = []
    cells = sign_map.cells
    for first, last in sign_map.gaps():
        changes = sign_map.found.sign[first - 1] != sign_map.found.sign[last]
        if changes or sign_map.is_infinite((first, last)):
            here = slice(first, last)
            found.append(
                Bracket(
                    int(cells.hemisphere[first]), float(cells.low[here].min()), float(cells.high[here].max())
                )
            )
    return found
