"""Points of sweeps of motions from any state: the kernels of a single job, without its documents.

What a point needs beside numbers is kept: the integrator of a body and a potential, the times, and what is
asked of the runs. Motions whose formulas have one structure go side by side, with the bits they have alone.
Points that kernels do not settle alone are left to single jobs.

Points that share a template (:mod:`.templates`) share the operations of their formula and of its gradient;
the constants are put in as numbers. They are those that a document's formula leads to, to the last bit.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import as_fraction
from service.dynamics.formula.algebras.real import nearest_double
from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import Problem, StateMotion
from service.dynamics.sampling import sample_times
from service.schemas.problem.motions import is_unit
from service.schemas.problem.problem import read_problem
from service.schemas.reading.documents import InvalidProblemError
from service.schemas.sweep.sweep import Sweep
from workers.solvers.choose import QUICK_SPEED
from workers.solvers.compiled.general.run_pair import COLLIDED, INACCURATE, VERIFIED
from workers.solvers.compiled.records import Models
from workers.solvers.errors import AccuracyNotMetError, CollisionError, UnsupportedFormulaError
from workers.solvers.integration.compiled import CompiledIntegrator, integrator_of, models_of, verified_runs
from workers.solvers.integration.interface import neighbour_of, rounded_moments
from workers.solvers.integration.programs import SharedGradient, shared_gradient
from workers.solvers.integration.solve import run_request_of, tolerances
from workers.sweeping.parameters.family import has_symbol
from workers.sweeping.parameters.models import model_of
from workers.sweeping.parameters.points import SweptPoints, are_numbers, listed_exactly
from workers.sweeping.parameters.templates import MOMENTS, Model, MomentsOfPoint, Template, Templates
from workers.sweeping.planar.doubles import SolvedBlock, printed_errors

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class PointConstants:
    """The constants of one point, and those of its gradient."""

    template: Template
    slopes: SharedGradient
    row: Sequence[float]
    own: Sequence[float]
    """The gradient's, by the first of ``ROUNDINGS``."""
    other: Sequence[float]
    """And by the second."""


class SharedModels:
    """Finds the constants of points of one sweep."""

    def __init__(self, model: Model, problem: Problem) -> None:
        self._model, self._body, self._moments = model, problem.body, MomentsOfPoint.of(problem.body)
        self._templates = Templates(model)
        self._gradients: dict[int, tuple[Template, SharedGradient | None]] = {}

    @staticmethod
    def of(sweep: Sweep, problem: Problem) -> "SharedModels | None":
        """Return that of a sweep; None where a body varies, or a potential has no model."""
        potential = sweep.base["potential"]
        axes = [axis.path for axis in sweep.axes if axis.path[0] == "potential"]
        has_bodies = any(axis.path[0] == "body" for axis in sweep.axes)
        if not axes or has_bodies or not isinstance(potential, dict):
            return None
        model = model_of(potential, [path[1:] for path in axes], frozenset())
        return None if model is None else SharedModels(model, problem)

    def row(self, numbers: Sequence[fmpq]) -> PointConstants | None:
        """Return the constants of the potential with these numbers on its axes; None: read its document."""
        values = self._model.values(self._moments, numbers)
        found = None if values is None else self._templates.shared(self._moments, numbers, values)
        slopes = None if found is None else self._gradient(found.template)
        if found is None or slopes is None:
            return None
        exact = [None if number is None else as_fraction(number) for number in found.exact]
        own, other = (slopes.constants(exact, rounding) for rounding in ROUNDINGS)
        if own is None or other is None:
            return None
        return PointConstants(found.template, slopes, found.row, own, other)

    def models(self, rows: Sequence[PointConstants]) -> Models:
        """Return the models of points of one structure."""
        gradient, count = rows[0].slopes.gradient, len(rows)
        own, other = (rounded_moments(self._body, rounding) for rounding in ROUNDINGS)
        return Models(
            rows[0].template.program.gradient,
            gradient.code,
            gradient.gradient,
            gradient.registers,
            np.array([each.row for each in rows]).reshape(count, -1),
            np.array([each.own for each in rows]).reshape(count, -1),
            np.array([each.other for each in rows]).reshape(count, -1),
            np.tile(own, (count, 1)),
            np.tile(other, (count, 1)),
        )

    def _gradient(self, template: Template) -> SharedGradient | None:
        key = id(template)
        if key not in self._gradients:
            try:
                found = shared_gradient(template.tape, nearest_double)
            except UnsupportedFormulaError:
                found = None
            self._gradients[key] = template, found
        return self._gradients[key][1]


