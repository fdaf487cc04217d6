"""Computes blocks of points that differ in A, C or an exponent: each has a verdict and constants of its own.

A potential whose body moves has no proof that holds for all points at once. But where it is a sum of powers
its compatibility equation is decided exactly at each in a few multiplications of ratios
(:mod:`.power_sums`), which finds the energy too; points of one structure share a program, whose exponents
are data like its constants.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, ctx, fmpq
from numpy.typing import NDArray

from service.dynamics.body import MAX_MOMENT_RATIO
from service.dynamics.errors import DynamicsError
from service.dynamics.formula.algebras.monomials import NotAMonomialSumError, as_fmpq
from service.dynamics.motion import COLUMNS
from service.dynamics.problem import PlanarMotion, Problem, Times
from service.dynamics.reduction.geometry.loop import make_loop
from service.dynamics.reduction.windows import REDUCTION_BITS
from service.dynamics.verdict.proofs.power_sums import CurveEnergy, Judgement, judge_power_sum, number_of
from service.schemas.sweep.sweep import Sweep
from workers.solvers.compiled.batch import Tier
from workers.solvers.compiled.frame import Bodies, loops_of
from workers.sweeping.parameters.family import rounded
from workers.sweeping.parameters.points import SweptPoints, are_numbers, curves_of, listed_exactly, times_of
from workers.sweeping.parameters.programs import double_of
from workers.sweeping.planar.doubles import BlockResult, Sampling, logarithms_of, sweep_loops
from workers.sweeping.planar.exclusions import keep_their_sign
from workers.sweeping.planar.records import (
    INADMISSIBLE,
    INVALID,
    NO_MOTION,
    FoundPoints,
    SolvedBlock,
    numbers_of_motions,
)
from workers.sweeping.varying_body.empty_sums import have_no_motion
from workers.sweeping.parameters.templates import (
    MOST_TEMPLATES,
    Key,
    Model,
    MomentsOfPoint,
    Template,
    own_template,
    shared_template,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


MOST_NUMBER_BITS = 1000
"""Largest size of a number in a potential, in bits: what is made of such ones keeps the limits of
formulas."""


@dataclass(frozen=True, slots=True)
class VaryingPlan:
    """The data for solving points whose bodies or exponents differ."""

    problem: Problem
    """The first point's."""
    tier: Tier
    model: Model
    axes: tuple[int, ...]
    """Indices of the axes of the model's numbers."""
    moments: Mapping[str, int]
    """Indices of the axes of A, B and C."""
    curve_axis: int | None
    start_axis: int | None
    time_axes: Mapping[str, int]
    """Indices of the axes of the times, by their names."""
    motions: Mapping[int, PlanarMotion]
    """The motions by the sign of g1."""
    needs_double: bool
    """There is the curve, or the potential, for A = 2C only."""


@dataclass(frozen=True, slots=True)
class _Point:
    """The numbers that a point states, with its program and its verdict."""

    index: int
    moments: MomentsOfPoint
    numbers: list[fmpq]
    template: Template
    row: list[float]
    values: list[fmpq]
    judgement: Judgement
    energy: CurveEnergy


