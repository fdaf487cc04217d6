"""Computes a block of points at once by compiled doubles with bounds; doubtful points are left out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.motion import COLUMNS
from service.schemas.reading.pointers import with_values
from service.schemas.sweep.sweep import Sweep, json_number
from workers.solvers.compiled.motion import ALL
from workers.solvers.planar.choose import compiled_tier
from workers.sweeping.by_roots import sweep_by_roots
from workers.sweeping.doubles import Sampling, Swept, sweep_sets
from workers.sweeping.emptiness import have_no_motion_at
from workers.sweeping.family import potential_of
from workers.sweeping.integrals import KeptIntegrals
from workers.sweeping.plan import Quick, Side
from workers.sweeping.points import Parameters, SweptPoints, are_numbers, listed_exactly
from workers.sweeping.programs import AffineProgram, Group, affine_program, grouped

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

MAX_PROGRAMS = 64
"""Of a family, by the signs of its coefficients."""


@dataclass(frozen=True, slots=True)
class SolvedBlock:
    """Some neighbouring points; those neither ``solved`` nor ``empty`` are left to single jobs."""

    solved: BoolArray
    """Shape (points,)."""
    empty: BoolArray
    """Proved to have no motion, shape (points,)."""
    numbers: Mapping[str, FloatArray]
    """The kept numbers, each of shape (points,)."""
    series: Mapping[str, FloatArray]
    """The functions of time, each of shape (points, samples)."""


class BlockSolver:
    """Solves blocks of one sweep."""

    def __init__(self, sweep: Sweep, quick: Quick) -> None:
        self._sweep = sweep
        self._quick = quick
        problem = quick.problem
        grade = compiled_tier(problem)
        assert grade is not None
        self._grade = grade
        names = [name for name in sweep.series_columns if name != "t"]
        self._integrals = KeptIntegrals(problem.body, sweep.keep)
        columns = ALL if self._integrals.names else np.array(list(map(COLUMNS.index, names)), dtype=np.int64)
        self._sampling = Sampling(problem.time, columns, problem.wants_series)
        self._names = names
        self._keeps_energy = any("energy" in name for name in sweep.keep)
        self._programs: dict[tuple[int, ...], AffineProgram | None] = {}
        self._known = [listed_exactly(axis) for axis in sweep.axes]

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        quick = self._quick
        points = SweptPoints(self._sweep, self._known, first, count)
        found = _Found(self._sweep, self._names, count)
        squares, signs = self._curves(points)
        parameters = points.parameters(quick.coefficients, quick.places)
        usable = are_numbers(points.doubles.T) & are_numbers(parameters.doubles)
        if quick.moment_place is not None:
            usable &= points.have_moment(quick.problem.body, quick.moment_place)
        for sign, side in quick.sides.items():
            is_here = usable & (signs == sign)
            if quick.start_place is not None:
                is_here &= np.sign(points.doubles[quick.start_place]) == sign
            for group in self._groups(points, parameters, np.flatnonzero(is_here)):
                self._solve_group(found, points, parameters, side, group, squares)
        return SolvedBlock(found.solved, found.empty, found.numbers, found.series)

    def _solve_group(
        self,
        found: "_Found",
        points: SweptPoints,
        parameters: Parameters,
        side: Side,
        group: Group,
        squares: Sequence[fmpq],
    ) -> None:
        problem, places = self._quick.problem, group.places
        chosen = [squares[place] for place in places.tolist()]
        swept = self._swept(points, parameters, side, group, chosen)
        if swept is None:
            return
        numbers, rows = self._numbers(swept), parameters.doubles[places]
        decided = np.isfinite(swept.errors) & (swept.errors <= problem.tolerance)
        # If only the period is asked for, its own error alone decides whether it is accurate enough.
        decided &= swept.period_errors <= problem.tolerance * swept.periods
        decided &= np.isfinite(swept.samples).all(axis=(1, 2))
        decided &= ~swept.passes_pole | self._are_plain(rows)
        if swept.approaches is not None:
            decided &= self._quick.family.keeps_its_sign(rows, swept.approaches)
        if self._keeps_energy and side.energies is not None:
            exact = [parameters.exact(place) for place in places.tolist()]
            energies = np.array(side.energies.rounded(exact, chosen)).reshape(-1, 2)
            numbers |= {"energy": energies[:, 0], "energy.error": energies[:, 1]}
            for name in self._sweep.keep:
                decided &= np.isfinite(numbers[name]) if name in ("energy", "energy.error") else True
        if self._integrals.names:
            numbers |= self._along(points, places, decided, side, numbers.get("energy"), swept.samples)
        found.add(places, decided, numbers, swept)
        rest = np.flatnonzero(~decided)
        curves = [chosen[place] for place in rest.tolist()]
        found.empty[places[rest]] = have_no_motion_at(problem.body, side.motion, group, rest, curves)

    def _swept(
        self, points: SweptPoints, parameters: Parameters, side: Side, group: Group, chosen: Sequence[fmpq]
    ) -> Swept | None:
        body, at, places = self._quick.problem.body, self._quick.start_place, group.places
        sizes = None if at is None else np.abs(points.doubles[at, places])
        is_high = self._grade == "high"
        rests = group.rests if is_high else None
        swept = sweep_sets(
            body, side.motion, group.program, group.rows, chosen, self._sampling, self._grade, sizes, rests
        )
        if swept is None or side.rational is None:
            return swept
        left = np.flatnonzero(~swept.is_kept)
        numbers = places[left].tolist()
        exact = [parameters.exact(place) for place in numbers]
        starts = None if at is None else [points.exact(at, place) for place in numbers]
        begun = None if starts is None else [abs(_fraction(start)) for start in starts]
        curves = [chosen[place] for place in left.tolist()]
        by_roots = sweep_by_roots(side.rational, exact, curves, self._sampling, begun)
        return swept.with_others(left, by_roots)

    def _along(
        self,
        points: SweptPoints,
        places: IntArray,
        decided: BoolArray,
        side: Side,
        known: FloatArray | None,
        samples: FloatArray,
    ) -> dict[str, FloatArray]:
        """Return what is kept of the integrals along each decided motion, whose energies are ``known``."""
        quick = self._quick
        columns = {name: np.full(len(places), np.nan) for name in self._integrals.names}
        for n in np.flatnonzero(decided).tolist():
            potential = quick.problem.potential
            if quick.places:
                potential = potential_of(quick.problem.body, self._potential_at(points, int(places[n])))
            energy = 0.0 if known is None else float(known[n])
            found = self._integrals.along(potential, side.motion.sign_of_g1, energy, samples[n])
            for name, column in columns.items():
                column[n] = found.get(name, np.nan)
        return columns

    def _numbers(self, swept: Swept) -> dict[str, FloatArray]:
        # Without functions of time a job claims no error of them.
        error = swept.errors if self._sampling.has_times else np.zeros(len(swept.errors))
        period_errors = np.nextafter(swept.period_errors, np.inf)
        return {"period": swept.periods, "period.error": period_errors, "error": error}

    def _curves(self, points: SweptPoints) -> tuple[list[fmpq], IntArray]:
        """Return λ² and the sign of g1 at every point; the sign is 0 where λ or nu is not one."""
        place, count = self._quick.curve_place, points.count
        sign, side = next(iter(self._quick.sides.items()))
        if place is None:
            return [_ratio(side.motion.lambda_squared)] * count, np.full(count, sign)
        values = [points.exact(place, n) for n in range(count)]
        if side.motion.nu is not None:
            return [abs(value) for value in values], np.sign(points.doubles[place]).astype(np.int64)
        return [value * value for value in values], np.where(points.doubles[place] > 0.0, sign, 0)

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
            is_high = self._grade == "high"
            exact = None
            if shared.needs_exact or is_high:
                exact = [parameters.exact(place) for place in here.tolist()]
            rows = shared.rows(parameters.doubles[here], exact)
            generic = shared.are_generic(rows)
            group = shared.group(rows[generic], here[generic])
            if is_high:
                numbers = [parameters.exact(place) for place in group.places.tolist()]
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

    def _potential_at(self, points: SweptPoints, place: int) -> object:
        values = {
            path: json_number(_fraction(points.exact(axis, place)))
            for path, axis in zip(self._quick.paths, self._quick.places, strict=True)
        }
        return with_values(dict(self._quick.potential), dict(values))


class _Found:
    """The results of a block, filled in group by group."""

    def __init__(self, sweep: Sweep, names: Sequence[str], count: int) -> None:
        self.solved, self.empty = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
        self.numbers = {name: np.full(count, np.nan) for name in sweep.keep}
        shape = (count, sweep.samples)
        self.series = {name: np.full(shape, np.nan) for name in sweep.series_columns}
        self._names = names

    def add(
        self, places: IntArray, solved: BoolArray, numbers: Mapping[str, FloatArray], swept: Swept
    ) -> None:
        """Fill in the points of a group."""
        self.solved[places] = solved
        for name, column in self.numbers.items():
            if name in numbers:
                column[places] = numbers[name]
        for k, name in enumerate(self._names):
            at = COLUMNS.index(name) if swept.samples.shape[2] == len(COLUMNS) else k
            self.series[name][places] = swept.samples[:, :, at]
        if "t" in self.series:
            self.series["t"][places] = swept.times


def _ratio(value: Fraction) -> fmpq:
    return fmpq(value.numerator, value.denominator)


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))
