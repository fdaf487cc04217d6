"""Computes a chunk of a sweep, and returns its points in columns.

Points that no block can do are computed one by one, by the functions of a single job.
"""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from service.dynamics.problem import PlanarMotion
from service.jobs.kernels import NeedsKernelsError
from service.jobs.records import ChunkOutcome, Refused, SolveOutcome
from service.local.workers import own_host
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError
from service.schemas.sweep.sweep import FEW, Sweep, kept_numbers, trusted_sweep
from service.storage.codecs.packing import SOLVED, ChunkPoints, chunk_outcome, decode_arrays
from service.verdicts.cached import ResultCache
from workers.computation.compiled_code import GROUPS, keep_compiled_code, way_for
from workers.computation.compute import solve_checked, solve_document
from workers.computation.summary import provenance
from workers.solvers.ways import NotReadyError, Way, on_way
from workers.sweeping.plan import OWN_PLAN_POINTS, Plan, make_plan, outer_axes, plan_judged

if TYPE_CHECKING:
    from workers.sweeping.planar.doubles import SolvedBlock
    from workers.sweeping.rows import RowSolver
    from workers.sweeping.states import StateSolver

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """The kept numbers and the outcome of one point."""

    outcome: str
    """``solved``, or the code of its error."""
    numbers: Sequence[float]
    """NaN for missing numbers."""
    series: Mapping[str, FloatArray]
    """Empty for a point that was not solved."""


def solve_point(
    sweep: Sweep,
    index: int,
    *,
    is_judged: bool,
    way: Way,
    waits: bool = False,
    cache: ResultCache | None = None,
) -> SweepPoint:
    """Solve the point like its job of that way; with ``is_judged`` its potential is known to be admissible.

    Then only the verdict is skipped: other refusals that precede a job are
    raised by the job itself. Else the verdict may be in ``cache``, or is put there.

    Raises
    ------
    NeedsKernelsError
        A plain way that ``waits`` for kernels refuses the point.
    """
    document = json.dumps(sweep.document(index))
    try:
        outcome = (
            solve_document(document, way=way, waits=waits, read=read_problem)
            if is_judged
            else solve_checked(document, explains=False, cache=cache, way=way, waits=waits)
        )
    except InvalidProblemError:
        return _refused(sweep, "invalid_problem")
    return _kept(sweep, outcome)


def _kept(sweep: Sweep, outcome: SolveOutcome) -> SweepPoint:
    if isinstance(outcome, Refused):
        return _refused(sweep, str(outcome.error["code"]))
    columns = decode_arrays(outcome.samples) if sweep.series_columns else {}
    series = {name: columns[name] for name in sweep.series_columns}
    return SweepPoint(SOLVED, kept_numbers(outcome.summary, sweep.keep), series)


def _refused(sweep: Sweep, code: str) -> SweepPoint:
    return SweepPoint(code, [np.nan] * len(sweep.keep), {})


MOST_CHUNK_SECONDS = 2.0
"""Seconds after which a chunk ends with the points it has."""
BLOCK_POINTS = 256
MOST_CACHED_VERDICTS = 1000
"""Number of verdicts of points solved one by one, after which all are forgotten."""
MOST_SERIES_NUMBERS = 400_000
"""Numbers of a block's series at most."""

_NOTHING = np.empty(0)


def compute_chunk(document_json: str) -> ChunkOutcome:
    """Solve ``count`` points of a sweep from ``first`` on, or as many of them as time allows.

    The document is ``{"sweep": …, "first": …, "count": …, "way": …, "waits": …}``; without a way it is the
    compiled one if its kernels are ready. On a plain way that ``waits`` no refusal of a solver is final. The
    numbers and samples of a point are, to the last bit, those of the job of
    ``sweep.document(index)`` on that way, and its outcome is how that job would end, also
    by what is refused before there is a job. :func:`.plan.make_plan` says which
    sweeps are solved in blocks by compiled code; the others, and the points it
    does not decide, go one by one. So do all on the plain way.

    Raises
    ------
    NeedsKernelsError
        The way is that of kernels, and they are not ready; or it waits for them.
    """
    began = time.perf_counter()
    document = json.loads(document_json)
    sweep = json.dumps(document["sweep"])
    way: Way = document.get("way") or way_for(*GROUPS)
    try:
        with on_way(way):
            solver = _solver_of(sweep, way, waits=document.get("waits") is True)
            points = solver.solve(document["first"], document["count"], began + MOST_CHUNK_SECONDS)
            source = {"host": own_host(), **provenance()}
    except NotReadyError as fault:
        raise NeedsKernelsError from fault
    return chunk_outcome(points, time.perf_counter() - began, source)


