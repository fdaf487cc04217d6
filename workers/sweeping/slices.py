"""Cuts a sweep over the body, or over numbers in which the potential is not linear, into sweeps that are not.

All points with the same A, C or exponent make a slice: a sweep over the other axes with a verdict of its own,
whose points go in blocks. A point of a slice is the point of the whole sweep, and has the same document.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.exact import exact_number
from service.dynamics.sweep_axes import ListedAxis
from service.schemas.problem.problem import read_problem
from service.schemas.reading.faults import InvalidProblemError
from service.schemas.reading.pointers import with_values
from service.schemas.sweep.sweep import Sweep, SweepAxis, json_number
from workers.sweeping.block import BlockSolver
from workers.sweeping.plan import make_plan
from workers.sweeping.solved import SolvedBlock

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

KEPT_SLICES = 512
"""Plans at hand, for sweeps whose slices take turns."""
NEW_SLICES = 8
"""Of one block: each needs a verdict, and a block ends before the time of its chunk does."""


@dataclass(frozen=True, slots=True)
class _Slice:
    """The points with the same numbers on the outer axes."""

    is_judged: bool
    """Its potentials are proved to be admissible."""
    blocks: BlockSolver | None
    """None if its points go one by one."""


class SlicedSolver:
    """Solves blocks of one sweep slice by slice; a slice without a plan is left to single jobs."""

    def __init__(self, sweep: Sweep, outer: Sequence[int]) -> None:
        self._sweep = sweep
        self._outer = tuple(outer)
        self._inner = tuple(k for k in range(len(sweep.axes)) if k not in self._outer)
        self._lengths = tuple(each.axis.length for each in sweep.axes)
        self._slices: dict[tuple[int, ...], _Slice] = {}

    def points_together(self, first: int, most: int) -> int:
        """Return how many points from ``first`` on, at most ``most``, have not too many new slices."""
        new = [here[0] for outer, here, _ in self._parts(first, most) if outer not in self._slices]
        return most if len(new) <= NEW_SLICES else int(new[NEW_SLICES])

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        sweep = self._sweep
        solved, refused = np.zeros(count, dtype=np.bool_), dict[str, BoolArray]()
        numbers = {name: np.full(count, np.nan) for name in sweep.keep}
        series = {name: np.full((count, sweep.samples), np.nan) for name in sweep.series_columns}
        for outer, here, begin in self._parts(first, count):
            blocks = self._slice(outer).blocks
            if blocks is None:
                continue
            # In the order of a grid the points of one slice follow each other.
            block = blocks.solve(begin, len(here))
            solved[here] = block.solved
            for code, points in block.refused.items():
                refused.setdefault(code, np.zeros(count, dtype=np.bool_))[here] = points
            for name, column in block.numbers.items():
                numbers[name][here] = column
            for name, rows in block.series.items():
                series[name][here] = rows
        return SolvedBlock(solved, refused, numbers, series)

    def is_judged(self, index: int) -> bool:
        """Tell whether the potential at a point is proved to be admissible."""
        ((outer, _, _),) = self._parts(index, 1)
        return self._slice(outer).is_judged

    def _parts(self, first: int, count: int) -> list[tuple[tuple[int, ...], IntArray, int]]:
        """Return the slices of neighbouring points: their places on the outer axes, points, first indices."""
        at = np.unravel_index(np.arange(first, first + count), self._lengths)
        shape = tuple(self._lengths[k] for k in self._inner)
        inner = np.ravel_multi_index([at[k] for k in self._inner], shape) if shape else np.zeros(count, int)
        parts: dict[tuple[int, ...], list[int]] = {}
        for place, outer in enumerate(zip(*(at[k].tolist() for k in self._outer), strict=True)):
            parts.setdefault(outer, []).append(place)
        return [(outer, np.array(here), int(inner[here[0]])) for outer, here in parts.items()]

    def _slice(self, outer: tuple[int, ...]) -> _Slice:
        found = self._slices.get(outer)
        if found is None:
            if len(self._slices) >= KEPT_SLICES:
                self._slices.clear()
            found = self._slices[outer] = self._make_slice(outer)
        return found

    def _make_slice(self, outer: tuple[int, ...]) -> _Slice:
        sweep = slice_of(self._sweep, self._outer, outer)
        plan = None if sweep is None else make_plan(sweep)
        if plan is None:
            return _Slice(is_judged=False, blocks=None)
        blocks = None if plan.quick is None else BlockSolver(plan.sweep, plan.quick)
        return _Slice(plan.is_judged, blocks)


def outer_axes(sweep: Sweep, least: int = 1) -> tuple[int, ...] | None:
    """Return the axes whose numbers slices have in common; None if no slice would go in blocks.

    Nor are there any if a slice has fewer than ``least`` points.

    They are those of the body, and those of the potential too if it takes that.
    """
    if sweep.combine != "grid":
        return None
    of_body = tuple(k for k, each in enumerate(sweep.axes) if each.path[0] == "body" and each.path[1] != "B")
    others = tuple(k for k, each in enumerate(sweep.axes) if each.path[0] in ("body", "potential"))
    for outer in dict.fromkeys((of_body, others)):
        if math.prod(each.axis.length for k, each in enumerate(sweep.axes) if k not in outer) < least:
            continue
        first = slice_of(sweep, outer, (0,) * len(outer)) if outer else None
        if first is not None and make_plan(first).quick is not None:
            return outer
    return None


def slice_of(sweep: Sweep, outer: Sequence[int], at: Sequence[int]) -> Sweep | None:
    """Return the points at these places on the ``outer`` axes; None if the first of them is no problem."""
    fixed = {
        sweep.axes[k].path: json_number(sweep.axes[k].axis.value(n)) for k, n in zip(outer, at, strict=True)
    }
    base = with_values(dict(sweep.base), dict(fixed))
    assert isinstance(base, dict)
    axes = tuple(each for k, each in enumerate(sweep.axes) if k not in outer)
    if not axes:
        curve = _own_curve(base)
        if curve is None:
            return None
        axes = (curve,)
    found = replace(sweep, base=base, axes=axes)
    try:
        return replace(found, first_problem=read_problem(found.document(0)))
    except (DynamicsError, InvalidProblemError):
        return None


def _own_curve(base: Mapping[str, object]) -> SweepAxis | None:
    """Return an axis with the one value that λ or nu has, for a slice of a single point."""
    motion = base["motion"]
    assert isinstance(motion, dict)
    for name in ("lambda", "nu"):
        if name in motion:
            return SweepAxis(f"/motion/{name}", ("motion", name), ListedAxis((exact_number(motion[name]),)))
    return None
