"""Proves the signs of P on halves of many loops at once: of one formula and body, on curves of their own.

What a picture takes for one half is nearly all the handling of short arrays. Here the cells of all halves are
looked at together; each half has the picture of :mod:`.signs`, with the same cells.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from service.dynamics.reduction.sign_proofs.bounds_in_doubles import Bounds, Cells, Loops
from service.dynamics.reduction.sign_proofs.cells import Curves, Found, Half, look_at
from service.dynamics.reduction.sign_proofs.signs import (
    CELLS,
    FOUND,
    Picture,
    cells_to_cut,
    chosen,
    first_cells,
    joined,
    parts_of,
)

MOST_CUT = 256
"""Open cells of one half that are cut together with those of others: one with more has a picture alone."""


def pictures_together(halves: Sequence[Half], most_rounds: int) -> list[Picture | None]:
    """Return the refined picture of each half, all of one tape, body and shape; None where it has many cells.

    Whether a cell is open may depend, by the last bit of a bound, on what is looked at beside it; what is
    found of it holds all the same.
    """
    first = halves[0]
    Z, G = (_together([getattr(half.loops, name) for half in halves]) for name in "ZG")
    curves = Curves(first.tape, first.body, Loops(first.loops.shape, Z, G), first.turn)
    pictures: list[Picture | None] = list(_pictures(curves, [first_cells()] * len(halves), with_slope=False))
    waiting = list(range(len(halves)))
    for _ in range(most_rounds):
        cut: list[tuple[int, Picture, NDArray[np.bool_]]] = []
        for k in waiting:
            picture = pictures[k]
            assert picture is not None
            is_cut = cells_to_cut(picture)
            count = int(is_cut.sum())
            if count > MOST_CUT:
                pictures[k] = None
            elif count:
                cut.append((k, picture, is_cut))
        if not cut:
            break
        parts = [parts_of(picture.cells.at(is_cut)) for _, picture, is_cut in cut]
        waiting = [k for k, _, _ in cut]
        found = _pictures(curves, parts, with_slope=True, owners=waiting)
        for (k, picture, is_cut), part in zip(cut, found, strict=True):
            pictures[k] = joined(chosen(picture, ~is_cut), part)
    return pictures


def _together(bounds: Sequence[Bounds]) -> Bounds:
    low, high = zip(*bounds, strict=True)
    return np.concatenate(low), np.concatenate(high)


def _pictures(
    curves: Curves, cells: Sequence[Cells], *, with_slope: bool, owners: Sequence[int] | None = None
) -> list[Picture]:
    """Return what bounds say of the cells of each half; they are of the curves ``owners``, or of all."""
    counts = [len(each.low) for each in cells]
    owner = np.repeat(np.arange(len(cells)) if owners is None else np.array(owners, dtype=np.int64), counts)
    rest = (np.concatenate([getattr(each, name) for each in cells]) for name in CELLS[1:])
    found = look_at(curves, Cells(owner, *rest), with_slope=with_slope)
    pictures, start = [], 0
    for each, count in zip(cells, counts, strict=True):
        here = slice(start, start + count)
        part = Found(*(getattr(found, name)[here] for name in FOUND))
        pictures.append(Picture(each, part, np.full(count, -1)))
        start += count
    return pictures