class ChunkSolver:
    """Solves chunks of one sweep on one way; a plain one may wait for kernels: see :func:`compute_chunk`."""

    def __init__(self, plan: Plan, way: Way = "compiled", *, waits: bool = False) -> None:
        self._plan, self._way, self._waits = plan, way, waits
        self._blocks: RowSolver | StateSolver | None = None
        self._slices: RowSolver | None = None
        if way == "compiled":
            self._begin_blocks(plan)
        self._compared = set[str]()
        self._verdicts, self._judged = ResultCache({}), 0

    def _begin_blocks(self, plan: Plan) -> None:
        """Choose what solves blocks of points; the compiler is loaded only where it is needed."""
        if plan.states:
            keep_compiled_code()
            from workers.sweeping import states  # noqa: PLC0415

            self._blocks = states.StateSolver(plan.sweep)
            return
        rows, outer = plan.rows, None
        if rows is None and _may_be_cut(plan):
            rows = plan_judged(plan.sweep)
            outer = outer_axes(plan.sweep, 1 if rows is None else OWN_PLAN_POINTS)
        if rows is None and outer is None:
            return
        keep_compiled_code()
        from workers.sweeping.rows import RowSolver  # noqa: PLC0415

        if outer is None:
            self._blocks = RowSolver(plan.sweep, rows)
        else:
            self._blocks = self._slices = RowSolver(plan.sweep, None, outer)

    def solve(self, first: int, count: int, until: float) -> ChunkPoints:
        """Solve points in turn until ``time.perf_counter()`` is ``until``, at least one."""
        chunk = _Chunk(self._plan.sweep, count)
        while chunk.count < count and (not chunk.count or time.perf_counter() < until):
            start = first + chunk.count
            size = min(self._block_points, count - chunk.count)
            if self._slices is not None:
                size = self._slices.points_together(start, size)
            if not self._solve_block(chunk, start, size, until):
                break
        return chunk.points()

    @property
    def _block_points(self) -> int:
        sweep = self._plan.sweep
        if self._blocks is None:
            return 1
        numbers_of_point = max(sweep.samples * len(sweep.series_columns), 1)
        return max(1, min(BLOCK_POINTS, MOST_SERIES_NUMBERS // numbers_of_point))

    def _solve_block(self, chunk: "_Chunk", first: int, count: int, until: float) -> bool:
        """Add a block to the results; False if time was up before its end."""
        open_points = np.ones(count, dtype=np.bool_)
        block = None if self._blocks is None else self._checked(self._blocks.solve(first, count), first)
        if block is not None:
            chunk.add_block(block, count)
            open_points = block.is_open
        for index in np.flatnonzero(open_points).tolist():
            if (chunk.count or index) and time.perf_counter() >= until:
                chunk.count += index
                return False
            chunk.set_point(chunk.count + index, self._alone(first + index))
        chunk.count += count
        return True

    def _checked(self, block: "SolvedBlock", first: int) -> "SolvedBlock | None":
        """Compare the first point that was solved, and the first of each refusal, with single jobs.

        Return None, for this block and all later ones, if they differ.
        """
        for outcome, points in ((SOLVED, block.solved), *block.refused.items()):
            if outcome in self._compared or not points.any():
                continue
            index = int(np.flatnonzero(points)[0])
            if not self._is_the_same(block, index, outcome, self._alone(first + index)):
                self._blocks = None
                return None
            self._compared.add(outcome)
        return block

    def _is_the_same(self, block: "SolvedBlock", index: int, outcome: str, alone: SweepPoint) -> bool:
        if alone.outcome != outcome or outcome != SOLVED:
            return alone.outcome == outcome
        return all(
            np.array_equal(block.numbers[name][index], number, equal_nan=True)
            for name, number in zip(self._plan.sweep.keep, alone.numbers, strict=True)
        ) and all(np.array_equal(rows[index], alone.series[name]) for name, rows in block.series.items())

    def _alone(self, index: int) -> SweepPoint:
        is_judged = self._plan.is_judged or (self._slices is not None and self._slices.is_judged(index))
        if not self._judged % MOST_CACHED_VERDICTS:
            self._verdicts = ResultCache({})
        self._judged += 1
        return solve_point(
            self._plan.sweep,
            index,
            is_judged=is_judged,
            way=self._way,
            waits=self._waits,
            cache=self._verdicts,
        )


def _may_be_cut(plan: Plan) -> bool:
    """Tell whether parts of a sweep may go in blocks where all of it may not."""
    is_planar = isinstance(plan.sweep.first_problem.motion, PlanarMotion)
    return is_planar and (not plan.is_judged or any(axis.path in FEW for axis in plan.sweep.axes))


class _Chunk:
    """The columns of a chunk, filled in from the first point on."""

    def __init__(self, sweep: Sweep, size: int) -> None:
        self.count = 0
        self._outcomes = [SOLVED] * size
        self._numbers = {name: np.full(size, np.nan) for name in sweep.keep}
        self._series = {name: np.full((size, sweep.samples), np.nan) for name in sweep.series_columns}

    def add_block(self, block: "SolvedBlock", count: int) -> None:
        """Set the columns of the next ``count`` points; undecided ones are solved one by one."""
        here = slice(self.count, self.count + count)
        for name, column in block.numbers.items():
            self._numbers[name][here] = np.where(block.solved, column, np.nan)
        for name, rows in block.series.items():
            self._series[name][here] = np.where(block.solved[:, None], rows, np.nan)
        for code, points in block.refused.items():
            for index in np.flatnonzero(points).tolist():
                self._outcomes[self.count + index] = code

    def set_point(self, index: int, point: SweepPoint) -> None:
        """Set the columns of one point."""
        self._outcomes[index] = point.outcome
        for name, number in zip(self._numbers, point.numbers, strict=True):
            self._numbers[name][index] = number
        for name, row in self._series.items():
            samples = point.series.get(name, _NOTHING)
            # A motion that ends has only the samples before.
            row[index, : len(samples)], row[index, len(samples) :] = samples, np.nan

    def points(self) -> ChunkPoints:
        """Return the columns filled so far."""
        return ChunkPoints(
            self._outcomes[: self.count],
            {name: column[: self.count] for name, column in self._numbers.items()},
            {name: rows[: self.count] for name, rows in self._series.items()},
        )


@lru_cache(maxsize=8)
def _solver_of(sweep_json: str, way: Way, *, waits: bool) -> ChunkSolver:
    # Proofs and programs are the same for all chunks of a sweep.
    return ChunkSolver(make_plan(trusted_sweep(json.loads(sweep_json))), way, waits=waits)