class VaryingSolver:
    """Solves blocks of one sweep."""

    def __init__(self, sweep: Sweep, plan: VaryingPlan) -> None:
        self._sweep, self._plan = sweep, plan
        problem = plan.problem
        self._names = [name for name in sweep.series_columns if name != "t"]
        columns = np.array(list(map(COLUMNS.index, self._names)), dtype=np.int64)
        self._sampling = Sampling(problem.time, columns, problem.wants_series)
        self._keeps_energy = any("energy" in name for name in sweep.keep)
        self._known = [listed_exactly(axis) for axis in sweep.axes]
        self._templates: dict[Key, Template | None] = {}
        self._last: tuple[object, tuple[Template, list[float], list[fmpq], Judgement] | None] = None, None

    def solve(self, first: int, count: int) -> SolvedBlock:
        """Solve the points ``first`` to ``first + count - 1``."""
        plan = self._plan
        points = SweptPoints(self._sweep, self._known, np.arange(first, first + count))
        results = FoundPoints(self._sweep, self._names, count)
        base = next(iter(plan.motions.items()))
        squares, signs = curves_of(points, plan.curve_axis, *base)
        usable = are_numbers(points.doubles.T) & (signs != 0)
        times = times_of(points, plan.time_axes, plan.problem.time)
        usable &= np.array([each is not None for each in times])
        if plan.start_axis is not None:
            usable &= np.sign(points.doubles[plan.start_axis]) == signs
        groups: dict[tuple[int, int], list[_Point]] = {}
        refused: dict[str, list[int]] = {}
        for index in np.flatnonzero(usable).tolist():
            stated = self._stated(points, index)
            if isinstance(stated, str):
                refused.setdefault(stated, []).append(index)
            elif stated is not None:
                groups.setdefault((id(stated.template), int(signs[index])), []).append(stated)
        for code, indices in refused.items():
            results.refuse(code, np.array(indices, dtype=np.int64))
        for (_, sign), members in groups.items():
            chosen = [squares[each.index] for each in members]
            own = [each for member in members if (each := times[member.index]) is not None]
            self._solve_group(results, points, plan.motions[sign], members, chosen, own)
        return results.block()

    def _stated(self, points: SweptPoints, index: int) -> "_Point | str | None":
        """Return a point, or the code of its refusal; None: left to a single job."""
        plan = self._plan
        moments = self._moments(points, index)
        if not self._is_body(moments) or (plan.needs_double and moments.A != 2 * moments.C):
            return INVALID
        numbers = points.exact_row(index, plan.axes)
        # On a grid neighbours often differ in λ alone.
        key = moments, numbers
        if self._last[0] != key:
            self._last = key, self._judged(moments, numbers)
        known = self._last[1]
        if known is None:
            return None
        template, row, values, judgement = known
        if judgement.energy is None:
            return INADMISSIBLE if judgement.is_refuted else None
        if any(judgement.energy.is_positive):
            # Where the potential has no value is told by single jobs.
            return None
        return _Point(index, moments, numbers, template, row, values, judgement, judgement.energy)

    def _moments(self, points: SweptPoints, index: int) -> MomentsOfPoint:
        body, axes = self._plan.problem.body, self._plan.moments
        A = points.exact(axes["A"], index) if "A" in axes else as_fmpq(body.A)
        C = points.exact(axes["C"], index) if "C" in axes else as_fmpq(body.C)
        if "B" in axes:
            return MomentsOfPoint(A, points.exact(axes["B"], index), C)
        return MomentsOfPoint(A, None if body.B is None else as_fmpq(body.B), C)

    def _is_body(self, moments: MomentsOfPoint) -> bool:
        """Tell whether there is such a body, and planar motions of it."""
        A, B, C = moments
        if A <= 0 or C <= 0 or A == C or A > MAX_MOMENT_RATIO * C or C > MAX_MOMENT_RATIO * A:
            return False
        if B is None:
            return True
        return B > 0 and (self._plan.problem.body.allow_unphysical or abs(A - C) <= B <= A + C)

    def _judged(
        self, moments: MomentsOfPoint, numbers: list[fmpq]
    ) -> tuple[Template, list[float], list[fmpq], Judgement] | None:
        values = self._plan.model.values(moments, numbers)
        if values is None or any(value.height_bits() > MOST_NUMBER_BITS for value in values):
            return None
        entry = self._template(moments, numbers, values)
        if entry is None:
            return None
        template, exact, row = entry
        exact_numbers = [number for number in exact if number is not None]
        try:
            return template, row, values, judge_power_sum(moments.A, moments.C, template.tape, exact_numbers)
        except NotAMonomialSumError:
            return None

    def _template(
        self, moments: MomentsOfPoint, numbers: list[fmpq], values: list[fmpq]
    ) -> tuple[Template, list[fmpq | None], list[float]] | None:
        """Return the template of a point, its numbers exactly, and rounded."""
        model = self._plan.model
        key = model.key(values)
        if key not in self._templates and len(self._templates) < MOST_TEMPLATES:
            self._templates[key] = shared_template(model, moments, numbers)
        shared = self._templates.get(key)
        if shared is not None:
            exact = shared.numbers(values)
            row = shared.row(exact)
            if shared.is_of(row):
                return shared, exact, row
        try:
            own = own_template(model.potential(moments, numbers).tape)
        except (DynamicsError, ValueError):
            return None
        exact = own.numbers(values)
        return own, exact, own.row(exact)

    def _solve_group(
        self,
        results: FoundPoints,
        points: SweptPoints,
        motion: PlanarMotion,
        members: Sequence[_Point],
        squares: Sequence[fmpq],
        times: Sequence[Times],
    ) -> None:
        plan, indices = self._plan, np.array([each.index for each in members], dtype=np.int64)
        rows = np.array([each.row for each in members]).reshape(len(members), -1)
        program = members[0].template.program
        loops = loops_of(_bodies(members), motion, logarithms_of(squares))
        if loops is None:
            return
        at = plan.start_axis
        starts = None if at is None else np.abs(points.doubles[at, indices])
        own = times if plan.time_axes else None
        result = sweep_loops(motion, program, rows, loops, self._sampling, plan.tier, starts, own)
        tolerance = plan.problem.tolerance
        numbers = numbers_of_motions(result, self._sampling.has_times)
        decided = np.isfinite(result.errors) & (result.errors <= tolerance)
        # If only the period is asked for, its own error alone decides whether it is accurate enough.
        decided &= result.period_errors <= tolerance * result.periods
        decided &= np.isfinite(result.samples).all(axis=(1, 2))
        if result.approaches is not None:
            decided &= keep_their_sign(program, rows, result.approaches)
        if self._keeps_energy:
            energies = np.array(
                [_energy(each, square, motion) for each, square in zip(members, squares, strict=True)]
            )
            numbers |= {"energy": energies[:, 0], "energy.error": energies[:, 1]}
            for name in self._sweep.keep:
                decided &= np.isfinite(numbers[name]) if name in ("energy", "energy.error") else True
        self._keep_smooth(decided, result, motion, members)
        results.add(indices, decided, numbers, result)
        rest = np.flatnonzero(~decided)
        judged = [(members[n].moments, members[n].judgement) for n in rest.tolist()]
        results.refuse(NO_MOTION, indices[rest[have_no_motion(judged, loops[rest], motion)]])

    def _keep_smooth(
        self, decided: BoolArray, result: BlockResult, motion: PlanarMotion, members: Sequence[_Point]
    ) -> None:
        """Leave motions to single jobs that pass a pole by a convention."""
        with ctx.workprec(REDUCTION_BITS):
            for n in np.flatnonzero(decided & result.passes_pole).tolist():
                each = members[n]
                potential = self._plan.model.potential(each.moments, each.numbers)
                decided[n] = make_loop(each.moments.body(), potential, motion).is_smooth_at_poles()


def _bodies(members: Sequence[_Point]) -> Bodies:
    alpha, factor, mirrored = [], [], []
    for each in members:
        A, C = each.moments.A, each.moments.C
        is_mirrored = A < C
        if is_mirrored:
            A, C = C, A
        alpha.append(double_of(A / C))
        factor.append(double_of(C / ((A - C) * A)))
        mirrored.append(is_mirrored)
    return Bodies(np.array(alpha), np.array(factor), np.array(mirrored))


def _energy(each: _Point, square: fmpq, motion: PlanarMotion) -> tuple[float, float]:
    """Return the energy on the curve of λ², and the bound of its error, as a job has them."""
    total, largest = arb(0), max(map(abs, map(float, each.values)), default=0.0)
    with ctx.workprec(REDUCTION_BITS):
        for term in each.energy.terms:
            half = term.power / 2
            power = arb(square ** int(half.p)) if half.q == 1 else arb(square) ** arb(half)
            value = arb(term.coefficient) * power
            if term.constants:
                value *= number_of(term.constants)
            if (term.odd_first and motion.sign_of_g1 < 0) != (term.odd_third and motion.g3_sign < 0):
                value = -value
            total, largest = total + value, max(largest, abs(float(value)))
        return rounded(total, largest)
