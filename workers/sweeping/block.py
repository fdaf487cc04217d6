"""Computes a block of points at once by compiled doubles with bounds; doubtful points are left out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.motion import COLUMNS
from service.dynamics.sweep_axes import ListedAxis
from service.schemas.reading.numbers import LARGEST
from service.schemas.reading.pointers import with_values
from service.schemas.sweep.sweep import Sweep, SweepAxis, json_number
from workers.solvers.planar.choose import compiled_tier
from workers.sweeping.doubles import Sampling, Swept, sweep_sets
from workers.sweeping.emptiness import have_no_motion_at
from workers.sweeping.plan import Quick, Side
from workers.sweeping.programs import AffineProgram, Group, affine_program, grouped

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


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
        columns = np.array([COLUMNS.index(name) for name in names], dtype=np.int64)
        self._sampling = Sampling(problem.time, columns, problem.wants_series)
        self._names = names
        self._keeps_energy = any(name.startswith("energy") for name in sweep.keep)
        self._shared = affine_program(problem.body, quick.potential, quick.paths)
        self._known = [_listed_exactly(axis) for axis in sweep.axes]

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        points = _Points(self._sweep, self._known, first, count)
        found = _Found(self._sweep, self._names, count)
        squares, signs = self._curves(points)
        usable = self._are_numbers(points)
        for sign, side in self._quick.sides.items():
            places = np.flatnonzero(usable & (signs == sign))
            for group in self._groups(points, places):
                self._solve_group(found, points, side, group, squares)
        return SolvedBlock(found.solved, found.empty, found.numbers, found.series)

    def _solve_group(
        self,
        found: "_Found",
        points: "_Points",
        side: Side,
        group: Group,
        squares: Sequence[fmpq],
    ) -> None:
        problem, places = self._quick.problem, group.places
        chosen = [squares[place] for place in places.tolist()]
        swept = sweep_sets(
            problem.body, side.motion, group.program, group.rows, chosen, self._sampling, self._grade
        )
        if swept is None:
            return
        numbers, parameters = self._numbers(swept), points.doubles[list(self._quick.places)].T[places]
        decided = np.isfinite(swept.errors) & (swept.errors <= problem.tolerance)
        # If only the period is asked for, its own error alone decides whether it is accurate enough.
        decided &= swept.period_errors <= problem.tolerance * swept.periods
        decided &= np.isfinite(swept.samples).all(axis=(1, 2))
        decided &= ~swept.passes_pole | self._are_plain(parameters)
        decided &= self._quick.family.keeps_its_sign(parameters, swept.approaches)
        if self._keeps_energy and side.energies is not None:
            exact = [points.exact_row(place, self._quick.places) for place in places.tolist()]
            energies = np.array(side.energies.rounded(exact, chosen)).reshape(-1, 2)
            numbers |= {"energy": energies[:, 0], "energy.error": energies[:, 1]}
            for name in self._sweep.keep:
                decided &= np.isfinite(numbers[name]) if name in ("energy", "energy.error") else True
        found.add(places, decided, numbers, swept)
        rest = np.flatnonzero(~decided)
        curves = [chosen[place] for place in rest.tolist()]
        found.empty[places[rest]] = have_no_motion_at(problem.body, side.motion, group, rest, curves)

    def _numbers(self, swept: Swept) -> dict[str, FloatArray]:
        # Without functions of time a job claims no error of them.
        error = swept.errors if self._sampling.has_times else np.zeros(len(swept.errors))
        period_errors = np.nextafter(swept.period_errors, np.inf)
        return {"period": swept.periods, "period.error": period_errors, "error": error}

    def _curves(self, points: "_Points") -> tuple[list[fmpq], IntArray]:
        """Return λ² and the sign of g1 at every point; the sign is 0 where λ or nu is not one."""
        place, count = self._quick.curve_place, points.count
        sign, side = next(iter(self._quick.sides.items()))
        if place is None:
            return [_ratio(side.motion.lambda_squared)] * count, np.full(count, sign)
        values = [points.exact(place, n) for n in range(count)]
        if side.motion.nu is not None:
            return [abs(value) for value in values], np.sign(points.doubles[place]).astype(np.int64)
        return [value * value for value in values], np.where(points.doubles[place] > 0.0, sign, 0)

    def _are_numbers(self, points: "_Points") -> BoolArray:
        """Tell which points have numbers that are safely within the limits of documents."""
        sizes = np.abs(points.doubles)
        limit = float(LARGEST) / 2.0
        usable: BoolArray = ((sizes == 0.0) | ((sizes > 1.0 / limit) & (sizes < limit))).all(axis=0)
        return usable

    def _are_plain(self, parameters: FloatArray) -> BoolArray:
        poles = self._quick.poles
        return np.zeros(len(parameters), dtype=np.bool_) if poles is None else poles.are_plain(parameters)

    def _groups(self, points: "_Points", places: IntArray) -> list[Group]:
        """Return the places by their programs; points without a program are left out."""
        shared, groups = self._shared, list[Group]()
        if shared is not None and len(places):
            rows = self._shared_rows(shared, points, places)
            generic = shared.are_generic(rows)
            groups.append(shared.group(rows[generic], places[generic]))
            places = places[~generic]
        documents = {place: self._potential_at(points, place) for place in places.tolist()}
        return [
            group for group in [*groups, *grouped(self._quick.problem.body, documents)] if len(group.rows)
        ]

    def _shared_rows(self, shared: AffineProgram, points: "_Points", places: IntArray) -> FloatArray:
        own = self._quick.places
        exact = [points.exact_row(place, own) for place in places.tolist()] if shared.needs_exact else None
        return shared.rows(points.doubles[list(own)].T[places], exact)

    def _potential_at(self, points: "_Points", place: int) -> object:
        values = {
            path: json_number(_fraction(points.exact(axis, place)))
            for path, axis in zip(self._quick.paths, self._quick.places, strict=True)
        }
        return with_values(dict(self._quick.potential), dict(values))


class _Points:
    """The numbers on the axes at neighbouring points, as doubles and exactly."""

    def __init__(
        self, sweep: Sweep, known: Sequence[Mapping[float, fmpq | None]], first: int, count: int
    ) -> None:
        self.count = count
        self.doubles = np.stack(list(sweep.columns(first, count).values()))
        self._sweep = sweep
        self._known = known
        self._first = first

    def exact(self, axis: int, place: int) -> fmpq:
        """Return the number on an axis at the ``place``-th point."""
        double = float(self.doubles[axis, place])
        known = self._known[axis]
        if double not in known:
            # A double means its shortest decimal.
            return fmpq(*Decimal(repr(double)).as_integer_ratio())
        found = known[double]
        return _ratio(self._sweep.values(self._first + place)[axis]) if found is None else found

    def exact_row(self, place: int, axes: Sequence[int]) -> list[fmpq]:
        """Return the numbers on several axes."""
        return [self.exact(axis, place) for axis in axes]


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
            self.series[name][places] = swept.samples[:, :, k]
        if "t" in self.series:
            self.series["t"][places] = swept.times


def _listed_exactly(axis: SweepAxis) -> dict[float, fmpq | None]:
    """Return listed numbers and ends that their doubles may not equal; None if two share a double."""
    if isinstance(axis.axis, ListedAxis):
        given = axis.axis.listed
    else:
        given = (axis.axis.value(0), axis.axis.value(axis.axis.length - 1))
    first: dict[float, Fraction] = {}
    shared = {double for value in given if first.setdefault(double := float(value), value) != value}
    return {double: None if double in shared else _ratio(value) for double, value in first.items()}


def _ratio(value: Fraction) -> fmpq:
    return fmpq(value.numerator, value.denominator)


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))
