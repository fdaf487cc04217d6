"""Points of sweeps of motions from any state: the kernels of a single job, without its documents.

What a point needs beside numbers is kept: the integrator of a body and a potential, the times, and what is
asked of two runs. Points that kernels do not settle alone are left to single jobs.
"""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from service.dynamics.body import RigidBody
from service.dynamics.errors import DynamicsError
from service.dynamics.motion import COLUMNS
from service.dynamics.potentials.potential import Potential
from service.dynamics.problem import StateMotion
from service.dynamics.sampling import sample_times
from service.schemas.problem.motions import is_unit
from service.schemas.problem.problem import read_problem
from service.schemas.reading.faults import InvalidProblemError
from service.schemas.sweep.sweep import Sweep
from workers.solvers.errors import AccuracyNotMetError
from workers.solvers.integration.compiled import CompiledIntegrator, Held, integrator_of, samples_of
from workers.solvers.integration.interface import neighbour_of
from workers.solvers.integration.solve import quest_of
from workers.sweeping.family import has_symbol
from workers.sweeping.plan import place_in_state
from workers.sweeping.points import SweptPoints, are_numbers, listed_exactly
from workers.sweeping.solved import SolvedBlock

FloatArray = NDArray[np.float64]

MOST_SETTINGS = 64
"""Integrators of bodies and potentials that are kept at once."""
_MOMENTS = ("A", "B", "C")


class StateSolver:
    """Solves blocks of one sweep of states."""

    def __init__(self, sweep: Sweep) -> None:
        problem = sweep.first_problem
        assert isinstance(problem.motion, StateMotion)
        self._sweep, self._problem = sweep, problem
        self._names = [name for name in sweep.series_columns if name != "t"]
        self._columns = [COLUMNS.index(name) for name in self._names]
        self._places = [place_in_state(axis.path) for axis in sweep.axes]
        self._moves_gamma = any(place in (3, 4, 5) for place in self._places)
        self._known = [listed_exactly(axis) for axis in sweep.axes]
        self._times = sample_times(problem.time, None)
        self._start = (*problem.motion.omega, *problem.motion.gamma)
        self._doubles = np.array([float(number) for number in self._start])
        self._neighbours = np.array([neighbour_of(number) for number in self._start])
        potential = sweep.base["potential"]
        varies = any(axis.path[0] == "potential" for axis in sweep.axes)
        has_moments = isinstance(potential, dict) and any(has_symbol(potential, name) for name in _MOMENTS)
        self._reads = varies or has_moments or not isinstance(potential, dict)
        """Whether the potential of a point is read from its document."""
        self._settings: dict[tuple[Fraction, ...], CompiledIntegrator | None] = {}
        self._quest = quest_of(self._times.doubles, problem.tolerance)

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        sweep = self._sweep
        points = SweptPoints(sweep, self._known, np.arange(first, first + count))
        solved, missed = np.zeros((2, count), dtype=np.bool_)
        numbers = {name: np.full(count, np.nan) for name in sweep.keep}
        series = {name: np.full((count, sweep.samples), np.nan) for name in sweep.series_columns}
        # Numbers that documents may refuse are theirs to refuse.
        for place in np.flatnonzero(are_numbers(points.doubles.T)).tolist():
            found = self._point(points, first, place)
            if found is None:
                continue
            if isinstance(found, AccuracyNotMetError):
                missed[place] = True
                continue
            solved[place] = True
            told = _told(found)
            for name, column in numbers.items():
                column[place] = told.get(name, np.nan)
            if series:
                self._put_series(series, place, found)
        return SolvedBlock(solved, {AccuracyNotMetError.code: missed}, numbers, series)

    def _put_series(self, series: Mapping[str, FloatArray], place: int, found: Held) -> None:
        samples = samples_of(found, self._times.doubles, self._times.rests)
        series["t"][place] = self._times.doubles
        for name, column in zip(self._names, self._columns, strict=True):
            series[name][place] = samples[:, column]

    def _point(self, points: SweptPoints, first: int, place: int) -> Held | AccuracyNotMetError | None:
        """Return what is found, an error, or None for a point that is left to its job."""
        start, state, neighbour = list(self._start), self._doubles.copy(), self._neighbours.copy()
        moments = dict[str, Fraction]()
        exact = list[Fraction]()
        for axis, which in enumerate(self._places):
            ratio = points.exact(axis, place)
            value = Fraction(int(ratio.p), int(ratio.q))
            if which is None or which >= 6:
                exact.append(value)
                if which is not None:
                    moments[_MOMENTS[which - 6]] = value
                continue
            start[which] = value
            state[which], neighbour[which] = float(value), neighbour_of(value)
        if self._moves_gamma and not is_unit(start[3:]):
            return None
        integrator = self._integrator(tuple(exact), moments, first + place)
        if integrator is None:
            return None
        found = self._quest.by_kernels(integrator, state, neighbour)
        return AccuracyNotMetError(found, self._problem.tolerance) if isinstance(found, float) else found

    def _integrator(
        self, exact: tuple[Fraction, ...], moments: Mapping[str, Fraction], index: int
    ) -> CompiledIntegrator | None:
        """Return that of a point's body and potential; None if there is none."""
        if exact not in self._settings:
            if len(self._settings) >= MOST_SETTINGS:
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


def _told(found: Held) -> Mapping[str, float]:
    """Return the numbers that a sweep may keep; a general motion has no others."""
    return {"energy": found.energy, "energy.error": found.energy_error, "error": found.error}
