"""Cuts a sweep over windows, bodies, or numbers in which no potential is linear, into sweeps that are not.

All points with the same window, A, C or exponent make a slice: a sweep over the other axes with a verdict of
its own, whose points go in blocks. A point of a slice is the point of the whole sweep, and has its document.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.errors import DynamicsError
from service.dynamics.exact import exact_number
from service.dynamics.sweep_axes import ListedAxis
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError, Part, with_values
from service.schemas.sweep.sweep import FEW, Sweep, SweepAxis, json_number
from workers.sweeping.plan import make_plan
from workers.sweeping.planar.block import BlockSolver
from workers.sweeping.planar.records import FoundPoints, SolvedBlock

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


_Numbers = tuple[Fraction, ...]
MOST_CACHED_NUMBERS = 100_000
MOST_CACHED_PLANS = 512
"""Plans at hand, for sweeps whose slices take turns."""
NEW_SLICES_PER_BLOCK = 8
"""New slices of one block at most: each needs a verdict, and a block ends before the time of its chunk
does."""


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
        self._slices: dict[_Numbers, _Slice] = {}
        self._known: list[dict[int, Fraction]] = [{} for _ in self._outer]

    def points_together(self, first: int, most: int) -> int:
        """Return how many points from ``first`` on, at most ``most``, have not too many new slices."""
        new = [here[0] for outer, here, _ in self._parts(first, most) if outer not in self._slices]
        return most if len(new) <= NEW_SLICES_PER_BLOCK else int(new[NEW_SLICES_PER_BLOCK])

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        results = FoundPoints(self._sweep, (), count)
        for outer, here, inner in self._parts(first, count):
            blocks = self._slice(outer).blocks
            if blocks is None:
                continue
            block = blocks.solve_some(inner)
            results.solved[here] = block.solved
            for code, points in block.refused.items():
                results.refuse(code, here[points])
            for name, column in block.numbers.items():
                results.numbers[name][here] = column
            for name, rows in block.series.items():
                results.series[name][here] = rows
        return results.block()

    def is_judged(self, index: int) -> bool:
        """Tell whether the potential at a point is proved to be admissible."""
        ((outer, _, _),) = self._parts(index, 1)
        return self._slice(outer).is_judged

    def _parts(self, first: int, count: int) -> list[tuple[_Numbers, IntArray, IntArray]]:
        """Return the slices of neighbouring points: outer numbers, points, and their indices in the slice."""
        indices = np.arange(first, first + count)
        at = [indices] * len(self._lengths)
        inner = indices if self._inner else 0 * indices
        if self._sweep.combine == "grid":
            at = list(np.unravel_index(indices, self._lengths))
            shape = tuple(self._lengths[k] for k in self._inner)
            inner = np.ravel_multi_index([at[k] for k in self._inner], shape) if shape else 0 * indices
        parts: dict[_Numbers, list[int]] = {}
        for index, outer in enumerate(zip(*(at[k].tolist() for k in self._outer), strict=True)):
            parts.setdefault(self._numbers(outer), []).append(index)
        return [(outer, np.array(here), inner[here]) for outer, here in parts.items()]

    def _numbers(self, outer: Sequence[int]) -> _Numbers:
        """Return the numbers at these positions on the outer axes."""
        for known, axis, index in zip(self._known, self._outer, outer, strict=True):
            if index not in known:
                if len(known) >= MOST_CACHED_NUMBERS:
                    known.clear()
                known[index] = self._sweep.axes[axis].axis.value(index)
        return tuple(known[index] for known, index in zip(self._known, outer, strict=True))

    def _slice(self, outer: _Numbers) -> _Slice:
        found = self._slices.get(outer)
        if found is None:
            if len(self._slices) >= MOST_CACHED_PLANS:
                self._slices.clear()
            found = self._slices[outer] = self._make_slice(outer)
        return found

    def _make_slice(self, outer: _Numbers) -> _Slice:
        sweep = slice_of(self._sweep, self._outer, outer)
        plan = None if sweep is None else make_plan(sweep)
        if plan is None:
            return _Slice(is_judged=False, blocks=None)
        blocks = None if plan.compiled is None else BlockSolver(plan.sweep, plan.compiled)
        return _Slice(plan.is_judged, blocks)


def outer_axes(sweep: Sweep, least: int = 1) -> tuple[int, ...] | None:
    """Return the axes whose numbers slices have in common; None if no slice would go in blocks.

    They are those of windows and signs, which have few values, those of the body, and those of the potential
    too if it takes that: but not those where a slice of a grid has fewer than ``least`` points.
    """
    few = tuple(k for k, each in enumerate(sweep.axes) if each.path in FEW)
    is_grid = sweep.combine == "grid"
    of_body = tuple(k for k, each in enumerate(sweep.axes) if each.path[0] == "body" and each.path[1] != "B")
    others = tuple(k for k, each in enumerate(sweep.axes) if each.path[0] in ("body", "potential"))
    for more in dict.fromkeys(((), of_body, others) if is_grid else ((),)):
        outer = (*few, *more)
        if (
            more
            and math.prod(each.axis.length for k, each in enumerate(sweep.axes) if k not in outer) < least
        ):
            continue
        first = slice_of(sweep, outer, [sweep.axes[k].axis.value(0) for k in outer]) if outer else None
        if first is not None and make_plan(first).compiled is not None:
            return outer
    return None


def slice_of(sweep: Sweep, outer: Sequence[int], numbers: Sequence[Fraction]) -> Sweep | None:
    """Return the points with these numbers on the ``outer`` axes; None if the first of them is no problem."""
    fixed = {sweep.axes[k].path: json_number(number) for k, number in zip(outer, numbers, strict=True)}
    base = with_values(sweep.base, dict(fixed))
    axes = tuple(each for k, each in enumerate(sweep.axes) if k not in outer)
    combine = sweep.combine
    if not axes:
        curve = _own_curve(base)
        if curve is None:
            return None
        # It has one point, which stands for all of them.
        axes, combine = (curve,), "grid"
    inner = replace(sweep, base=base, axes=axes, combine=combine)
    try:
        return replace(inner, first_problem=read_problem(inner.document(0)))
    except (DynamicsError, InvalidProblemError):
        return None


def _own_curve(base: Part) -> SweepAxis | None:
    """Return an axis with the one value that λ or nu has, for a slice of a single point."""
    motion = base["motion"]
    for name in ("lambda", "nu"):
        if isinstance(motion, dict) and name in motion:
            return SweepAxis(f"/motion/{name}", ("motion", name), ListedAxis((exact_number(motion[name]),)))
    return None
