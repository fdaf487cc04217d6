"""Computes a block of points at once by compiled doubles with bounds; doubtful points are left out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.accuracy import keeps
from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.motion import COLUMNS, group_errors
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Times
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import Part, with_values
from service.schemas.sweep.sweep import Sweep, json_number
from workers.solvers.choose import QUICK_SPEED, compiled_tier
from workers.solvers.compiled.motion import ALL
from workers.solvers.compiled.solve import Tier
from workers.solvers.units import Units
from workers.sweeping.parameters.points import (
    Parameters,
    SweptPoints,
    are_numbers,
    curves_of,
    listed_exactly,
    times_of,
)
from workers.sweeping.parameters.programs import AffineProgram, Group, affine_program, grouped
from workers.sweeping.planar.by_roots import sweep_by_roots
from workers.sweeping.planar.doubles import BlockResult, Sampling, sweep_sets
from workers.sweeping.planar.exclusions import have_no_motion_at, keep_their_sign
from workers.sweeping.planar.outputs import OUTPUTS, KeptIntegrals, KeptOutputs
from workers.sweeping.planar.records import (
    NO_MOTION,
    CompiledPlan,
    FoundPoints,
    Side,
    SolvedBlock,
    numbers_of_motions,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


MAX_PROGRAMS = 64
"""Largest number of programs of a family, by the signs of its coefficients."""


class BlockSolver:
    """Solves blocks of one sweep."""

    def __init__(self, sweep: Sweep, plan: CompiledPlan) -> None:
        self._sweep = sweep
        self._plan = plan
        problem = plan.problem
        self._is_relative = problem.accuracy.measure == "relative"
        grade = compiled_tier(problem)
        assert grade is not None
        self._grade = grade
        names = [name for name in sweep.series_columns if name != "t"]
        self._integrals = KeptIntegrals(problem.body, sweep.keep)
        self._outputs = KeptOutputs(problem)
        columns = ALL if self._integrals.names else np.array(list(map(COLUMNS.index, names)), dtype=np.int64)
        self._sampling = Sampling(problem.time, columns, problem.wants_series)
        self._names = names
        self._keeps_energy = any("energy" in name for name in sweep.keep)
        self._programs: dict[tuple[int, ...], AffineProgram | None] = {}
        self._known = [listed_exactly(axis) for axis in sweep.axes]

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        return self.solve_some(np.arange(first, first + count))

    def solve_some(self, indices: IntArray) -> SolvedBlock:
        """Solve points of any indices."""
        plan = self._plan
        points = SweptPoints(self._sweep, self._known, indices)
        results = FoundPoints(self._sweep, self._names, len(indices))
        sign, side = next(iter(plan.sides.items()))
        squares, signs = curves_of(points, plan.curve_axis, sign, side.motion)
        parameters = points.parameters(plan.coefficients, plan.axes)
        usable = are_numbers(points.doubles.T) & are_numbers(parameters.doubles)
        times = times_of(points, plan.time_axes, plan.problem.time)
        usable &= np.array([each is not None for each in times])
        if plan.moment_axis is not None:
            usable &= points.have_moment(plan.problem.body, plan.moment_axis)
        for sign, side in plan.sides.items():
            is_here = usable & (signs == sign)
            if plan.start_axis is not None:
                is_here &= np.sign(points.doubles[plan.start_axis]) == sign
            for group in self._groups(points, parameters, np.flatnonzero(is_here)):
                self._solve_group(results, points, parameters, side, group, squares, times)
        return results.block()

    def _solve_group(
        self,
        results: FoundPoints,
        points: SweptPoints,
        parameters: Parameters,
        side: Side,
        group: Group,
        squares: Sequence[fmpq],
        times: Sequence[Times | None],
    ) -> None:
        """Solve in the client's units, and what needs units of its own in these."""
        here = _Here(points, parameters, side, [squares[index] for index in group.indices.tolist()], times)
        if self._is_relative:
            own = self._speeds(here, group)
            self._refuse_empty(results, here, group, np.flatnonzero(np.isnan(own)))
        else:
            missed = self._solve_in(results, here, group, Units())
            own = np.zeros(len(group.indices))
            if self._plan.problem.accuracy.measure == "above 1" and missed.any():
                # As a job does: who misses a tier is asked in its own units if it is quick.
                speeds = self._speeds(here, group)
                own[missed & (speeds >= QUICK_SPEED)] = speeds[missed & (speeds >= QUICK_SPEED)]
        if self._outputs.are_any:
            return
        units = [Units.of(speed, self._plan.problem.body) for speed in own.tolist()]
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
        plan, indices, chosen = self._plan, group.indices, here.squares
        problem, side = units.pose(plan.problem), here.side
        sampling = self._sampling
        if is_own and sampling.has_times:
            # What is promised depends on the sizes of the variables.
            sampling = replace(sampling, columns=ALL)
        result = self._solved(here, group, units, sampling, self._grade)
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
        rows = here.parameters.doubles[indices]
        decided &= ~result.passes_pole | self._are_plain(rows)
        if result.approaches is not None:
            decided &= keep_their_sign(group.program, group.rows, result.approaches)
        if self._keeps_energy and side.energies is not None:
            exact = [here.parameters.exact(index) for index in indices.tolist()]
            energies = np.array(side.energies.rounded(exact, chosen)).reshape(-1, 2)
            numbers |= {"energy": energies[:, 0], "energy.error": energies[:, 1]}
            # A drift is one from the energy, too.
            decided &= np.isfinite(numbers["energy"])
            if "energy.error" in self._sweep.keep:
                decided &= np.isfinite(numbers["energy.error"])
        if self._integrals.names:
            known = numbers.get("energy", np.zeros(len(indices)))
            numbers |= self._along(here.points, group, decided, side, known, result.samples)
            # What is beyond doubles a job does not tell.
            decided &= ~np.any([np.isinf(numbers[name]) for name in self._integrals.names], axis=0)
        if self._outputs.are_any:
            numbers |= self._outputs_along(here.points, side, group, chosen, decided)
        results.add(indices, decided, numbers, result)
        self._refuse_empty(results, here, group, np.flatnonzero(~decided))
        return missed

    def _refuse_empty(self, results: FoundPoints, here: "_Here", group: Group, rest: IntArray) -> None:
        """Refuse those among the ``rest`` of a group that certainly have no motion."""
        curves = [here.squares[index] for index in rest.tolist()]
        empty = have_no_motion_at(self._plan.problem.body, here.side.motion, group, rest, curves)
        results.refuse(NO_MOTION, group.indices[rest[empty]])

    def _solved(
        self, here: "_Here", group: Group, units: Units, sampling: Sampling, tier: Tier
    ) -> BlockResult | None:
        plan, side, indices = self._plan, here.side, group.indices
        body, at = units.body(plan.problem.body), plan.start_axis
        sizes = None if at is None else np.abs(here.points.doubles[at, indices])
        sampling = replace(sampling, time=units.times(sampling.time))
        own = None
        if plan.time_axes and sampling.has_times:
            own = [units.times(each) for index in indices.tolist() if (each := here.times[index]) is not None]
        rests = group.rests if tier == "high" else None
        result = sweep_sets(
            body, side.motion, group.program, group.rows, here.squares, sampling, tier, sizes, own, rests
        )
        if result is None or side.rational is None or tier != "high":
            return result
        left = np.flatnonzero(~result.is_kept)
        numbers = indices[left].tolist()
        exact = [here.parameters.exact(index) for index in numbers]
        starts = None if at is None else [here.points.exact(at, index) for index in numbers]
        begun = None if starts is None else [abs(as_fraction(start)) for start in starts]
        curves = [here.squares[index] for index in left.tolist()]
        by_roots = sweep_by_roots(replace(side.rational, body=body), exact, curves, sampling, begun)
        return result.with_others(left, by_roots)

    def _along(
        self,
        points: SweptPoints,
        group: Group,
        decided: BoolArray,
        side: Side,
        energies: FloatArray,
        samples: FloatArray,
    ) -> dict[str, FloatArray]:
        """Return what is kept of the integrals along each decided motion."""
        problem, indices = self._plan.problem, group.indices

        def potential_at(n: int) -> Potential:
            if not self._plan.axes:
                return problem.potential
            return potential_of(self._potential_at(points, int(indices[n])), problem.body)

        wanted, sign = np.flatnonzero(decided), side.motion.sign_of_g1
        return self._integrals.along(group, sign, energies, samples, wanted, potential_at)

    def _outputs_along(
        self, points: SweptPoints, side: Side, group: Group, chosen: Sequence[fmpq], decided: BoolArray
    ) -> dict[str, FloatArray]:
        """Return what is kept of further outputs of each decided motion; those that need a job are not."""
        plan, indices = self._plan, group.indices
        at = plan.start_axis
        starts = None if at is None else np.abs(points.doubles[at, indices])
        outputs = self._outputs.along(side, group, chosen, starts)
        columns = {name: np.full(len(indices), np.nan) for name in self._sweep.keep if name in OUTPUTS}
        for n in np.flatnonzero(decided).tolist():
            B, moment = plan.problem.body.B, plan.moment_axis
            if moment is not None:
                B = as_fraction(points.exact(moment, int(indices[n])))
            of_point = None if outputs is None else outputs.of_point(n, B)
            if of_point is None:
                decided[n] = False
                continue
            for name, column in columns.items():
                column[n] = of_point[name]
        return columns

    def _are_plain(self, parameters: FloatArray) -> BoolArray:
        poles = self._plan.poles
        return np.zeros(len(parameters), dtype=np.bool_) if poles is None else poles.are_plain(parameters)

    def _groups(self, points: SweptPoints, parameters: Parameters, indices: IntArray) -> list[Group]:
        """Return the points by their programs; points without a program are left out."""
        groups, by_key = list[Group](), dict[tuple[int, ...], list[int]]()
        for index, row in zip(indices.tolist(), parameters.doubles[indices].tolist(), strict=True):
            by_key.setdefault(self._key(row), []).append(index)
        for key, members in by_key.items():
            here = np.array(members, dtype=np.int64)
            shared = self._program(key)
            if shared is None:
                continue
            has_rests = self._grade == "high" or self._integrals.keeps_drifts
            exact = [parameters.exact(n) for n in here.tolist()] if shared.needs_exact or has_rests else None
            rows = shared.rows(parameters.doubles[here], exact)
            generic = shared.are_generic(rows)
            group = shared.group(rows[generic], here[generic])
            if has_rests and exact is not None:
                numbers = [exact[n] for n in np.flatnonzero(generic).tolist()]
                group = replace(group, rests=shared.rests(group.rows, numbers))
            groups.append(group)
            indices = np.setdiff1d(indices, here[generic])
        documents = {index: self._potential_at(points, index) for index in indices.tolist()}
        return [group for group in [*groups, *grouped(self._plan.problem.body, documents)] if len(group.rows)]

    def _key(self, row: Sequence[float]) -> tuple[int, ...]:
        """Return what else than its constants a program depends on: a family writes sums by signs."""
        if self._plan.potential.get("type") == "expression":
            return (1,) * len(row)
        return tuple(int(np.sign(number)) for number in row)

    def _program(self, key: tuple[int, ...]) -> AffineProgram | None:
        if key not in self._programs:
            body, made = self._plan.problem.body, self._plan.coefficients
            known = all(key) and len(self._programs) < MAX_PROGRAMS
            self._programs[key] = affine_program(body, made.document, made.paths, key) if known else None
        return self._programs[key]

    def _potential_at(self, points: SweptPoints, index: int) -> Part:
        values = {
            path: json_number(as_fraction(points.exact(axis, index)))
            for path, axis in zip(self._plan.paths, self._plan.axes, strict=True)
        }
        return with_values(self._plan.potential, dict(values))


@dataclass(frozen=True, slots=True)
class _Here:
    """The points of a block, the side of those that are solved together, and what each of these has."""

    points: SweptPoints
    parameters: Parameters
    side: Side
    squares: Sequence[fmpq]
    """Their λ²."""
    times: Sequence[Times | None]
    """The times of all points of the block."""


def _k(units: Units) -> int:
    return units.k
