"""Solves blocks of planar motions in compiled doubles with bounds; doubtful points are left out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.accuracy import keeps
from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.motion import COLUMNS, group_errors
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Times
from service.schemas.sweep.sweep import Sweep
from workers.solvers.compiled.motion import ALL
from workers.solvers.compiled.solve import Tier
from workers.solvers.units import Units
from workers.sweeping.parameters.points import (
    ListedNumbers,
    SweptPoints,
    are_numbers,
    curves_of,
    listed_exactly,
    times_of,
)
from workers.sweeping.parameters.templates import Group
from workers.sweeping.plan import plan_of_slice
from workers.sweeping.planar.doubles import NO_MOTION, BlockResult, FoundPoints, Sampling, SolvedBlock
from workers.sweeping.planar.exclusions import keep_their_sign
from workers.sweeping.planar.outputs import OUTPUTS, KeptIntegrals, KeptOutputs
from workers.sweeping.planar.potentials import FamilyOfBlock, JudgedOfBlock, Request, RowPlan, Side

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

MOST_CACHED_NUMBERS = 100_000
MOST_CACHED_PLANS = 512
"""Plans at hand, for sweeps whose slices take turns."""
SURE_ROUNDING = 2.0**-54
"""Share of ω below which no solver in doubles claims an error: a quarter of the distance of neighbours."""
NEW_SLICES_PER_BLOCK = 8
"""New slices of one block at most: each needs a verdict, and a block ends before the time of its chunk
does."""

_Numbers = tuple[Fraction, ...]


class RowSolver:
    """Solves blocks of one sweep; points with the same numbers on its ``outer`` axes share a plan.

    Without such axes that is the plan of all. A slice without a plan is left to single jobs.
    """

    def __init__(self, sweep: Sweep, plan: RowPlan | None, outer: Sequence[int] = ()) -> None:
        self._sweep, self._outer = sweep, tuple(outer)
        self._lengths = tuple(each.axis.length for each in sweep.axes)
        self._listed = [listed_exactly(axis) for axis in sweep.axes]
        self._numbers: list[dict[int, Fraction]] = [{} for _ in self._outer]
        self._slices: dict[_Numbers, _Slice] = {}
        if plan is not None:
            self._slices[()] = _Slice(is_judged=False, rows=PlanarRows(sweep, plan, self._listed))

    def points_together(self, first: int, most: int) -> int:
        """Return how many points from ``first`` on, at most ``most``, have not too many new slices."""
        new = [here[0] for outer, here in self._sliced(first, most) if outer not in self._slices]
        return most if len(new) <= NEW_SLICES_PER_BLOCK else int(new[NEW_SLICES_PER_BLOCK])

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        slices = [(self._slice(outer).rows, here) for outer, here in self._sliced(first, count)]
        if len(slices) == 1 and slices[0][0] is not None:
            return slices[0][0].solve(first + slices[0][1])
        results = FoundPoints(self._sweep, count)
        for rows, here in slices:
            if rows is not None:
                results.put(here, rows.solve(first + here))
        return results.block()

    def is_judged(self, index: int) -> bool:
        """Tell whether the potential at a point is proved to be admissible with those of its slice."""
        ((outer, _),) = self._sliced(index, 1)
        return self._slice(outer).is_judged

    def _sliced(self, first: int, count: int) -> list[tuple[_Numbers, IntArray]]:
        """Return the slices of neighbouring points: numbers on the outer axes, and the points."""
        indices = np.arange(first, first + count)
        if not self._outer:
            return [((), indices - first)]
        at = [indices] * len(self._lengths)
        if self._sweep.combine == "grid":
            at = list(np.unravel_index(indices, self._lengths))
        slices: dict[_Numbers, list[int]] = {}
        for index, outer in enumerate(zip(*(at[k].tolist() for k in self._outer), strict=True)):
            slices.setdefault(self._numbers_at(outer), []).append(index)
        return [(outer, np.array(here)) for outer, here in slices.items()]

    def _numbers_at(self, outer: Sequence[int]) -> _Numbers:
        """Return the numbers at these positions on the outer axes."""
        for known, axis, index in zip(self._numbers, self._outer, outer, strict=True):
            if index not in known:
                if len(known) >= MOST_CACHED_NUMBERS:
                    known.clear()
                known[index] = self._sweep.axes[axis].axis.value(index)
        return tuple(known[index] for known, index in zip(self._numbers, outer, strict=True))

    def _slice(self, outer: _Numbers) -> "_Slice":
        found = self._slices.get(outer)
        if found is None:
            if len(self._slices) >= MOST_CACHED_PLANS:
                self._slices.clear()
            plan = plan_of_slice(self._sweep, self._outer, outer)
            rows = None
            if plan is not None and plan.rows is not None:
                rows = PlanarRows(self._sweep, plan.rows, self._listed)
            found = self._slices[outer] = _Slice(plan is not None and plan.is_judged, rows)
        return found


@dataclass(frozen=True, slots=True)
class _Slice:
    """The points with the same numbers on the outer axes."""

    is_judged: bool
    """Its potentials are proved to be admissible."""
    rows: "PlanarRows | None"
    """None if its points go one by one."""


class PlanarRows:
    """Solves points that share a plan; each row of a block is a point."""

    def __init__(self, sweep: Sweep, plan: RowPlan, listed: ListedNumbers) -> None:
        """Take the sweep, the plan, and what is listed on each of its axes."""
        self._sweep, self._plan, self._listed = sweep, plan, listed
        problem = plan.problem
        names = [name for name in sweep.series_columns if name != "t"]
        self._integrals = KeptIntegrals(problem.body, sweep.keep)
        self._outputs = KeptOutputs(problem)
        columns = ALL if self._integrals.names else np.array(list(map(COLUMNS.index, names)), dtype=np.int64)
        self._sampling = Sampling(problem.time, columns, problem.wants_series)
        self._keeps_energy = any("energy" in name for name in sweep.keep)

    def solve(self, indices: IntArray) -> SolvedBlock:
        """Solve the points of the sweep with these indices."""
        plan, has_rests = self._plan, self._plan.tier == "high" or self._integrals.keeps_drifts
        points = SweptPoints(self._sweep, self._listed, indices)
        results, potentials = FoundPoints(self._sweep, len(indices)), plan.potentials.at(points)
        sign, side = next(iter(plan.sides.items()))
        squares, signs = curves_of(points, plan.curve_axis, sign, side.motion)
        usable = are_numbers(points.doubles.T) & potentials.usable
        times = times_of(points, plan.time_axes, plan.problem.time)
        usable &= np.array([each is not None for each in times])
        if plan.moment_axis is not None:
            usable &= points.have_moment(plan.problem.body, plan.moment_axis)
        for sign, side in plan.sides.items():
            is_here = usable & (signs == sign)
            if plan.start_axis is not None:
                is_here &= np.sign(points.doubles[plan.start_axis]) == sign
            for group in potentials.groups(np.flatnonzero(is_here), has_rests=has_rests):
                chosen = [squares[index] for index in group.indices.tolist()]
                self._solve_group(results, _Here(points, potentials, side, chosen, times), group)
        for code, members in potentials.refused().items():
            results.refuse(code, np.array(members, dtype=np.int64))
        return results.block()

    def _solve_group(self, results: FoundPoints, here: "_Here", group: Group) -> None:
        """Solve in the client's units, and what needs units of its own in these."""
        accuracy = self._plan.problem.accuracy
        if accuracy.measure == "relative":
            own = self._speeds(here, group)
            self._refuse_empty(results, here, group, np.flatnonzero(np.isnan(own)))
        else:
            missed = self._solve_in(results, here, group, Units())
            own = np.zeros(len(group.indices))
            if accuracy.measure == "above 1" and missed.any():
                # Who misses a tier may keep it by another solver of a job, unless no double does.
                speeds = self._speeds(here, group)
                beyond = missed & (speeds * SURE_ROUNDING > accuracy.tolerance)
                own[beyond] = speeds[beyond]
        if self._outputs.are_any:
            return
        units = [
            Units.of(speed, here.potentials.body(index))
            for index, speed in zip(group.indices.tolist(), own.tolist(), strict=True)
        ]
        for each in sorted({unit for unit, speed in zip(units, own, strict=True) if speed > 0.0}, key=_k):
            members = np.array([unit == each for unit in units]) & (own > 0.0)
            part = replace(here, squares=[here.squares[n] for n in np.flatnonzero(members).tolist()])
            self._solve_in(results, part, group.part(members), each, is_own=True)

    def _speeds(self, here: "_Here", group: Group) -> FloatArray:
        """Return about the largest |ω| of each point, as a job has it; NaN where that is not known here."""
        sampling = Sampling(self._sampling.time, np.zeros(0, dtype=np.int64), has_times=False)
        result = self._solved(here, group, Units(), sampling, "draft")
        return np.full(len(group.indices), np.nan) if result is None else result.speeds

    def _solve_in(
        self, results: FoundPoints, here: "_Here", group: Group, units: Units, *, is_own: bool = False
    ) -> BoolArray:
        """Solve the points of a group in ``units``; say which have a motion that misses what is asked."""
        plan, indices, sampling = self._plan, group.indices, self._sampling
        problem = units.pose(plan.problem)
        if is_own and sampling.has_times:
            # What is promised depends on the sizes of the variables.
            sampling = replace(sampling, columns=ALL)
        result = self._solved(here, group, units, sampling, plan.tier)
        if result is None:
            return np.zeros(len(indices), dtype=np.bool_)
        decided = np.isfinite(result.errors) & (result.errors <= problem.tolerance)
        # If only the period is asked for, its own error alone decides whether it is accurate enough.
        decided &= result.period_errors <= problem.tolerance * result.periods
        missed, result = np.isfinite(result.errors) & ~decided, result.in_units(units)
        decided &= np.isfinite(result.samples).all(axis=(1, 2))
        if is_own and sampling.has_times:
            accuracy = plan.problem.accuracy
            for n in np.flatnonzero(decided).tolist():
                groups = group_errors(result.samples[n], float(result.errors[n]), units.quick)
                decided[n] = keeps(accuracy, groups.values())
        numbers = numbers_of_motions(result, sampling.has_times)
        decided &= here.potentials.are_smooth(group, here.side, decided & result.passes_pole)
        if result.approaches is not None:
            decided &= keep_their_sign(group.program, group.rows, result.approaches)
        if self._keeps_energy:
            energies = here.potentials.energies(group, here.side, here.squares)
            numbers |= {"energy": energies[:, 0], "energy.error": energies[:, 1]}
            # A drift is one from the energy, too.
            decided &= np.isfinite(numbers["energy"])
            if "energy.error" in self._sweep.keep:
                decided &= np.isfinite(numbers["energy.error"])
        if self._integrals.names:
            known, sign = numbers.get("energy", np.zeros(len(indices))), here.side.motion.sign_of_g1

            def potential_at(n: int) -> Potential:
                return here.potentials.potential(int(indices[n]))

            wanted = np.flatnonzero(decided)
            numbers |= self._integrals.along(group, sign, known, result.samples, wanted, potential_at)
            # What is beyond doubles a job does not tell.
            decided &= ~np.any([np.isinf(numbers[name]) for name in self._integrals.names], axis=0)
        if self._outputs.are_any:
            numbers |= self._outputs_along(here, group, decided)
        results.add(indices, decided, numbers, result)
        self._refuse_empty(results, here, group, np.flatnonzero(~decided))
        return missed

    def _refuse_empty(self, results: FoundPoints, here: "_Here", group: Group, rest: IntArray) -> None:
        """Refuse those among the ``rest`` of a group that certainly have no motion."""
        if len(rest):
            curves = [here.squares[index] for index in rest.tolist()]
            empty = here.potentials.have_no_motion(group, here.side, rest, curves)
            results.refuse(NO_MOTION, group.indices[rest[empty]])

    def _solved(
        self, here: "_Here", group: Group, units: Units, sampling: Sampling, tier: Tier
    ) -> BlockResult | None:
        plan, own = self._plan, None
        if plan.time_axes and sampling.has_times:
            indices = group.indices.tolist()
            own = [units.times(each) for index in indices if (each := here.times[index]) is not None]
        sampling = replace(sampling, time=units.times(sampling.time))
        request = Request(here.side, here.squares, units, sampling, tier, plan.start_axis, own)
        return here.potentials.solve(group, request)

    def _outputs_along(self, here: "_Here", group: Group, decided: BoolArray) -> dict[str, FloatArray]:
        """Return what is kept of further outputs of each decided motion; those that need a job are not."""
        plan, indices = self._plan, group.indices
        starts = here.points.sizes(plan.start_axis, indices)
        outputs = self._outputs.along(here.side, group, here.squares, starts)
        columns = {name: np.full(len(indices), np.nan) for name in self._sweep.keep if name in OUTPUTS}
        for n in np.flatnonzero(decided).tolist():
            B, moment = plan.problem.body.B, plan.moment_axis
            if moment is not None:
                B = as_fraction(here.points.exact(moment, int(indices[n])))
            of_point = None if outputs is None else outputs.of_point(n, B)
            if of_point is None:
                decided[n] = False
                continue
            for name, column in columns.items():
                column[n] = of_point[name]
        return columns


@dataclass(frozen=True, slots=True)
class _Here:
    """The points of a block, the side of those that are solved together, and what each of these has."""

    points: SweptPoints
    potentials: FamilyOfBlock | JudgedOfBlock
    side: Side
    squares: Sequence[fmpq]
    """Their λ²."""
    times: Sequence[Times | None]
    """The times of all points of the block."""


def numbers_of_motions(result: BlockResult, has_times: bool) -> dict[str, FloatArray]:
    """Return period and errors as a job tells them."""
    # Without functions of time a job claims no error of them.
    error = result.errors if has_times else np.zeros(len(result.errors))
    period_errors = np.nextafter(result.period_errors, np.inf)
    return {"period": result.periods, "period.error": period_errors, "error": error}


def _k(units: Units) -> int:
    return units.k
