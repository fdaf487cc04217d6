"""Computes a block of points at once by compiled doubles with bounds; doubtful points are left out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.accuracy import keeps
from service.dynamics.motion import COLUMNS, group_errors
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Times
from service.schemas.problem.trusted import potential_of
from service.schemas.reading.documents import Part, with_values
from service.schemas.sweep.sweep import Sweep, json_number
from workers.solvers.choose import QUICK_SPEED, compiled_tier
from workers.solvers.compiled.batch import Tier
from workers.solvers.compiled.motion import ALL
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
from workers.sweeping.planar.doubles import Sampling, Swept, sweep_sets
from workers.sweeping.planar.exclusions import have_no_motion_at, keep_their_sign
from workers.sweeping.planar.outputs import OUTPUTS, KeptIntegrals, KeptOutputs
from workers.sweeping.planar.records import (
    NO_MOTION,
    FoundPoints,
    Quick,
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

    def __init__(self, sweep: Sweep, quick: Quick) -> None:
        self._sweep = sweep
        self._quick = quick
        problem = quick.problem
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
        quick = self._quick
        points = SweptPoints(self._sweep, self._known, indices)
        found = FoundPoints(self._sweep, self._names, len(indices))
        sign, side = next(iter(quick.sides.items()))
        squares, signs = curves_of(points, quick.curve_place, sign, side.motion)
        parameters = points.parameters(quick.coefficients, quick.places)
        usable = are_numbers(points.doubles.T) & are_numbers(parameters.doubles)
        times = times_of(points, quick.time_places, quick.problem.time)
        usable &= np.array([each is not None for each in times])
        if quick.moment_place is not None:
            usable &= points.have_moment(quick.problem.body, quick.moment_place)
        for sign, side in quick.sides.items():
            is_here = usable & (signs == sign)
            if quick.start_place is not None:
                is_here &= np.sign(points.doubles[quick.start_place]) == sign
            for group in self._groups(points, parameters, np.flatnonzero(is_here)):
                self._solve_group(found, points, parameters, side, group, squares, times)
        return found.block()

    def _solve_group(
        self,
        found: FoundPoints,
        points: SweptPoints,
        parameters: Parameters,
        side: Side,
        group: Group,
        squares: Sequence[fmpq],
        times: Sequence[Times | None],
    ) -> None:
        """Solve in the client's units, and what needs units of its own in these."""
        here = _Here(points, parameters, side, [squares[place] for place in group.places.tolist()], times)
        if self._is_relative:
            own = self._speeds(here, group)
            self._refuse_empty(found, here, group, np.flatnonzero(np.isnan(own)))
        else:
            missed = self._solve_in(found, here, group, Units())
            own = np.zeros(len(group.places))
            if self._quick.problem.accuracy.measure == "above 1" and missed.any():
                # As a job does: who misses a tier is asked in its own units if it is quick.
                speeds = self._speeds(here, group)
                own[missed & (speeds >= QUICK_SPEED)] = speeds[missed & (speeds >= QUICK_SPEED)]
        if self._outputs.are_any:
            return
        units = [Units.of(speed, self._quick.problem.body) for speed in own.tolist()]
        for each in sorted({unit for unit, speed in zip(units, own, strict=True) if speed > 0.0}, key=_k):
            members = np.array([unit == each for unit in units]) & (own > 0.0)
            part = replace(here, squares=[here.squares[n] for n in np.flatnonzero(members).tolist()])
            self._solve_in(found, part, group.part(members), each, is_own=True)

    def _speeds(self, here: "_Here", group: Group) -> FloatArray:
        """Return about the largest |ω| of each point, as a job has it; NaN where that is not known here."""
        sampling = Sampling(self._sampling.time, np.zeros(0, dtype=np.int64), has_times=False)
        swept = self._swept(here, group, Units(), sampling, "draft")
        return np.full(len(group.places), np.nan) if swept is None else swept.speeds

    def _solve_in(
        self, found: FoundPoints, here: "_Here", group: Group, units: Units, *, is_own: bool = False
    ) -> BoolArray:
        """Solve the points of a group in ``units``; say which have a motion that misses what is asked."""
        quick, places, chosen = self._quick, group.places, here.squares
        problem, side = units.pose(quick.problem), here.side
        sampling = self._sampling
        if is_own and sampling.has_times:
            # What is promised depends on the sizes of the variables.
            sampling = replace(sampling, columns=ALL)
        swept = self._swept(here, group, units, sampling, self._grade)
        if swept is None:
            return np.zeros(len(places), dtype=np.bool_)
        decided = np.isfinite(swept.errors) & (swept.errors <= problem.tolerance)
        # If only the period is asked for, its own error alone decides whether it is accurate enough.
        decided &= swept.period_errors <= problem.tolerance * swept.periods
        missed, swept = np.isfinite(swept.errors) & ~decided, swept.in_units(units)
        decided &= np.isfinite(swept.samples).all(axis=(1, 2))
        if is_own and sampling.has_times:
            accuracy = quick.problem.accuracy
            for n in np.flatnonzero(decided).tolist():
                groups = group_errors(swept.samples[n], float(swept.errors[n]), units.quick)
                decided[n] = keeps(accuracy, groups.values())
        numbers = numbers_of_motions(swept, sampling.has_times)
        rows = here.parameters.doubles[places]
        decided &= ~swept.passes_pole | self._are_plain(rows)
        if swept.approaches is not None:
            decided &= keep_their_sign(group.program, group.rows, swept.approaches)
        if self._keeps_energy and side.energies is not None:
            exact = [here.parameters.exact(place) for place in places.tolist()]
            energies = np.array(side.energies.rounded(exact, chosen)).reshape(-1, 2)
            numbers |= {"energy": energies[:, 0], "energy.error": energies[:, 1]}
            # A drift is one from the energy, too.
            decided &= np.isfinite(numbers["energy"])
            if "energy.error" in self._sweep.keep:
                decided &= np.isfinite(numbers["energy.error"])
        if self._integrals.names:
            known = numbers.get("energy", np.zeros(len(places)))
            numbers |= self._along(here.points, group, decided, side, known, swept.samples)
            # What is beyond doubles a job does not tell.
            decided &= ~np.any([np.isinf(numbers[name]) for name in self._integrals.names], axis=0)
        if self._outputs.are_any:
            numbers |= self._outputs_along(here.points, side, group, chosen, decided)
        found.add(places, decided, numbers, swept)
        self._refuse_empty(found, here, group, np.flatnonzero(~decided))
        return missed

    def _refuse_empty(self, found: FoundPoints, here: "_Here", group: Group, rest: IntArray) -> None:
        """Refuse those among the ``rest`` of a group that certainly have no motion."""
        curves = [here.squares[place] for place in rest.tolist()]
        empty = have_no_motion_at(self._quick.problem.body, here.side.motion, group, rest, curves)
        found.refuse(NO_MOTION, group.places[rest[empty]])

    def _swept(
        self, here: "_Here", group: Group, units: Units, sampling: Sampling, tier: Tier
    ) -> Swept | None:
        quick, side, places = self._quick, here.side, group.places
        body, at = units.body(quick.problem.body), quick.start_place
        sizes = None if at is None else np.abs(here.points.doubles[at, places])
        sampling = replace(sampling, time=units.times(sampling.time))
        own = None
        if quick.time_places and sampling.has_times:
            own = [units.times(each) for place in places.tolist() if (each := here.times[place]) is not None]
        rests = group.rests if tier == "high" else None
        swept = sweep_sets(
            body, side.motion, group.program, group.rows, here.squares, sampling, tier, sizes, own, rests
        )
        if swept is None or side.rational is None or tier != "high":
            return swept
        left = np.flatnonzero(~swept.is_kept)
        numbers = places[left].tolist()
        exact = [here.parameters.exact(place) for place in numbers]
        starts = None if at is None else [here.points.exact(at, place) for place in numbers]
        begun = None if starts is None else [abs(_fraction(start)) for start in starts]
        curves = [here.squares[place] for place in left.tolist()]
        by_roots = sweep_by_roots(replace(side.rational, body=body), exact, curves, sampling, begun)
        return swept.with_others(left, by_roots)

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
        problem, places = self._quick.problem, group.places

        def potential_at(n: int) -> Potential:
            if not self._quick.places:
                return problem.potential
            return potential_of(self._potential_at(points, int(places[n])), problem.body)

        wanted, sign = np.flatnonzero(decided), side.motion.sign_of_g1
        return self._integrals.along(group, sign, energies, samples, wanted, potential_at)

    def _outputs_along(
        self, points: SweptPoints, side: Side, group: Group, chosen: Sequence[fmpq], decided: BoolArray
    ) -> dict[str, FloatArray]:
        """Return what is kept of further outputs of each decided motion; those that need a job are not."""
        quick, places = self._quick, group.places
        at = quick.start_place
        starts = None if at is None else np.abs(points.doubles[at, places])
        outputs = self._outputs.along(side, group, chosen, starts)
        columns = {name: np.full(len(places), np.nan) for name in self._sweep.keep if name in OUTPUTS}
        for n in np.flatnonzero(decided).tolist():
            B, moment = quick.problem.body.B, quick.moment_place
            if moment is not None:
                B = _fraction(points.exact(moment, int(places[n])))
            found = None if outputs is None else outputs.of_point(n, B)
            if found is None:
                decided[n] = False
                continue
            for name, column in columns.items():
                column[n] = found[name]
        return columns

    def _are_plain(self, parameters: FloatArray) -> BoolArray:
        poles = self._quick.poles
        return np.zeros(len(parameters), dtype=np.bool_) if poles is None else poles.are_plain(parameters)

    def _groups(self, points: SweptPoints, parameters: Parameters, places: IntArray) -> list[Group]:
        """Return the places by their programs; points without a program are left out."""
        groups, by_key = list[Group](), dict[tuple[int, ...], list[int]]()
        for place, row in zip(places.tolist(), parameters.doubles[places].tolist(), strict=True):
            by_key.setdefault(self._key(row), []).append(place)
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
            places = np.setdiff1d(places, here[generic])
        documents = {place: self._potential_at(points, place) for place in places.tolist()}
        return [
            group for group in [*groups, *grouped(self._quick.problem.body, documents)] if len(group.rows)
        ]

    def _key(self, row: Sequence[float]) -> tuple[int, ...]:
        """Return what else than its constants a program depends on: a family writes sums by signs."""
        if self._quick.potential.get("type") == "expression":
            return (1,) * len(row)
        return tuple(int(np.sign(number)) for number in row)

    def _program(self, key: tuple[int, ...]) -> AffineProgram | None:
        if key not in self._programs:
            body, made = self._quick.problem.body, self._quick.coefficients
            known = all(key) and len(self._programs) < MAX_PROGRAMS
            self._programs[key] = affine_program(body, made.document, made.paths, key) if known else None
        return self._programs[key]

    def _potential_at(self, points: SweptPoints, place: int) -> Part:
        values = {
            path: json_number(_fraction(points.exact(axis, place)))
            for path, axis in zip(self._quick.paths, self._quick.places, strict=True)
        }
        return with_values(self._quick.potential, dict(values))


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


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))