ROUNDINGS = nearest_double, neighbour_of
"""Constants as doubles, and as those that rounded ones might as well have been."""
MOST_CACHED_INTEGRATORS = 64
"""Integrators of bodies and potentials that are kept at once."""
MOST_SAMPLE_VALUES = 2**17
"""Samples that are held beside those of the sweep: some 8 MB."""
_TOLD = {"energy": 2, "energy.error": 3, "error": 0}
"""Numbers that a sweep may keep, by their position among the results; a general motion has no others."""


class StateSolver:
    """Solves blocks of one sweep of states."""

    def __init__(self, sweep: Sweep) -> None:
        problem = sweep.first_problem
        motion = problem.motion_as(StateMotion)
        self._sweep, self._problem = sweep, problem
        self._names = [name for name in sweep.series_columns if name != "t"]
        self._columns = [COLUMNS.index(name) for name in self._names]
        self._positions = [axis.position_in_state for axis in sweep.axes]
        self._moves_gamma = any(index in (3, 4, 5) for index in self._positions)
        self._known = [listed_exactly(axis) for axis in sweep.axes]
        self._times = sample_times(problem.time, None)
        self._start = (*motion.omega, *motion.gamma)
        self._doubles = np.array([float(number) for number in self._start])
        self._neighbours = np.array([neighbour_of(number) for number in self._start])
        potential = sweep.base["potential"]
        varies = any(axis.path[0] == "potential" for axis in sweep.axes)
        has_moments = isinstance(potential, dict) and any(has_symbol(potential, name) for name in MOMENTS)
        self._reads = varies or has_moments or not isinstance(potential, dict)
        """Whether the potential of a point is read from its document."""
        self._shared = SharedModels.of(sweep, problem)
        self._settings: dict[tuple[Fraction, ...], CompiledIntegrator | None] = {}
        self._run_request = run_request_of(self._times.doubles, problem.tolerance)

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        sweep = self._sweep
        points = SweptPoints(sweep, self._known, np.arange(first, first + count))
        solved, missed, collided = np.zeros((3, count), dtype=np.bool_)
        numbers = {name: np.full(count, np.nan) for name in sweep.keep}
        series = {name: np.full((count, sweep.samples), np.nan) for name in sweep.series_columns}
        refused = {AccuracyNotMetError.code: missed, CollisionError.code: collided}
        block = SolvedBlock(solved, refused, numbers, series)
        states, neighbours, is_usable = self._starts(points)
        for group in self._groups(points, first, is_usable):
            rows = max(1, len(self._times.doubles)) if series else 1
            portion = max(1, MOST_SAMPLE_VALUES // rows)
            for begin in range(0, len(group.indices), portion):
                part = group.part(begin, begin + portion)
                self._solve_group(part, states[part.indices], neighbours[part.indices], block)
        return block

    def _starts(self, points: SweptPoints) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return states, those that rounded numbers might as well have meant, and where they are states."""
        states = np.tile(self._doubles, (points.count, 1))
        neighbours = np.tile(self._neighbours, (points.count, 1))
        # Numbers that documents may refuse are theirs to refuse.
        is_usable = are_numbers(points.doubles.T)
        for axis, which in enumerate(self._positions):
            if which is not None and which < 6:
                states[:, which] = points.doubles[axis]
                neighbours[:, which] = [
                    _neighbour(double, points.exact(axis, index))
                    for index, double in enumerate(points.doubles[axis].tolist())
                ]
        if self._moves_gamma:
            is_usable &= [self._is_unit(points, index) for index in range(points.count)]
        # Quick motions are solved in units of their own.
        is_usable &= np.abs(states[:, :3]).max(axis=1) < QUICK_SPEED
        return states, neighbours, is_usable

    def _is_unit(self, points: SweptPoints, index: int) -> bool:
        gamma = list(self._start[3:])
        for axis, which in enumerate(self._positions):
            if which in (3, 4, 5):
                gamma[which - 3] = as_fraction(points.exact(axis, index))
        return is_unit(gamma)

    def _groups(self, points: SweptPoints, first: int, is_usable: BoolArray) -> "list[_Group]":
        """Return the usable points by the structure of what they are integrated with."""
        indices = np.flatnonzero(is_usable)
        if all(which is not None and which < 6 for which in self._positions):
            integrator = self._integrator((), {}, first) if len(indices) else None
            if integrator is None:
                return []
            return [_Group(indices, np.zeros(len(indices), dtype=np.int64), integrator.models)]
        rows: dict[int, tuple[list[int], list[PointConstants]]] = {}
        others: dict[object, tuple[list[int], list[CompiledIntegrator]]] = {}
        for index in indices.tolist():
            row = self._row(points, index)
            if row is not None:
                members, known = rows.setdefault(id(row.template), ([], []))
                members.append(index)
                known.append(row)
                continue
            integrator = self._integrator_at(points, first, index)
            if integrator is not None:
                alike, integrators = others.setdefault(integrator.structure, ([], []))
                alike.append(index)
                integrators.append(integrator)
        groups = [_group(members, models_of(integrators)) for members, integrators in others.values()]
        if self._shared is not None:
            groups += [_group(members, self._shared.models(known)) for members, known in rows.values()]
        return groups

    def _row(self, points: SweptPoints, index: int) -> PointConstants | None:
        """Return the constants of a point whose potential needs no document."""
        if self._shared is None:
            return None
        axes = [axis for axis, which in enumerate(self._positions) if which is None]
        return self._shared.row([points.exact(axis, index) for axis in axes])

    def _solve_group(
        self, group: "_Group", states: FloatArray, neighbours: FloatArray, block: SolvedBlock
    ) -> None:
        series = block.series
        times = self._times.doubles if series else np.empty(0)
        left = np.arange(len(group.indices))
        for local_tolerance in tolerances(CompiledIntegrator, self._problem.tolerance):
            request = self._run_request.asked(CompiledIntegrator, local_tolerance)
            runs = verified_runs(
                group.models,
                group.which[left],
                states[left],
                neighbours[left],
                self._run_request.check,
                request,
                times,
                self._times.low_parts,
            )
            is_held = runs.endings == VERIFIED
            indices = group.indices[left[is_held]]
            block.solved[indices] = True
            numbers = {name: runs.numbers[is_held, column] for name, column in _TOLD.items()}
            numbers |= printed_errors(numbers, block.numbers)
            for name, column in block.numbers.items():
                if name in _TOLD:
                    column[indices] = numbers[name]
            if series:
                series["t"][indices] = times
                for name, variable in zip(self._names, self._columns, strict=True):
                    series[name][indices] = runs.samples[is_held, :, variable]
            block.refused[CollisionError.code][group.indices[left[runs.endings == COLLIDED]]] = True
            left = left[runs.endings == INACCURATE]
            if not len(left):
                break
        if self._problem.accuracy.measure == "absolute":
            # Others may keep it in units of their own.
            block.refused[AccuracyNotMetError.code][group.indices[left]] = True

    def _integrator_at(self, points: SweptPoints, first: int, index: int) -> CompiledIntegrator | None:
        """Return that of a point's body and potential; None if there is none."""
        moments, exact = dict[str, Fraction](), list[Fraction]()
        for axis, which in enumerate(self._positions):
            if which is None or which >= 6:
                exact.append(as_fraction(points.exact(axis, index)))
                if which is not None:
                    moments[MOMENTS[which - 6]] = exact[-1]
        return self._integrator(tuple(exact), moments, first + index)

    def _integrator(
        self, exact: tuple[Fraction, ...], moments: Mapping[str, Fraction], index: int
    ) -> CompiledIntegrator | None:
        """Return that of a point's body and potential; None if there is none."""
        if exact not in self._settings:
            if len(self._settings) >= MOST_CACHED_INTEGRATORS:
                self._settings.clear()
            self._settings[exact] = self._new_integrator(moments, index)
        return self._settings[exact]

    def _new_integrator(self, moments: Mapping[str, Fraction], index: int) -> CompiledIntegrator | None:
        try:
            body, potential = self._setting(moments, index)
            return integrator_of(body, potential)
        except (DynamicsError, InvalidProblemError):
            return None

    def _setting(self, moments: Mapping[str, Fraction], index: int) -> tuple[RigidBody, Potential]:
        if self._reads:
            problem = read_problem(self._sweep.document(index))
            return problem.body, problem.potential
        body = self._problem.body
        A, B, C = moments.get("A", body.A), moments.get("B", body.B), moments.get("C", body.C)
        return replace(body, A=A, B=B, C=C), self._problem.potential


@dataclass(frozen=True, slots=True)
class _Group:
    """Points whose motions go side by side."""

    indices: IntArray
    which: IntArray
    """The model of each."""
    models: Models

    def part(self, begin: int, end: int) -> "_Group":
        """Return some of the points."""
        return _Group(self.indices[begin:end], self.which[begin:end], self.models)


def _group(indices: Sequence[int], models: Models) -> _Group:
    """Return a group in which every point has a model of its own."""
    return _Group(np.array(indices), np.arange(len(indices)), models)


def _neighbour(double: float, exact: fmpq) -> float:
    """Return :func:`.interface.neighbour_of` of an exact number, the nearest double of which is known."""
    numerator, denominator = double.as_integer_ratio()
    side = int(exact.p) * denominator - numerator * int(exact.q)
    if side == 0 or double == 0.0:
        return double
    return math.nextafter(double, math.inf if side > 0 else -math.inf)
